"""Value noise: random numbers as a function of position, for paper grain and clutter.

The lattice cell of a position and a seed are hashed to integers by pcg3d (Jarzynski and Olano, Hash functions for GPU
rendering, JCGT 9(3), 2020), in 32-bit arithmetic that the renderer reproduces exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.uint32]

# Offsets added to the seed, one for each purpose.
GRAIN, CLUTTER_SHAPE, CLUTTER_PLACE = 0x3C6EF372, 0xDAA66D2B, 0x78DDE6E4

# Grain has unit RMS: a lattice value is uniform in +-sqrt(3), and the smoothstep s between two of them keeps
# E[s^2 + (1 - s)^2] = 26/35 of the variance along each axis.
GRAIN_AMPLITUDE = 3**0.5 * 35 / 26

# Half the size of a clutter shape, in cells: the minimum, and the largest addition to it.
CLUTTER_LEAST, CLUTTER_MORE = 0.1, 0.35


def pcg3d(x: Integers, y: Integers, z: Integers) -> tuple[Integers, Integers, Integers]:
    """Three hashes of three integers; arrays broadcast, and arithmetic is modulo 2^32."""
    with np.errstate(over="ignore"):
        a, b, c = (v * np.uint32(1664525) + np.uint32(1013904223) for v in (x, y, z))
        a = a + b * c
        b = b + c * a
        c = c + a * b
        a, b, c = (v ^ (v >> np.uint32(16)) for v in (a, b, c))
        a = a + b * c
        b = b + c * a
        c = c + a * b
    return a, b, c


def unit(h: Integers) -> Array:
    """Hashes to [0, 1): the upper 24 bits, which float32 holds exactly."""
    return np.asarray((h >> np.uint32(8)) * 2.0**-24, dtype=np.float64)


def _cells(at_m: ArrayLike, cell_m: float) -> tuple[Integers, Array]:
    """The lattice cell of positions along an axis, and how far into it they are, in cells."""
    u = np.asarray(at_m, dtype=np.float64) / cell_m
    # Positions beyond the integer range, or NaN, are in cell 0.
    u = np.where(np.abs(u) < 2.0**31, u, 0.0)
    index = np.floor(u)
    return index.astype(np.int64).astype(np.uint32), u - index


def _key(seed: int, purpose: int) -> Integers:
    return np.asarray((seed + purpose) & 0xFFFFFFFF, dtype=np.uint32)


def grain_at(x_m: ArrayLike, y_m: ArrayLike, cell_m: float, seed: int) -> Array:
    """Value noise of unit RMS over the plane, at most `GRAIN_AMPLITUDE` to either side, smooth across its cells.

    Corners of the lattice have independent values; a smoothstep interpolates along each axis.
    """
    (column, u), (row, v) = _cells(x_m, cell_m), _cells(y_m, cell_m)
    s, t = (f * f * (3 - 2 * f) for f in (u, v))
    key = _key(seed, GRAIN)
    one = np.uint32(1)
    with np.errstate(over="ignore"):
        columns, rows = (column, column + one), (row, row + one)
    lower, upper = (unit(pcg3d(columns[0], r, key)[0]) * (1 - s) + unit(pcg3d(columns[1], r, key)[0]) * s for r in rows)
    return np.asarray((2 * (lower * (1 - t) + upper * t) - 1) * GRAIN_AMPLITUDE, dtype=np.float64)


def clutter_at(x_m: ArrayLike, y_m: ArrayLike, cell_m: float, seed: int) -> tuple[NDArray[np.bool_], Array]:
    """Discs and squares, one per cell and entirely inside it.

    Returns
    -------
    inside : bool array
        Whether a position is on its cell's disc or square.
    level : array
        Level of that shape, uniform in [-1, 1).
    """
    (column, u), (row, v) = _cells(x_m, cell_m), _cells(y_m, cell_m)
    kind, size, level = pcg3d(column, row, _key(seed, CLUTTER_SHAPE))
    place = pcg3d(column, row, _key(seed, CLUTTER_PLACE))
    half = CLUTTER_LEAST + CLUTTER_MORE * unit(size)
    du, dv = (w - (half + (1 - 2 * half) * unit(h)) for w, h in ((u, place[0]), (v, place[1])))
    round_one = du * du + dv * dv < half * half
    square = (np.abs(du) < half) & (np.abs(dv) < half)
    return np.asarray(np.where(kind >> np.uint32(31) == 0, round_one, square)), 2 * unit(level) - 1
