"""Shards: a dataset's frames in folders of a fixed number, each complete in itself.

A dataset of one shard has no folder for it: its files lie beside the manifest.
"""

from __future__ import annotations

from typing import NamedTuple

# Part of the format: whoever renders any part of a dataset puts a frame into the same shard.
SHARD_FRAMES = 1000


class Shard(NamedTuple):
    """A shard: its folder within the dataset, empty for the dataset itself, and the frames that belong there."""

    folder: str
    frames: range

    def name(self, file: str) -> str:
        """Path of one of its files within the dataset."""
        return f"{self.folder}/{file}" if self.folder else file


def shard_folder(number: int) -> str:
    """Folder of a shard of a dataset that has several."""
    return f"shards/{number:05d}"


def shards_of(total: int) -> list[Shard]:
    """The shards of a dataset with `total` frames."""
    if total <= SHARD_FRAMES:
        return [Shard("", range(total))]
    starts = range(0, total, SHARD_FRAMES)
    return [Shard(shard_folder(k), range(a, min(a + SHARD_FRAMES, total))) for k, a in enumerate(starts)]


def shard_of(total: int, frame_id: int) -> Shard:
    """The shard of a frame."""
    if total <= SHARD_FRAMES:
        return Shard("", range(total))
    number = frame_id // SHARD_FRAMES
    return Shard(shard_folder(number), range(number * SHARD_FRAMES, min((number + 1) * SHARD_FRAMES, total)))
