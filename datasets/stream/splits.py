"""Splits of a dataset: which frames are for training, validation and tests, reproducible from a seed.

Frames that share what a split is made by are never in two of its parts.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.datasets.layout.sweeps import sweep_positions
from roundel.scenes.errors import NotComparableError, UsageError

NAMES = ("train", "val", "test")
BY = ("pose", "group", "world", "camera")


@dataclass(frozen=True)
class Splits:
    """How frames are split.

    Attributes
    ----------
    fractions : tuple of float
        Of train, val and test; they add up to one.
    by : {"pose", "group", "world", "camera"}
        What two parts never share.
    seed : int
    """

    fractions: tuple[float, float, float] = (1.0, 0.0, 0.0)
    by: str = "pose"
    seed: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """The parts that are not empty by their fraction."""
        return tuple(name for name, share in zip(NAMES, self.fractions, strict=True) if share > 0)


def parse_fractions(text: str) -> tuple[float, float, float]:
    """Fractions from percentages such as `80/10/10`.

    Raises
    ------
    UsageError
        If they are not three numbers that add up to 100.
    """
    try:
        shares = [float(word) for word in text.split("/")]
    except ValueError:
        shares = []
    if len(shares) != 3 or any(not 0 <= share <= 100 for share in shares) or abs(sum(shares) - 100) > 1e-9:
        raise UsageError(f"{text!r}: give three percentages that add up to 100, train/val/test, for example 80/10/10")
    return shares[0] / 100, shares[1] / 100, shares[2] / 100


def split_by(dataset: Dataset, splits: Splits) -> Callable[[int], str]:
    """A function that gives the split of a frame by its position.

    Raises
    ------
    UsageError
        If frames cannot be split by that.
    NotComparableError
        If there are fewer different values than parts.
    """
    if len(splits.names) == 1:
        return lambda index: splits.names[0]
    if splits.by not in BY:
        raise UsageError(f"split by {splits.by!r}: give {', '.join(BY)}")
    key = _key_of(dataset, splits.by)
    hashes = np.fromiter((_hash(splits.seed, key(i)) for i in range(len(dataset))), dtype=np.uint64, count=len(dataset))
    # Unique hashes are sorted: this is the order in which values are dealt out.
    _, value, frames = np.unique(hashes, return_inverse=True, return_counts=True)
    if len(frames) < len(splits.names):
        raise NotComparableError(
            f"{dataset.address}: cannot be split by {splits.by}: it has {len(frames)} of them, and {len(splits.names)} "
            "parts are wanted; split it by pose"
        )
    place = _dealt(frames, splits)[value]
    return lambda index: NAMES[place[index]]


def _dealt(frames: NDArray[np.int64], splits: Splits) -> NDArray[np.int8]:
    """A part for each value, given its number of frames: each goes where most frames are still wanted."""
    wanted = np.array(splits.fractions) * frames.sum()
    asked = np.array(splits.fractions) > 0
    taken = ~asked
    out = np.empty(len(frames), dtype=np.int8)
    for i, count in enumerate(frames.tolist()):
        # No part stays empty, however few the values.
        among = ~taken if len(frames) - i == np.sum(~taken) else asked
        part = int(np.argmax(np.where(among, wanted, -np.inf)))
        out[i], taken[part] = part, True
        wanted[part] -= count
    return out


def _hash(seed: int, value: str) -> int:
    """64 bits that depend on the seed and the value alone, on any machine."""
    return int.from_bytes(hashlib.sha256(f"roundel split {seed} {value}".encode()).digest()[:8], "big")


def _key_of(dataset: Dataset, by: str) -> Callable[[int], str]:
    """What a frame has of what is split by, as text."""
    images, groups = dataset.images, dataset.study.get("groups") or {}
    if by == "camera":
        return lambda index: _text(
            {k: images.records[index].get(k) for k in ("K", "distortion", "width_px", "height_px")}
        )
    of_frame = images.groups
    if by == "group":
        return lambda index: of_frame[index]
    if by == "world":
        worlds = {name: _text(section.get("world")) for name, section in groups.items()}
        return lambda index: worlds.get(of_frame[index], of_frame[index])
    positions, ids = sweep_positions(images, dataset.manifest), images.frame_ids
    # The levels of a sweep have the same poses.
    return lambda index: f"{of_frame[index]} {positions[ids[index]][1]}"


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True)
