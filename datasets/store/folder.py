"""A folder of a disk with confined names: what is read is a regular file of bounded size, below the folder.

A dataset may come from anywhere. Names in its records are relative and never lead out of the folder; links, pipes and
devices are refused; the size is known before the first byte is read.
"""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from roundel.datasets.store.lock import one_at_a_time
from roundel.datasets.store.log_files import FolderLogs
from roundel.datasets.store.store import MOST_BYTES, LogFiles, MissingFile, Store
from roundel.datasets.store.writing import (
    clear_leftovers,
    leftovers,
    link_file,
    make_folder,
    sync_folder,
    write_failure,
    write_file,
)
from roundel.scenes.errors import DataError

_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)

_LOCK = ".lock"


@dataclass(frozen=True)
class Folder(Store):
    """A folder on disk."""

    path: Path

    decays = True
    poll_s = 0.2

    def __str__(self) -> str:
        return str(self.path)

    def address(self) -> str:
        """The address for other processes, in whichever folder they work."""
        return str(self.path.resolve())

    def absence(self) -> str:
        """What is there instead of a folder, in words; empty if it is there."""
        if self.path.is_dir():
            return ""
        return "it is a file; a dataset is a folder" if self.path.exists() else "there is no such folder"

    def is_occupied(self) -> bool:
        """Whether anything is there, other than temporary files."""
        return self.path.is_dir() and any(
            not (p.name.endswith(".part") or p.name == _LOCK) for p in self.path.iterdir()
        )

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
        whole = self.path
        for part in self.checked_name(name).split("/")[:-1]:
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

    def sizes(self, folder: str = "") -> dict[str, int]:
        """Bytes of the regular files of a folder, by name within it; temporary files are left out."""
        path = self._whole(folder) if folder else self.path
        try:
            with os.scandir(path) as entries:
                found = [e for e in entries if not e.name.startswith(".") and e.is_file(follow_symlinks=False)]
                return {entry.name: entry.stat(follow_symlinks=False).st_size for entry in found}
        except (FileNotFoundError, NotADirectoryError):
            return {}
        except OSError as error:
            raise DataError(f"{path}: cannot be listed: {error.strerror or error}") from error

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

    def write(self, name: str, data: bytes) -> None:
        """Write a file completely or not at all.

        Raises
        ------
        DataError
            If it cannot be written.
        """
        write_file(self._whole(name), data)

    def write_new(self, name: str, data: bytes) -> bool:
        """Likewise, unless somebody else has written another one: False.

        Raises
        ------
        DataError
            If it cannot be written.
        """
        with self.alone():
            if self.size(name) is not None:
                return self.read(name) == data
            self.write(name, data)
        return True

    def take(self, name: str, source: Store, theirs: str) -> None:
        """Link a file of another folder, which never changes, or copy it.

        Raises
        ------
        DataError
            If it cannot be read or written.
        """
        if isinstance(source, Folder):
            link_file(source._whole(theirs), self._whole(name))
        else:
            self.write(name, source.read(theirs))

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

    def discard(self, *names: str) -> None:
        """Remove files and links that a listing gave, whatever their names; `leftovers` are among them."""
        for name in names:
            (self.path / name).unlink(missing_ok=True)

    def names(self, folder: str = "") -> list[str]:
        """Names of everything in a folder, sorted; those of temporary files are left out."""
        path = self._whole(folder) if folder else self.path
        try:
            return sorted(n for n in os.listdir(path) if not n.startswith("."))
        except (FileNotFoundError, NotADirectoryError):
            return []
        except OSError as error:
            raise DataError(f"{path}: cannot be listed: {error.strerror or error}") from error

    def leftovers(self, folder: str = "") -> list[str]:
        """Temporary files in a folder, of all processes, by name within it."""
        return [path.name for path in leftovers(self.path / folder)]

    def clear_leftovers(self, *folders: str) -> None:
        """Remove those of processes that are gone, and their lock; without folders, in this one."""
        for folder in folders or ("",):
            clear_leftovers(self.path / folder)
            if (self.path / folder / _LOCK).exists():
                with one_at_a_time(self.path / folder / _LOCK):
                    pass  # it goes at the end of the block

    def alone(self) -> AbstractContextManager[None]:
        """A block that one process at a time is in; the others wait."""
        return one_at_a_time(self.path / _LOCK)

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

    def logs(self) -> LogFiles:
        """The logs in this folder."""
        return FolderLogs(self)

    @contextmanager
    def on_disk(self, name: str, data: bytes) -> Iterator[Path]:
        """The file itself where it has these bytes; else a temporary one beside it."""
        path = self._whole(name)
        if self.size(name) == len(data) and self.read(name) == data:
            yield path
            return
        # Beside the files that it may name.
        other = path.with_name(f".{name}.{secrets.token_hex(4)}{path.suffix}")
        try:
            write_file(other, data)
            yield other
        finally:
            other.unlink(missing_ok=True)
