"""What a dataset is kept in: a folder of a disk, or a place of an object store; both have the same calls.

Names are relative, of plain letters, with `/`. A file appears completely or not at all.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from roundel.datasets.store.writing import sha256
from roundel.scenes.errors import DataError

# More than any single file of a dataset needs; a record that claims more is damaged.
MOST_BYTES = 2 << 30

# The folder of the logs within a folder.
LOG = "log"

_PART = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,199}")


class MissingFile(DataError):
    """A file that is not there."""


@dataclass(frozen=True)
class Listed:
    """What a record says of a file: its size and checksum."""

    bytes: int
    sha256: str


def is_confined(name: str) -> bool:
    """Whether a name is relative, of plain letters, and stays below its folder."""
    return all(_PART.fullmatch(part) for part in name.split("/"))


class LogFile(ABC):
    """The log of this process: bytes that only it appends."""

    @abstractmethod
    def append(self, data: bytes, durable: bool) -> None:
        """Append whole lines; if `durable`, they are safe when this returns.

        Raises
        ------
        DataError
            If they cannot be written.
        """

    @abstractmethod
    def close(self) -> None:
        """Work on it no more. What it says stays."""

    @abstractmethod
    def drop(self) -> None:
        """Remove it: it says nothing yet."""


class LogFiles(ABC):
    """The logs of all processes that work in a folder, by name."""

    @abstractmethod
    def lengths(self) -> dict[str, int]:
        """How much each log has, in units of its own; sorted by name."""

    @abstractmethod
    def read(self, name: str, start: int, stop: int) -> bytes:
        """What was appended between two lengths.

        Raises
        ------
        MissingFile
            If there is no such log any more.
        DataError
            If it cannot be read.
        """

    @abstractmethod
    def create(self, name: str) -> LogFile:
        """A new log.

        Raises
        ------
        DataError
            If it cannot be written.
        """

    @abstractmethod
    def works(self, name: str) -> bool | None:
        """Whether the process of a log still works on it; None if nothing tells."""

    @abstractmethod
    def remove(self, names: list[str]) -> None:
        """Remove logs.

        Raises
        ------
        DataError
            If one cannot be removed.
        """

    @abstractmethod
    def place(self, name: str) -> str:
        """A log's address, for messages."""


class Store(ABC):
    """A folder of files, with folders in it."""

    # How long to wait before asking again whether others have gone on, seconds.
    poll_s: float

    # Whether bytes that were once safely written may be others later, as on a disk after a loss of power.
    decays: bool

    @abstractmethod
    def __str__(self) -> str:
        """The address."""

    @abstractmethod
    def address(self) -> str:
        """The address for other processes, in whichever folder they work."""

    @abstractmethod
    def sub(self, name: str) -> Store:
        """A folder within this one; the empty name is this one."""

    @abstractmethod
    def absence(self) -> str:
        """What is there instead of a folder, in words; empty if it is there."""

    @abstractmethod
    def is_occupied(self) -> bool:
        """Whether anything is there, other than temporary files."""

    @abstractmethod
    def size(self, name: str) -> int | None:
        """Bytes of a regular file; None if there is none."""

    @abstractmethod
    def sizes(self, folder: str = "") -> dict[str, int]:
        """Bytes of the regular files of a folder, by name within it; temporary files are left out."""

    @abstractmethod
    def names(self, folder: str = "") -> list[str]:
        """Names of everything in a folder, sorted; those of temporary files are left out."""

    @abstractmethod
    def read(self, name: str, most: int = MOST_BYTES) -> bytes:
        """The bytes of a regular file.

        Raises
        ------
        MissingFile
            If there is none.
        DataError
            If it is something else, larger than `most`, or cannot be read.
        """

    @abstractmethod
    def write(self, name: str, data: bytes) -> None:
        """Write a file completely or not at all.

        Raises
        ------
        DataError
            If it cannot be written.
        """

    @abstractmethod
    def write_new(self, name: str, data: bytes) -> bool:
        """Likewise, unless somebody else has written another one: False.

        Raises
        ------
        DataError
            If it cannot be written.
        """

    @abstractmethod
    def remove(self, *names: str) -> None:
        """Remove files, and make that durable; those that are not there are left out.

        Raises
        ------
        DataError
            If one cannot be removed.
        """

    @abstractmethod
    def discard(self, *names: str) -> None:
        """Remove files and links that a listing gave, whatever their names; `leftovers` are among them."""

    @abstractmethod
    def take(self, name: str, source: Store, theirs: str) -> None:
        """Make a file of another store, which never changes, one of this one.

        Raises
        ------
        DataError
            If it cannot be read or written.
        """

    @abstractmethod
    def leftovers(self, folder: str = "") -> list[str]:
        """Temporary files in a folder, of all processes, by name within it."""

    @abstractmethod
    def clear_leftovers(self, *folders: str) -> None:
        """Remove those of processes that are gone; without folders, in this one."""

    @abstractmethod
    def alone(self) -> AbstractContextManager[None]:
        """A block that one process at a time is in, where the store can tell; the others wait."""

    @abstractmethod
    def logs(self) -> LogFiles:
        """The logs in this folder."""

    @abstractmethod
    def on_disk(self, name: str, data: bytes) -> AbstractContextManager[Path]:
        """A file on disk with these bytes: the file of that name itself where there is one, else a temporary one."""

    def place(self, name: str) -> str:
        """A file's address, for messages."""
        return f"{self}/{name}"

    def read_checked(self, name: str, listed: Listed, remedy: str) -> bytes:
        """The bytes of a file that a record lists.

        Raises
        ------
        DataError
            If they are not those that were recorded; `remedy` is what to do.
        """
        data = self.read(name)
        if len(data) != listed.bytes:
            raise DataError(f"{self.place(name)}: {len(data)} bytes, but {listed.bytes} were recorded; {remedy}")
        if sha256(data) != listed.sha256:
            raise DataError(f"{self.place(name)}: its sha256 is not the recorded one: it was altered; {remedy}")
        return data

    def checked_name(self, name: str) -> str:
        """The name, if it stays within this folder.

        Raises
        ------
        DataError
            If it leads out of it.
        """
        if not is_confined(name):
            raise DataError(f"{self}: {name[:80]!r} is not the name of a file of this dataset; it is damaged")
        return name
