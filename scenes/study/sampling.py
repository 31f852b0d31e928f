"""Sampling: the value that each frame draws for each distribution of a study.

Grids are enumerated cell by cell. All other distributions of a group are dimensions of one scrambled Halton sequence,
so that even a few frames fill every degree of freedom evenly (Halton 1960; scrambling by Owen 2017, as in
`scipy.stats.qmc.Halton`). Frame j of a group is point j of its sequence: it depends on nothing else.
"""

from __future__ import annotations

import math
import zlib
from functools import lru_cache
from typing import Any

import numpy as np

from roundel.scenes.study.schema import GroupSection, Key


def cells_of(group: GroupSection) -> int:
    """Number of cells: the product of the lengths of all grids."""
    return math.prod(len(s.args) for _, s in group.spreads if s.kind == "grid")


def frames_per_level(group: GroupSection) -> int:
    """Frames of a group at one level of its sweep (all of them, without a sweep).

    Raises
    ------
    ValueError
        If `frames` is not a multiple of the number of cells.
    """
    cells = cells_of(group)
    if group.frames_per_cell is not None:
        return cells * group.frames_per_cell
    assert group.frames is not None
    if group.frames % cells:
        raise ValueError(
            f"{group.frames} frames is not a multiple of the {cells} grid cells; give a multiple, or frames_per_cell"
        )
    return group.frames


def frame_count(group: GroupSection) -> int:
    """All frames of a group."""
    return frames_per_level(group) * (len(group.sweep.levels) if group.sweep else 1)


def stream(seed: int, group: str, *purpose: int) -> np.random.SeedSequence:
    """The seed for one purpose in one group: a function of its arguments only."""
    return np.random.SeedSequence([seed, zlib.crc32(group.encode()), *purpose])


@lru_cache(maxsize=256)
def _points(dimensions: int, seed: int, group: str, block: int) -> Any:
    """256 consecutive points of the group's sequence; every block has the same cost."""
    from scipy.stats import qmc

    engine = qmc.Halton(dimensions, scramble=True, rng=np.random.default_rng(stream(seed, group, 0)))
    # `fast_forward` would compute all points before these; the sequence itself needs only its index.
    engine.num_generated = block * 256
    return engine.random(256)


def draw(group: GroupSection, seed: int, name: str, index: int) -> dict[Key, float]:
    """The value of every distribution for frame `index` of a group (within its level of a sweep)."""
    spreads = group.spreads
    cell = index // (frames_per_level(group) // cells_of(group))
    values: dict[Key, float] = {}
    free = [(key, spread) for key, spread in spreads if spread.kind != "grid"]
    # The last grid varies fastest.
    for key, spread in reversed([(k, s) for k, s in spreads if s.kind == "grid"]):
        cell, position = divmod(cell, len(spread.args))
        values[key] = spread.args[position]
    if free:
        point = _points(len(free), seed, name, index // 256)[index % 256]
        for (key, spread), u in zip(free, point, strict=True):
            values[key] = spread.draw(float(u))
    return values
