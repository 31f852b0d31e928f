"""What is done in a shard, and by whom: its journal, and the logs of all processes that work there.

Each process claims a frame before it renders it and records it when its files are safe, in a log of its own. Claims
keep processes out of each other's way: two that render the same frame all the same write the same bytes.
"""

from __future__ import annotations

from typing import Any

from roundel.datasets.environment import Environment, key_of
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.schema import HeaderRecord, LogRecord, checked
from roundel.datasets.layout.shards import Shard
from roundel.datasets.store.folder import Folder, MissingFile
from roundel.datasets.store.log import Logs, OwnLog
from roundel.datasets.store.writing import clear_leftovers, sha256


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
        self, folder: Folder, shard: Shard, dataset_id: str, environments: dict[str, Environment] | None = None
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
        self._read_journal()
        self.refresh()
        self.notes += self._logs.cut()

    def _read_journal(self) -> None:
        place = self.folder.place(self.shard.name(files.JOURNAL))
        try:
            data = self.here.read(files.JOURNAL)
        except MissingFile:
            return
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
            place = self.folder.place(self.shard.name(f"log/{name}.jsonl"))
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

    def drop_damaged(self) -> list[int]:
        """Forget frames whose files are missing or altered; returns their ids. Such files are removed."""
        dropped = [i for i, entry in self.entries.items() if not self._is_whole(entry)]
        for i in dropped:
            self.here.remove(*self.entries.pop(i)["files"])
        return sorted(dropped)

    def _is_whole(self, entry: journal.Entry) -> bool:
        try:
            found = {name: self.here.read(name) for name in entry["files"]}
        except MissingFile:
            return False
        return all(
            len(found[name]) == listed["bytes"] and sha256(found[name]) == listed["sha256"]
            for name, listed in entry["files"].items()
        )

    def clear_leftovers(self) -> int:
        """Remove temporary files of processes that are gone; returns their number."""
        folders = [self.here.path, *(self.here.path / name for name in (files.IMAGES, files.RADIANCE, "log"))]
        return sum(clear_leftovers(folder) for folder in folders)

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
        return first == self._own.name or not self._logs.is_live(first)

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
        return any(self._logs.is_live(name) for name in self._claims.get(frame_id, ()) if name != own)

    def close(self) -> None:
        """Close the log of this process; it stays until the shard is finished."""
        if self._own is not None:
            self._own.close()
            self._own = None

    def remove_logs(self) -> None:
        """Remove the logs of all that work here no more: the shard is finished, and its journal says it all."""
        self.close()
        self._logs.remove_gone()
