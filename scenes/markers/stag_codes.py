"""The layout of STag and its library HD21: Benligiray, Topal and Akinlar, STag: A Stable Fiducial Marker System (2019).

A square of ink with a circle of paper in it, and 48 places for dots of ink in the circle, at the published positions
and with the published words, so that the `stag` detector reads the rendered markers. The published images join
neighbouring dots by hand-tuned smoothing; the code is read at the dots' centres, where both are alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# In sides of the square: radii of the circle of paper, of the circle that holds the dots, and of a dot.
CIRCLE, DOTS_WITHIN = 0.4, 0.35
DOT = 2 * DOTS_WITHIN * 0.062482177287080

# Places of a quarter turn: radius in diameters of the circle that holds the dots, angle in rad from +X toward +Y.
_QUARTER = np.pi / 2
_PLACES = (
    (0.088363142525988, _QUARTER / 2),
    (0.206935928182607, 0.459275804122858),
    (0.206935928182607, _QUARTER - 0.459275804122858),
    (0.313672146827381, 0.200579720495241),
    (0.327493143484516, 0.591687617505840),
    (0.327493143484516, _QUARTER - 0.591687617505840),
    (0.313672146827381, _QUARTER - 0.200579720495241),
    (0.437421957035861, 0.145724938287167),
    (0.437226762361658, 0.433363129825345),
    (0.430628029742607, _QUARTER / 2),
    (0.437226762361658, _QUARTER - 0.433363129825345),
    (0.437421957035861, _QUARTER - 0.145724938287167),
)
# The library with a Hamming distance of 21: 1 is ink, place by place.
_HD21 = (
    "001100111000110010110111010111100001011011110001",
    "000010100100110011110010111110010110110101011011",
    "101101111010101000111100000001001010000110100011",
    "010110010100000011111110101111000000100011100100",
    "010100001010011010011001110011101111010010000100",
    "111001010010010000010111001011111000100001001110",
    "111010001100011000101100011001000001010011010111",
    "110000111010000001100110001100000111110000111110",
    "010001111010011111001011000001010000110001110001",
    "100001011100000010101000010111111100110011011000",
    "101011001100001110110011010100010110010000100101",
    "011011101110000101110000000010011001010011101010",
)


def stag_dots(identity: int) -> Array:
    """Centres (N, 2) of the dots of an identity of HD21, in sides of the square, Y up.

    Raises
    ------
    ValueError
        If the library has no such identity.
    """
    if not 0 <= identity < len(_HD21):
        raise ValueError(f"id {identity} is not in STag's library HD21; use 0 to {len(_HD21) - 1}")
    places = [(radius, angle + turn * _QUARTER) for turn in range(4) for radius, angle in _PLACES]
    inked = [place for place, bit in zip(places, _HD21[identity], strict=True) if bit == "1"]
    radius, angle = np.array(inked).T
    return np.asarray(2 * DOTS_WITHIN * radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
