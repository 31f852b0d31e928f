"""Logs in an object store, which cannot append: each appended piece is an object of its own, numbered.

`log/OWNER-N.000017.jsonl` is the 18th piece of a log, and `log/OWNER-N.end` tells that its process works on it no more.
A piece is created and never replaced.
"""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TYPE_CHECKING

from roundel.datasets.store.owner import is_gone, is_here
from roundel.datasets.store.store import LOG, LogFile, LogFiles
from roundel.scenes.errors import DataError

if TYPE_CHECKING:
    from roundel.datasets.store.bucket import Bucket

_PIECE = re.compile(r"(.+)\.([0-9]{6,})\.jsonl")


_END = ".end"

# Requests at the same time, for pieces that are still unknown.
_READERS = 16

# As many as a shard of 1,000 frames has, and some more.
_KEPT = 8192


def _piece(name: str, number: int) -> str:
    return f"{LOG}/{name}.{number:06d}.jsonl"


def _owner(file: str) -> str:
    found = _PIECE.fullmatch(file)
    return found[1] if found else file.removesuffix(_END)


# Pieces that were read or written before, by folder and name: they never change.
_seen: dict[tuple[str, str], bytes] = {}


def _keep(folder: str, piece: str, data: bytes) -> None:
    """Keep a piece; the oldest are forgotten."""
    _seen[folder, piece] = data
    while len(_seen) > _KEPT:
        _seen.pop(next(iter(_seen)), None)


class _LogObject(LogFile):
    """A log of this process."""

    def __init__(self, bucket: Bucket, name: str) -> None:
        self.bucket, self.name, self._pieces = bucket, name, 0

    def append(self, data: bytes, durable: bool) -> None:
        """Append whole lines, as a piece."""
        piece = _piece(self.name, self._pieces)
        if not self.bucket.write_new(piece, data):
            raise DataError(
                f"{self.bucket.place(piece)}: another process writes under this name; run the command again"
            )
        _keep(str(self.bucket), piece, data)
        self._pieces += 1

    def close(self) -> None:
        """Say that nothing more will come."""
        with suppress(DataError):  # of a store that fails now, the processes of other hosts wait for news in vain
            self.bucket.write(f"{LOG}/{self.name}{_END}", b"")

    def drop(self) -> None:
        """Remove its pieces."""
        self.bucket.remove(*(_piece(self.name, i) for i in range(self._pieces)))


class LogObjects(LogFiles):
    """The logs in a folder of an object store; a length is a number of pieces."""

    def __init__(self, bucket: Bucket) -> None:
        self.bucket = bucket

    def lengths(self) -> dict[str, int]:
        """How many pieces each log has; those after a missing one do not count."""
        pieces: dict[str, set[int]] = {}
        for file in self.bucket.sizes(LOG):
            found = _PIECE.fullmatch(file)
            have = pieces.setdefault(_owner(file), set())
            if found:
                have.add(int(found[2]))
        return {name: next(i for i in range(len(have) + 1) if i not in have) for name, have in sorted(pieces.items())}

    def read(self, name: str, start: int, stop: int) -> bytes:
        """The pieces between two lengths."""
        folder, pieces = str(self.bucket), [_piece(name, i) for i in range(start, stop)]
        found = {piece: _seen[folder, piece] for piece in pieces if (folder, piece) in _seen}
        unknown = [piece for piece in pieces if piece not in found]
        if unknown:
            with ThreadPoolExecutor(min(len(unknown), _READERS)) as pool:
                for piece, data in zip(unknown, pool.map(self.bucket.read, unknown), strict=True):
                    found[piece] = data
                    _keep(folder, piece, data)
        return b"".join(found[piece] for piece in pieces)

    def create(self, name: str) -> LogFile:
        """A new log."""
        return _LogObject(self.bucket, name)

    def works(self, name: str) -> bool | None:
        """Whether the process of a log still works: known of those of this host alone."""
        owner = name.rpartition("-")[0]
        if self.bucket.size(f"{LOG}/{name}{_END}") is not None:
            return False
        return False if is_gone(owner) else True if is_here(owner) else None

    def remove(self, names: list[str]) -> None:
        """Remove logs, the last pieces first: what is left of one is a log still."""
        gone = set(names)
        files = sorted((file for file in self.bucket.sizes(LOG) if _owner(file) in gone), reverse=True)
        self.bucket.remove(*(f"{LOG}/{file}" for file in files))

    def place(self, name: str) -> str:
        """A log's address, for messages."""
        return self.bucket.place(f"{LOG}/{name}.jsonl")
