"""Identities in the widths of concentric crowns, in the spirit of CCTag (Calvet et al. 2016), with a bank of our own.

The radius is divided into `CELLS` equal cells. From the outside inward there are three crowns of ink with crowns of
paper between them and a disc of paper at the centre: six widths of at least `LEAST_WIDTH` cells each. The bank is a
lexicode: all such profiles in lexicographic order of their widths, each kept if it differs from every profile kept so
far in at least `LEAST_DISTANCE` cells. A reader that takes the nearest profile is right as long as fewer than half of
that many cells are misread.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

CROWNS = 3
CELLS = 20
LEAST_WIDTH = 2
LEAST_DISTANCE = 5


@lru_cache(maxsize=1)
def ring_code_widths() -> tuple[tuple[int, ...], ...]:
    """The bank: for each id, six widths in cells, from the outermost crown of ink to the disc of paper."""
    kept: list[tuple[int, ...]] = []
    words: list[NDArray[np.bool_]] = []
    for widths in _compositions(CELLS, 2 * CROWNS):
        word = _word(widths)
        if all(np.count_nonzero(word != other) >= LEAST_DISTANCE for other in words):
            kept.append(widths)
            words.append(word)
    return tuple(kept)


def ring_code_words() -> NDArray[np.bool_]:
    """The bank as (ids, CELLS) cells from the outside inward, True for ink."""
    return np.array([_word(widths) for widths in ring_code_widths()])


def ring_code_radii(identity: int) -> tuple[float, ...]:
    """The six radii of an identity from the outermost inward, in outer radii; ink begins at the first, then paper.

    Raises
    ------
    ValueError
        If the bank has no such identity.
    """
    bank = ring_code_widths()
    if not 0 <= identity < len(bank):
        raise ValueError(f"id {identity} is not in the bank of ring codes; use 0 to {len(bank) - 1}")
    inside = np.concatenate([[0], np.cumsum(bank[identity])[:-1]])
    return tuple(float(v) for v in (CELLS - inside) / CELLS)


def _word(widths: tuple[int, ...]) -> NDArray[np.bool_]:
    return np.repeat(np.arange(len(widths)) % 2 == 0, widths)


def _compositions(total: int, parts: int) -> Iterator[tuple[int, ...]]:
    """The ways to write `total` as an ordered sum of widths, in lexicographic order."""
    if parts == 1:
        yield (total,)
        return
    for first in range(LEAST_WIDTH, total - LEAST_WIDTH * (parts - 1) + 1):
        for rest in _compositions(total - first, parts - 1):
            yield first, *rest
