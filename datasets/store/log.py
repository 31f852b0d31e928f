"""The log of one process, and the logs of all that work in a folder.

Each process appends to a file of its own, `log/OWNER-N.jsonl`, and holds a lock on it while it works: nobody else ever
writes there, and whether its owner still works is known on every host that shares the disk. The first record tells who
writes; each further one is appended and synced before it counts. What a torn record would have said has not happened.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from roundel.datasets.store.folder import Folder, MissingFile
from roundel.datasets.store.lock import try_lock
from roundel.datasets.store.owner import is_gone, is_name, own_name
from roundel.datasets.store.records import Record, line_of, record_of
from roundel.datasets.store.writing import make_folder, sync_folder, write_failure
from roundel.scenes.errors import DataError

FOLDER = "log"
LOG = "log"  # the key that tells a header: the version of the log's format
_SUFFIX = ".jsonl"
_count = itertools.count()


class OwnLog:
    """The log of this process in a folder.

    Parameters
    ----------
    folder : Folder
    header : dict
        What the first record tells beside its owner.

    Raises
    ------
    DataError
        If it cannot be written.
    """

    def __init__(self, folder: Folder, header: Record) -> None:
        # A process may work in a folder more than once.
        self.name = f"{own_name()}-{next(_count)}"
        self.path = Path(folder.sub(f"{FOLDER}/{self.name}{_SUFFIX}").path)
        self._file = self._opened()
        try_lock(self._file, exclusive=True, wait=True)
        self._size = 0
        try:
            self.append({LOG: 1, **header})
            sync_folder(self.path.parent)
        except OSError as error:
            self._drop()
            raise write_failure(self.path, error) from error
        except DataError:
            self._drop()
            raise

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

    def append(self, *records: Record, durable: bool = True) -> None:
        """Append records; if `durable`, they are on disk when this returns.

        Raises
        ------
        DataError
            If they cannot be written; a part that was is cut off.
        """
        data = "".join(line_of(record) + "\n" for record in records).encode()
        try:
            left = data
            while left:
                left = left[os.write(self._file, left) :]
            if durable:
                os.fsync(self._file)
        except OSError as error:
            try:
                os.ftruncate(self._file, self._size)
                os.lseek(self._file, self._size, os.SEEK_SET)
            except OSError:
                pass  # the torn record is told by its checksum
            raise write_failure(self.path, error) from error
        self._size += len(data)

    def _drop(self) -> None:
        """Give a log up that says nothing yet."""
        self.close()
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Give the lock back. The file stays: what it says is still needed."""
        os.close(self._file)


@dataclass
class _Followed:
    """A log as far as it was read."""

    at: int = 0
    header: Record | None = None
    rest: bytes = b""


@dataclass
class Logs:
    """All logs in a folder, read as they grow."""

    folder: Folder
    _known: dict[str, _Followed] = field(default_factory=dict)
    _cut: dict[str, int] = field(default_factory=dict)

    def names(self) -> list[str]:
        """Names of the logs, sorted."""
        found = [n.removesuffix(_SUFFIX) for n in self.folder.names(FOLDER) if n.endswith(_SUFFIX)]
        return [name for name in found if is_name(name.rpartition("-")[0])]

    def new_records(self) -> Iterator[tuple[str, Record, Record]]:
        """Records that were appended since the last call: the log's name, its header and the record.

        Raises
        ------
        DataError
            If a log cannot be read.
        """
        for name in self.names():
            log = self._known.setdefault(name, _Followed())
            try:
                data = self._read(name, log)
            except MissingFile:
                continue  # whoever has finished the shard removes the logs
            # A line that is not whole yet is read again.
            *lines, log.rest = (log.rest + data).split(b"\n")
            for line in lines:
                record = record_of(line)
                if record is None:
                    self._cut[name] = self._cut.get(name, 0) + 1
                elif LOG in record:
                    log.header = record
                elif log.header is not None:
                    yield name, log.header, record

    def _read(self, name: str, log: _Followed) -> bytes:
        data = self.folder.read(f"{FOLDER}/{name}{_SUFFIX}", start=log.at)
        log.at += len(data)
        return data

    def is_live(self, name: str) -> bool:
        """Whether the process of a log still works on it."""
        path = Path(self.folder.sub(f"{FOLDER}/{name}{_SUFFIX}").path)
        if is_gone(name.rpartition("-")[0]):
            return False
        try:
            descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
        except OSError:
            return False
        try:
            free = try_lock(descriptor, exclusive=False)
        finally:
            os.close(descriptor)
        return not free

    def cut(self) -> list[str]:
        """One sentence for each log of a gone process that has damaged records."""
        torn = {name for name, log in self._known.items() if log.rest and not self.is_live(name)}
        return [
            f"{self.folder.place(f'{FOLDER}/{name}{_SUFFIX}')}: a record was cut short or damaged and is left out; "
            "its frame is rendered again"
            for name in sorted(torn | set(self._cut))
        ]

    def remove_gone(self, own: str | None = None) -> None:
        """Remove the logs of processes that work on them no more, and `own`: all they say is kept elsewhere."""
        gone = [name for name in self.names() if name == own or not self.is_live(name)]
        self.folder.remove(*(f"{FOLDER}/{name}{_SUFFIX}" for name in gone))
        path = self.folder.path / FOLDER
        try:
            path.rmdir()
            sync_folder(self.folder.path)
        except OSError:
            pass  # not empty: others still work, or it is not there
