"""What is done in a shard, and by whom: its journal, and the logs of all processes that work there.

Each process claims a frame before it renders it and records it when its files are safe, in a log of its own. Claims
keep processes out of each other's way: two that render the same frame all the same write the same bytes. So a claim
holds as long as its process runs, but not longer than some frames take without news of it: it may hang.
"""

from __future__ import annotations

from typing import Any

from roundel.datasets.environment import Environment, key_of
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.schema import HeaderRecord, LogRecord, checked
from roundel.datasets.layout.shards import Shard
from roundel.datasets.store.log import LEASE_S, Logs, OwnLog
from roundel.datasets.store.store import MissingFile, Store
from roundel.datasets.store.writing import sha256

# A claim holds without news for this many times the longest frame, and for two minutes at least.
_PATIENCE = 10


class ShardProgress:
    """The state of a shard, as far as it was read.

    Attributes
    ----------
    entries : dict
        Journal lines of finished frames, by frame id.
    seconds : dict
        Their timings, where a log has them.
    environments : dict
        What made them, by key.
    mixed : bool
        Whether a process was told that environments may be mixed.
    """

    def __init__(
        self, folder: Store, shard: Shard, dataset_id: str, environments: dict[str, Environment] | None = None
    ) -> None:
        self.folder, self.shard, self.dataset_id = folder, shard, dataset_id
        self.here = folder.sub(shard.folder)
        self.entries: dict[int, journal.Entry] = {}
        self.seconds: dict[int, dict[str, float]] = {}
        self.environments = dict(environments or {})
        self.mixed = False
        self.notes: list[str] = []
        self._logs = Logs(self.here)
        self._claims: dict[int, set[str]] = {}
        self._own: OwnLog | None = None
        self._lease_s = LEASE_S
        self._journal_bytes: int | None = None
        self._read_journal()
        self.refresh()
        self.notes += self._logs.cut()

    def _read_journal(self) -> None:
        place = self.folder.place(self.shard.name(files.JOURNAL))
        try:
            data = self.here.read(files.JOURNAL)
        except MissingFile:
            return
        self._journal_bytes = len(data)
        self.entries, damaged = journal.entries_of(data, place)
        if len(self.environments) == 1:
            # Lines of version 1 do not say what made them: the manifest does, of all.
            for entry in self.entries.values():
                entry.setdefault("environment", next(iter(self.environments)))
        if damaged:
            self.notes.append(f"{place}: {damaged} damaged lines are left out; their frames are rendered again")

    def refresh(self) -> None:
        """Read what was recorded since the last time."""
        for name, header, record in self._logs.new_records():
            place = self._logs.place(name)
            about = checked(HeaderRecord, header, place)
            found = checked(LogRecord, record, place)
            if about.dataset_id != self.dataset_id:
                continue
            if found.claim is not None:
                self._claims.setdefault(found.claim, set()).add(name)
            if found.entry is not None:
                key = key_of(header["environment"])
                self.entries[found.entry.frame_id] = {**record["entry"], "environment": key}
                self.environments[key] = header["environment"]
                self.mixed |= about.mix
                self.seconds[found.entry.frame_id] = found.seconds
                self._claims.get(found.entry.frame_id, set()).discard(name)
                self._lease_s = max(self._lease_s, _PATIENCE * sum(found.seconds.values()))

    def is_outdated(self) -> bool:
        """Whether somebody has written a journal since it was read here; logs that it was made of may be gone."""
        return self.here.size(files.JOURNAL) != self._journal_bytes

    def drop_damaged(self) -> list[int]:
        """Forget frames whose files are missing or altered; returns their ids. Such files are removed."""
        sizes = self.sizes()
        dropped = [i for i, entry in self.entries.items() if not self._is_whole(entry, sizes)]
        for i in dropped:
            self.here.remove(*self.entries.pop(i)["files"])
        return sorted(dropped)

    def drop_incomplete(self) -> list[int]:
        """Forget frames of which a file is missing or has another size than was recorded; returns their ids."""
        sizes = self.sizes()
        gone = [i for i, e in self.entries.items() if any(sizes.get(n) != f["bytes"] for n, f in e["files"].items())]
        for i in gone:
            del self.entries[i]
        return gone

    def sizes(self) -> dict[str, int]:
        """Bytes of the files of frames, by name within the shard."""
        return {f"{sub}/{n}": size for sub in files.OF_FRAMES for n, size in self.here.sizes(sub).items()}

    def _is_whole(self, entry: journal.Entry, sizes: dict[str, int]) -> bool:
        if any(sizes.get(name) != listed["bytes"] for name, listed in entry["files"].items()):
            return False
        if not self.here.decays:
            return True
        try:
            found = {name: self.here.read(name) for name in entry["files"]}
        except MissingFile:
            return False
        return all(
            len(found[name]) == listed["bytes"] and sha256(found[name]) == listed["sha256"]
            for name, listed in entry["files"].items()
        )

    def clear_leftovers(self) -> None:
        """Remove temporary files of processes that are gone."""
        self.here.clear_leftovers("", *files.OF_FRAMES, "log")

    def is_done(self, frame_id: int) -> bool:
        """Whether a frame is recorded and its files are there, with their recorded sizes."""
        entry = self.entries.get(frame_id)
        return entry is not None and journal.is_done(self.folder, self.shard, entry)

    def start(self, environment: Environment, mix: bool = False) -> None:
        """Open the log of this process.

        Raises
        ------
        DataError
            If it cannot be written.
        """
        if self._own is None:
            about: dict[str, Any] = {"dataset_id": self.dataset_id, "environment": environment, "mix": mix}
            self._own = OwnLog(self.here, about)
            self.environments[key_of(environment)] = environment

    def claim(self, frame_id: int) -> bool:
        """Whether the frame is free: neither done nor claimed by another process that still works; it is ours then."""
        assert self._own is not None, "start first"
        self.refresh()
        if self.is_done(frame_id) or self.is_claimed(frame_id):
            return False
        self._own.append({"claim": frame_id}, durable=False)
        self.refresh()
        # Of two that claimed it in the same moment the first by name goes on; should both, they write the same bytes.
        first = min(self._claims[frame_id])
        return first == self._own.name or not self._logs.is_live(first, self._lease_s)

    def record(self, entry: journal.Entry, seconds: dict[str, float]) -> None:
        """Record a finished frame, whose files are safely on disk.

        Raises
        ------
        DataError
            If it cannot be written.
        """
        assert self._own is not None, "start first"
        self._own.append({"entry": entry, "seconds": {k: round(v, 4) for k, v in seconds.items()}})

    def is_claimed(self, frame_id: int) -> bool:
        """Whether another process that still works has claimed the frame."""
        own = None if self._own is None else self._own.name
        return any(self._logs.is_live(name, self._lease_s) for name in self._claims.get(frame_id, ()) if name != own)

    def close(self) -> None:
        """Close the log of this process; it stays until the shard is finished."""
        if self._own is not None:
            self._own.close()
            self._own = None

    def remove_logs(self) -> None:
        """Remove the logs of all that work here no more: the shard is finished, and its journal says it all."""
        self.close()
        self._logs.remove_gone()
