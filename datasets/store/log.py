"""The log of one process, and the logs of all that work in a folder.

Each process appends to a log of its own: nobody else ever writes there. The first record tells who writes; each
further one is appended and safe before it counts. What a torn record would have said has not happened.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from roundel.datasets.store.owner import is_name, own_name
from roundel.datasets.store.records import Record, line_of, record_of
from roundel.datasets.store.store import MissingFile, Store
from roundel.scenes.errors import DataError

LOG = "log"  # the key that tells a header: the version of the log's format
_count = itertools.count()

# A process of which nothing else is known counts as working for this long without news; no clock is compared with
# that of another machine.
LEASE_S = 120.0


class OwnLog:
    """The log of this process in a folder.

    Parameters
    ----------
    folder : Store
    header : dict
        What the first record tells beside its owner.

    Raises
    ------
    DataError
        If it cannot be written.
    """

    def __init__(self, folder: Store, header: Record) -> None:
        # A process may work in a folder more than once.
        self.name = f"{own_name()}-{next(_count)}"
        self._file = folder.logs().create(self.name)
        try:
            self.append({LOG: 1, **header})
        except DataError:
            self._file.drop()
            raise

    def append(self, *records: Record, durable: bool = True) -> None:
        """Append records; if `durable`, they are safe when this returns.

        Raises
        ------
        DataError
            If they cannot be written; a part that was is cut off.
        """
        self._file.append("".join(line_of(record) + "\n" for record in records).encode(), durable)

    def close(self) -> None:
        """End the log. The file stays: what it says is still needed."""
        self._file.close()


@dataclass
class _Followed:
    """A log as far as it was read, and when it last grew."""

    at: int = 0
    header: Record | None = None
    rest: bytes = b""
    heard_s: float = field(default_factory=time.monotonic)


class Logs:
    """All logs in a folder, read as they grow."""

    def __init__(self, folder: Store) -> None:
        self._files = folder.logs()
        self._known: dict[str, _Followed] = {}
        self._cut: dict[str, int] = {}

    def new_records(self) -> Iterator[tuple[str, Record, Record]]:
        """Records that were appended since the last call: the log's name, its header and the record.

        Raises
        ------
        DataError
            If a log cannot be read.
        """
        for name, length in self._lengths().items():
            log = self._known.setdefault(name, _Followed())
            if length <= log.at:
                continue
            try:
                data = self._files.read(name, log.at, length)
            except MissingFile:
                continue  # whoever has finished the shard removes the logs
            log.at, log.heard_s = length, time.monotonic()
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

    def _lengths(self) -> dict[str, int]:
        return {name: n for name, n in self._files.lengths().items() if is_name(name.rpartition("-")[0])}

    def is_live(self, name: str, lease_s: float = LEASE_S) -> bool:
        """Whether the process of a log still works on it, as far as can be told.

        Where nothing tells, and of a process that may hang, news is waited for `lease_s` seconds.
        """
        log = self._known.get(name)
        if log is not None and time.monotonic() - log.heard_s > lease_s:
            return False
        return self._files.works(name) is not False

    def place(self, name: str) -> str:
        """A log's address, for messages."""
        return self._files.place(name)

    def cut(self) -> list[str]:
        """One sentence for each log of a gone process that has damaged records."""
        torn = {name for name, log in self._known.items() if log.rest and not self.is_live(name)}
        return [
            f"{self._files.place(name)}: a record was cut short or damaged and is left out; its frame is rendered again"
            for name in sorted(torn | set(self._cut))
        ]

    def remove_gone(self) -> None:
        """Remove logs, but for those of processes that certainly still work: all they say is kept elsewhere.

        A process whose log is gone removes at its end what it has appended since.
        """
        self._files.remove([name for name in self._lengths() if not self._files.works(name)])
