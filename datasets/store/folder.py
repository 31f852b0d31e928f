"""A folder of files with confined names: what is read is a regular file of bounded size, below the folder.

A dataset may come from anywhere. Names in its records are relative and never lead out of the folder; links, pipes and
devices are refused; the size is known before the first byte is read.
"""

from __future__ import annotations

import os
import re
import stat
from dataclasses import dataclass
from pathlib import Path

from roundel.datasets.store.writing import make_folder, sha256, sync_folder, write_failure, write_file
from roundel.scenes.errors import DataError

# More than any single file of a dataset needs; a record that claims more is damaged.
MOST_BYTES = 2 << 30

_PART = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,199}")
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


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


@dataclass(frozen=True)
class Folder:
    """A folder on disk."""

    path: Path

    def __str__(self) -> str:
        return str(self.path)

    def sub(self, name: str) -> Folder:
        """A folder within this one; the empty name is this one."""
        return Folder(self._whole(name)) if name else self

    def place(self, name: str) -> str:
        """A file's address, for messages."""
        return str(self.path / name)

    def _whole(self, name: str) -> Path:
        """The path of a name.

        Raises
        ------
        DataError
            If the name leads out of the folder, by itself or through a link.
        """
        if not is_confined(name):
            raise DataError(f"{self.path}: {name[:80]!r} is not the name of a file of this dataset; it is damaged")
        whole = self.path
        for part in name.split("/")[:-1]:
            whole /= part
            if whole.is_symlink():
                raise DataError(f"{whole}: is a link; a dataset has none: put the folder itself there")
        return whole / name.rpartition("/")[2]

    def size(self, name: str) -> int | None:
        """Bytes of a regular file; None if there is none."""
        try:
            found = os.lstat(self._whole(name))
        except OSError:
            return None
        return found.st_size if stat.S_ISREG(found.st_mode) else None

    def read(self, name: str, most: int = MOST_BYTES, start: int = 0) -> bytes:
        """The bytes of a regular file, from `start`.

        Raises
        ------
        MissingFile
            If there is none.
        DataError
            If it is a link, a pipe or a device, larger than `most`, or cannot be read.
        """
        path = self._whole(name)
        try:
            descriptor = os.open(path, os.O_RDONLY | _NO_LINK)
        except FileNotFoundError as error:
            raise MissingFile(f"{path}: is missing") from error
        except OSError as error:
            if path.is_symlink():
                raise DataError(f"{path}: is a link; a dataset has none: put the file itself there") from error
            raise DataError(f"{path}: cannot be read: {error.strerror or error}") from error
        found = os.fstat(descriptor)
        if stat.S_ISDIR(found.st_mode):
            os.close(descriptor)
            raise DataError(f"{path}: is a folder, not a regular file")
        with os.fdopen(descriptor, "rb") as file:
            if not stat.S_ISREG(found.st_mode):
                raise DataError(f"{path}: is not a regular file; a dataset has no pipes, devices or folders there")
            if found.st_size > most:
                raise DataError(f"{path}: {found.st_size} bytes are more than this file may have ({most}); damaged")
            try:
                file.seek(start)
                return file.read(max(found.st_size - start, 0))
            except (OSError, MemoryError) as error:
                raise DataError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error

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

    def write(self, name: str, data: bytes) -> None:
        """Write a file completely or not at all.

        Raises
        ------
        DataError
            If it cannot be written.
        """
        write_file(self._whole(name), data)

    def remove(self, *names: str) -> None:
        """Remove files, and make that durable; those that are not there are left out.

        Raises
        ------
        DataError
            If one cannot be removed.
        """
        paths = [self._whole(name) for name in names]
        for path in paths:
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                raise write_failure(path, error) from error
        for folder in dict.fromkeys(path.parent for path in paths):
            try:
                if folder.is_dir():
                    sync_folder(folder)
            except OSError as error:
                raise write_failure(folder, error) from error

    def names(self, folder: str = "") -> list[str]:
        """Names of everything in a folder, sorted; those of temporary files are left out."""
        path = self._whole(folder) if folder else self.path
        try:
            return sorted(n for n in os.listdir(path) if not n.startswith("."))
        except (FileNotFoundError, NotADirectoryError):
            return []
        except OSError as error:
            raise DataError(f"{path}: cannot be listed: {error.strerror or error}") from error

    def make(self) -> None:
        """Make the folder.

        Raises
        ------
        DataError
            If that fails.
        """
        try:
            make_folder(self.path)
        except OSError as error:
            raise write_failure(self.path, error) from error
