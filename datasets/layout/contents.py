"""What a dataset holds: its identity, its shards, the checksums of their files; nothing of its study or truth."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import accumulate
from typing import Any

from roundel.datasets.layout import files
from roundel.datasets.layout.manifest import read_manifest, read_shard
from roundel.datasets.layout.shards import Shard
from roundel.datasets.store.store import Listed, MissingFile, Store
from roundel.datasets.store.writing import sha256
from roundel.scenes.errors import DataError

REMEDY = "`roundel repair` mends it"


def images_digest(listed: dict[str, Any]) -> str:
    """One checksum over those of all images, or of the points, of a shard; equal for the same pixels.

    `listed` has `{sha256, bytes}` by name.
    """
    seen = [n for n in sorted(listed) if n.startswith(f"{files.IMAGES}/") or n == files.POINTS]
    return sha256("\n".join(f"{name} {_digest_of(listed[name])}" for name in seen).encode())


def joined_digest(digests: list[tuple[str, str]]) -> str:
    """The checksum of the images of several shards, from pairs (folder, checksum); that of one is its own."""
    if len(digests) == 1:
        return digests[0][1]
    return sha256("\n".join(f"{folder} {digest}" for folder, digest in digests).encode())


def _digest_of(listed: Any) -> str:
    return str(listed["sha256"] if isinstance(listed, dict) else listed.sha256)


@dataclass(frozen=True)
class Part:
    """A shard that is there: where, how many frames, what the manifest says of its record."""

    shard: Shard
    frames: int
    listed: Listed | None
    images_sha256: str


@dataclass(frozen=True)
class Contents:
    """A dataset's identity and shards."""

    folder: Store
    dataset_id: str
    complete: bool
    images_sha256: str
    groups: tuple[str, ...]
    parts: tuple[Part, ...]
    own: dict[str, Listed] = field(repr=False)

    def place_of(self, index: int) -> tuple[int, int]:
        """Number of the shard of the frame at a position, and the frame's position in it."""
        if not 0 <= index < self.frames:
            raise IndexError(f"no frame at position {index}; there are {self.frames}")
        number = bisect_right(self._ends, index)
        return number, index - (self._ends[number - 1] if number else 0)

    @property
    def frames(self) -> int:
        """Number of frames that are there."""
        return self._ends[-1] if self._ends else 0

    @cached_property
    def _ends(self) -> list[int]:
        return list(accumulate(part.frames for part in self.parts))

    def files_of(self, part: Part) -> dict[str, Listed]:
        """What is recorded of the files of a shard, by name within it.

        Raises
        ------
        DataError
            If its record is missing or damaged.
        """
        return self.own if part.listed is None else _shard_files(self.folder, part.shard, part.listed)

    def read(self, part: Part, name: str, remedy: str = REMEDY) -> bytes:
        """The bytes of a file of a shard, checked.

        Raises
        ------
        DataError
            If it is missing, was altered, or is not listed.
        """
        listed = self.files_of(part).get(name)
        whole = part.shard.name(name)
        if listed is None:
            raise DataError(f"{self.folder.place(whole)}: the manifest does not list it; {remedy}")
        try:
            return self.folder.read_checked(whole, listed, remedy)
        except MissingFile as error:
            raise MissingFile(f"{self.folder.place(whole)}: is missing; {remedy}") from error

    def listed(self) -> Iterator[tuple[str, Listed]]:
        """All files that are listed, by name within the dataset: those of shards, too."""
        yield from self.own.items()
        for part in self.parts:
            if part.listed is not None:
                yield part.shard.name(files.SHARD), part.listed
                for name, listed in self.files_of(part).items():
                    yield part.shard.name(name), listed


@lru_cache(maxsize=4)
def _shard_files(folder: Store, shard: Shard, listed: Listed) -> dict[str, Listed]:
    found = read_shard(folder, shard, listed)
    assert found is not None, "a listed record is there, or an error"
    return {name: Listed(record.bytes, record.sha256) for name, record in found[1].files.items()}


def read_contents(folder: Store) -> Contents:
    """What the manifest of a dataset says of its files.

    Raises
    ------
    DataError
        If there is no readable manifest.
    """
    _, manifest = read_manifest(folder)
    own = {name: Listed(record.bytes, record.sha256) for name, record in manifest.files.items()}
    groups = tuple(manifest.counts.groups)
    if manifest.shards is None:
        images = manifest.images_sha256 or images_digest(own)
        part = Part(Shard("", range(manifest.counts.frames)), manifest.counts.frames, None, images)
        return Contents(folder, manifest.dataset_id, manifest.complete, images, groups, (part,), own)
    parts = tuple(
        Part(
            Shard(p.folder, range(p.frames[0], p.frames[0] + p.frames[1])),
            p.frames[1],
            Listed(p.bytes, p.sha256),
            p.images_sha256,
        )
        for p in manifest.shards
    )
    images = joined_digest([(part.shard.folder, part.images_sha256) for part in parts])
    return Contents(folder, manifest.dataset_id, manifest.complete, images, groups, parts, own)
