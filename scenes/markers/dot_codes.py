"""Identities in dots on two rings, in the spirit of RUNE-Tag (Bergamasco et al. 2011), with a code of our own.

Each of `SECTORS` = 11 sectors has a place for a dot on the outer ring and, half a sector further, one on the inner
ring. At least one of them is inked, so that a sector holds a symbol of three: both dots, the outer one, the inner one.
The words are those of the ternary Golay code of length 11 (Golay 1949), which is cyclic with generator polynomial
x^5 + x^4 - x^3 + x^2 - 1 and has a least distance of 5 symbols. 11 is prime, so that every word except the three
constant ones has 11 different rotations: any two words of different identities, and any two rotations of one word,
differ in at least `LEAST_DISTANCE` = 5 sectors. A reader corrects two wrong sectors, or detects four.

An identity is a class of rotations, represented by its least word. Kept are those with an outer dot in at least eight
sectors and never three neighbouring ones without, so that the dots span the enclosing circle.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

SECTORS = 11
LEAST_DISTANCE = 5
BOTH, OUTER, INNER = 0, 1, 2

# In radii of the enclosing circle, which the outer dots touch.
OUTER_DOT, INNER_DOT = 0.14, 0.105
OUTER_RING, INNER_RING = 1.0 - OUTER_DOT, 0.56

_GENERATOR = (-1, 0, 1, -1, 1, 1)  # from x^0
_DIMENSION = SECTORS - len(_GENERATOR) + 1
_MOST_WITHOUT_OUTER = 3
_LONGEST_GAP = 2


@lru_cache(maxsize=1)
def dot_code_words() -> tuple[tuple[int, ...], ...]:
    """The bank: for each id its 11 symbols (`BOTH`, `OUTER`, `INNER`), sector by sector from +X toward +Y."""
    words = {_multiplied(message) for message in product(range(3), repeat=_DIMENSION)}
    least = {min(word[i:] + word[:i] for i in range(SECTORS)) for word in words}
    return tuple(sorted(word for word in least if len(set(word)) > 1 and _spans(word)))


def dots_of(identity: int) -> NDArray[np.float64]:
    """The dots of an identity as rows x, y, radius, (n, 3), in radii of the enclosing circle.

    Raises
    ------
    ValueError
        If the bank has no such identity.
    """
    bank = dot_code_words()
    if not 0 <= identity < len(bank):
        raise ValueError(f"id {identity} is not in the bank of dot codes; use 0 to {len(bank) - 1}")
    places = dot_places()
    return places[inked_places(bank[identity])]


def dot_places() -> NDArray[np.float64]:
    """All 22 places for dots as rows x, y, radius: the outer ring from +X toward +Y, then the inner ring."""
    turn = 2 * np.pi * np.arange(SECTORS) / SECTORS
    rings = ((OUTER_RING, OUTER_DOT, turn), (INNER_RING, INNER_DOT, turn + np.pi / SECTORS))
    rows = [np.stack([ring * np.cos(t), ring * np.sin(t), np.full(SECTORS, dot)], axis=1) for ring, dot, t in rings]
    return np.concatenate(rows)


def inked_places(word: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which of the 22 places of `dot_places` a word inks."""
    symbols = np.array(word)
    return np.concatenate([symbols != INNER, symbols != OUTER])


def _multiplied(message: tuple[int, ...]) -> tuple[int, ...]:
    """The product of a message with the generator polynomial over GF(3)."""
    return tuple(int(v) for v in np.convolve(message, _GENERATOR) % 3)


def _spans(word: tuple[int, ...]) -> bool:
    without = [symbol == INNER for symbol in word]
    longest = _LONGEST_GAP + 1
    gaps = any(all(without[(i + k) % SECTORS] for k in range(longest)) for i in range(SECTORS))
    return sum(without) <= _MOST_WITHOUT_OUTER and not gaps
