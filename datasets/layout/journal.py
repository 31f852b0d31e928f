"""The journal of a finished shard: one line per frame, sorted, each with a checksum of its own."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from roundel.datasets.layout.schema import EntryRecord, checked
from roundel.datasets.layout.shards import Shard
from roundel.datasets.store.records import line_of, record_of
from roundel.datasets.store.store import Store
from roundel.scenes.errors import DataError

Entry = dict[str, Any]


def journal_bytes(entries: Iterable[Entry]) -> bytes:
    """The journal, sorted by frame, so that its bytes do not depend on the order of rendering."""
    return "".join(line_of(entry) + "\n" for entry in sorted(entries, key=lambda e: e["frame_id"])).encode()


def entries_of(data: bytes, place: str) -> tuple[dict[int, Entry], int]:
    """Entries of a journal by frame id, and the number of damaged lines, which are left out.

    Raises
    ------
    DataError
        If a whole line is not a finished frame.
    """
    entries, damaged = {}, 0
    for number, line in enumerate(data.split(b"\n"), start=1):
        if not line:
            continue
        entry = record_of(line)
        if entry is not None:
            checked(EntryRecord, entry, f"{place}:{number}")
        else:
            entry = _old(line)
        if entry is None:
            damaged += 1
            continue
        entries[int(entry["frame_id"])] = entry
    return entries, damaged


def is_old(line: bytes) -> bool:
    """Whether a line is of version 1."""
    return record_of(line) is None and _old(line) is not None


def _old(line: bytes) -> Entry | None:
    """A line of version 1, which has no checksum; None if it is none."""
    try:
        entry = json.loads(line)
        checked(EntryRecord, entry, "")
    except (ValueError, RecursionError, DataError):
        return None
    return entry if isinstance(entry, dict) else None


def is_done(folder: Store, shard: Shard, entry: Entry) -> bool:
    """Whether all files of the entry exist with the recorded sizes."""
    return all(folder.size(shard.name(name)) == record["bytes"] for name, record in entry["files"].items())
