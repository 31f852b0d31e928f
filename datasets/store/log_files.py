"""Logs in a folder of a disk: a file each, to which its process appends, and which it locks while it works."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from roundel.datasets.store.lock import try_lock
from roundel.datasets.store.owner import is_gone
from roundel.datasets.store.store import LOG, LogFile, LogFiles
from roundel.datasets.store.writing import make_folder, sync_folder, write_failure

if TYPE_CHECKING:
    from roundel.datasets.store.folder import Folder

_SUFFIX = ".jsonl"


class _LogOnDisk(LogFile):
    """A file that is locked; the system gives the lock back when the process ends, however it ends."""

    def __init__(self, path: Path) -> None:
        self.path, self._size = path, 0
        self._file = self._opened()
        try_lock(self._file, exclusive=True, wait=True)

    def _opened(self) -> int:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        while True:
            try:
                make_folder(self.path.parent)
                return os.open(self.path, flags, 0o666)
            except FileNotFoundError:
                continue  # whoever has finished the shard removed the folder in this moment
            except OSError as error:
                raise write_failure(self.path, error) from error

    def append(self, data: bytes, durable: bool) -> None:
        """Append whole lines; a part of them that was written before an error is cut off."""
        try:
            left = data
            while left:
                left = left[os.write(self._file, left) :]
            if durable:
                os.fsync(self._file)
            if not self._size:
                sync_folder(self.path.parent)
        except OSError as error:
            try:
                os.ftruncate(self._file, self._size)
                os.lseek(self._file, self._size, os.SEEK_SET)
            except OSError:
                pass  # the torn record is told by its checksum
            raise write_failure(self.path, error) from error
        self._size += len(data)

    def close(self) -> None:
        """Give the lock back."""
        os.close(self._file)

    def drop(self) -> None:
        """Remove the file."""
        self.close()
        self.path.unlink(missing_ok=True)


class FolderLogs(LogFiles):
    """The logs in a folder; a length is a number of bytes."""

    def __init__(self, folder: Folder) -> None:
        self.folder = folder

    def _name(self, name: str) -> str:
        return f"{LOG}/{name}{_SUFFIX}"

    def _path(self, name: str) -> Path:
        return Path(self.folder.sub(self._name(name)).path)

    def lengths(self) -> dict[str, int]:
        """Bytes of each log."""
        found = self.folder.sizes(LOG)
        return {n.removesuffix(_SUFFIX): found[n] for n in sorted(found) if n.endswith(_SUFFIX)}

    def read(self, name: str, start: int, stop: int) -> bytes:
        """The bytes between two lengths."""
        return self.folder.read(self._name(name), start=start)[: stop - start]

    def create(self, name: str) -> LogFile:
        """A new log, locked."""
        return _LogOnDisk(self._path(name))

    def works(self, name: str) -> bool | None:
        """Whether the process of a log still works on it; None where the file system has no locks."""
        if is_gone(name.rpartition("-")[0]):
            return False
        try:
            descriptor = os.open(self._path(name), os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
        except OSError:
            return False
        try:
            free = try_lock(descriptor, exclusive=False)
        finally:
            os.close(descriptor)
        return None if free is None else not free

    def remove(self, names: list[str]) -> None:
        """Remove logs, and the folder if it is empty then."""
        self.folder.remove(*(self._name(name) for name in names))
        path = self.folder.path / LOG
        try:
            path.rmdir()
            sync_folder(self.folder.path)
        except OSError:
            pass  # not empty: others still work, or it is not there

    def place(self, name: str) -> str:
        """A log's address, for messages."""
        return self.folder.place(self._name(name))
