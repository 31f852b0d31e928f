"""Fetch a dataset, or some of its frames, from wherever it is; what comes is held against its checksums.

A whole dataset comes byte for byte. A part has the rows and journal lines of its frames, and records of its own.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from roundel.datasets.finish import json_bytes
from roundel.datasets.index import finishing
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.camera_records import CameraRecords
from roundel.datasets.layout.contents import Contents, Part, read_contents
from roundel.datasets.layout.developed import developed_of
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.layout.schema import ManifestRecord
from roundel.datasets.layout.shards import Shard
from roundel.datasets.layout.truth_table import csv_bytes, parquet_bytes
from roundel.datasets.records import IDENTITY, Rows, manifest_record, shard_record, slim
from roundel.datasets.resume import recorded_environments
from roundel.datasets.store.addresses import Address, store_at
from roundel.datasets.store.records import document_of, record_of_document
from roundel.datasets.store.store import Listed, Store
from roundel.datasets.store.writing import sha256
from roundel.scenes.errors import DataError, NotComparableError, UsageError

Progress = Callable[[int, int], None]

# Requests at the same time.
_TOGETHER = 16

_TABLES = (files.TRUTH, files.POINTS, files.ROWS)
_REMEDY = "pull it again; if that does not help, it is damaged where it comes from"


@dataclass
class Pulled:
    """What is there after a pull: frames, of how many, and files that were fetched."""

    frames: int = 0
    total: int = 0
    fetched: int = 0
    complete: bool = False


@dataclass
class _Pull:
    """A pull as it goes on."""

    source: Contents
    manifest: dict[str, Any]
    out: Store
    progress: Progress | None
    pulled: Pulled = field(default_factory=Pulled)


def pull_dataset(
    address: Address, out: Address, frames: range | None = None, progress: Progress | None = None
) -> Pulled:
    """Fetch a dataset, or some of its frames; what is there already stays.

    Parameters
    ----------
    address : path or str
        A finished dataset: a folder, an address in an object store, or of a web server.
    out : path or str
        A new or empty folder, or one that holds frames of the same dataset.
    frames : range, optional
        Only these frame ids, beside those that are there.
    progress : callable, optional
        Called with (frames done, total frames).

    Raises
    ------
    UsageError
        If there is no such frame, or `out` holds something else.
    NotComparableError
        If `out` holds another dataset.
    DataError
        If something is missing or damaged, or a file cannot be written. The same call continues.
    """
    store, target = store_at(address), store_at(out)
    if store.address() == target.address():
        raise UsageError(f"{out}: is the dataset itself; name another folder")
    contents = read_contents(store)
    manifest, record = read_manifest(store)
    if frames is not None and record.schema_ == 1:
        raise UsageError(f"{address}: is of an older version of Roundel; pull it whole, without --frames")
    if frames is not None and record.reference is not None:
        raise UsageError(f"{address}: holds imported photographs; pull them all, without --frames")
    work = _Pull(contents, manifest, target, progress)
    wanted = {part: ids for part in contents.parts if (ids := _wanted(work, part, frames)) is None or ids}
    if frames is not None and not any(_has(part, ids, frames) for part, ids in wanted.items()):
        raise UsageError(f"--frames {frames.start}:{frames.stop}: the dataset has no such frame")
    _prepare(target, record, store.read_checked(files.STUDY, contents.own[files.STUDY], _REMEDY))
    work.pulled.total = sum(part.frames if ids is None else len(ids) for part, ids in wanted.items())
    shards = [(part.shard, _pull_part(work, part, ids)) for part, ids in wanted.items()]
    whole = len(shards) == len(contents.parts) and all(ids is None for ids in wanted.values())
    data = store.read(files.MANIFEST) if whole else document_of(_part_of_manifest(work, shards))
    with finishing(target):
        if _differs(target, files.MANIFEST, data):
            target.write(files.MANIFEST, data)
    work.pulled.complete = whole and contents.complete
    return work.pulled


def _has(part: Part, ids: set[int] | None, frames: range) -> bool:
    return any(i in frames for i in (part.shard.frames if ids is None else ids))


def _part_of_manifest(work: _Pull, shards: list[tuple[Shard, dict[str, Any]]]) -> dict[str, Any]:
    """The manifest over some frames of a dataset."""
    own = {name: work.manifest[name] for name in ("environment", "versions")}
    identity = {name: work.manifest[name] for name in IDENTITY if name in work.manifest}
    return manifest_record(identity, work.source.own[files.STUDY], shards, work.source.frames, own)


def _prepare(target: Store, source: ManifestRecord, study: bytes) -> None:
    """Check that the target is free for this dataset, and begin it."""
    if target.size(files.MANIFEST) is not None:
        there = read_manifest(target)[1]
        if there.dataset_id != source.dataset_id or there.developed_from != source.developed_from:
            raise NotComparableError(
                f"{target}: holds another dataset ({there.dataset_id[:12]}, not {source.dataset_id[:12]}); name "
                "another folder"
            )
    elif target.size(files.STUDY) is None and target.is_occupied():
        raise UsageError(f"{target}: is not empty and not a dataset; name another folder")
    if not target.write_new(files.STUDY, study):
        raise UsageError(f"{target}: holds another study; name another folder")


def _wanted(work: _Pull, part: Part, frames: range | None) -> set[int] | None:
    """Ids of the frames of a shard that are asked for, or are there already; None if these are all of it."""
    if frames is None:
        return None
    before = _ids_there(work.out.sub(part.shard.folder))
    if not before and part.shard.folder and not _overlap(part.shard.frames, frames):
        return set()  # without asking for its record
    records = CameraRecords(work.source).of_part(work.source.parts.index(part))
    ids = {i for i in (int(record["frame_id"]) for record in records) if i in frames or i in before}
    return None if len(ids) == part.frames else ids


def _overlap(a: range, b: range) -> bool:
    return a.start < b.stop and b.start < a.stop


def _ids_there(here: Store) -> set[int]:
    """Ids of the frames that a target lists."""
    try:
        return {int(record["frame_id"]) for record in json.loads(here.read(files.CAMERAS))["frames"]}
    except (DataError, ValueError, KeyError, TypeError):
        return set()


def _pull_part(work: _Pull, part: Part, ids: set[int] | None) -> dict[str, Any]:
    """Fetch frames of a shard and write its tables; returns its record, `slim` where there are several."""
    contents, here = work.source, work.out.sub(part.shard.folder)
    listed = {name: its for name, its in contents.files_of(part).items() if name != files.STUDY}
    tables, record = _tables(work, part, ids, listed)
    pictures = [name for name in record["files"] if name not in tables]
    _fetch(work, part, pictures, listed, part.frames if ids is None else len(ids))
    with finishing(work.out):
        # Until the new manifest is there, nobody reads new tables by the old one.
        if any(_differs(here, name, data) for name, data in tables.items()):
            work.out.remove(files.MANIFEST)
            for name, data in tables.items():
                here.write(name, data)
    for sub in files.OF_FRAMES:
        extra = [f"{sub}/{name}" for name in here.names(sub) if f"{sub}/{name}" not in record["files"]]
        here.remove(*extra)
    if not part.shard.folder:
        return record
    data = tables[files.SHARD]
    return slim(record, Listed(len(data), sha256(data)))


def _differs(here: Store, name: str, data: bytes) -> bool:
    return here.size(name) != len(data) or here.read(name) != data


def _fetch(work: _Pull, part: Part, names: list[str], listed: dict[str, Listed], frames: int) -> None:
    """Fetch the files of frames that are not there yet, several at a time."""
    here, before = work.out.sub(part.shard.folder), work.pulled.frames
    sizes = {f"{sub}/{n}": size for sub in files.OF_FRAMES for n, size in here.sizes(sub).items()}

    def fetch(name: str) -> int:
        its = listed[name]
        if sizes.get(name) == its.bytes and sha256(here.read(name)) == its.sha256:
            return 0
        here.write(name, work.source.read(part, name, _REMEDY))
        return 1

    with ThreadPoolExecutor(_TOGETHER) as pool:
        for number, fetched in enumerate(pool.map(fetch, names), start=1):
            work.pulled.fetched += fetched
            if work.progress:
                work.progress(before + number * frames // len(names), work.pulled.total)
    work.pulled.frames = before + frames
    if work.progress and not names:
        work.progress(work.pulled.frames, work.pulled.total)


def _tables(
    work: _Pull, part: Part, ids: set[int] | None, listed: dict[str, Listed]
) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Tables, journal and record of frames of a shard: as they are, if these are all."""
    contents, shard = work.source, part.shard
    own = [n for n in listed if not files.is_of_a_frame(n)]
    found = {name: contents.read(part, name, _REMEDY) for name in own}
    if ids is None:
        if part.listed is None:
            return found, {"files": listed}
        found[files.SHARD] = contents.folder.read_checked(shard.name(files.SHARD), part.listed, _REMEDY)
        return found, record_of_document(found[files.SHARD])
    place = contents.folder.place(shard.name(files.JOURNAL))
    entries = {i: e for i, e in journal.entries_of(found[files.JOURNAL], place)[0].items() if i in ids}
    cameras = [record for record in json.loads(found[files.CAMERAS])["frames"] if record["frame_id"] in ids]
    tables = {name: _of_frames(found[name], ids) for name in _TABLES if name in found}
    written = {name: parquet_bytes(table) for name, table in tables.items() if table.num_rows}
    written[files.TRUTH] = parquet_bytes(tables[files.TRUTH])
    written[files.TRUTH_CSV] = csv_bytes(tables[files.TRUTH])
    written[files.CAMERAS] = json_bytes({"schema": 1, "frames": cameras})
    written[files.JOURNAL] = journal.journal_bytes(entries.values())
    mine = {name: {"sha256": sha256(data), "bytes": len(data)} for name, data in written.items()}
    for entry in entries.values():
        mine.update(entry["files"])
    truth = tables[files.TRUTH].select(["frame_id", "marker_id", "flags"]).to_pylist()
    rows = Rows(cameras, truth, entries, recorded_environments(contents.folder, shard))
    developed = developed_of(work.manifest)
    record = shard_record(contents.dataset_id, shard, False, rows, mine, developed)
    if shard.folder:
        written[files.SHARD] = document_of(record)
    return written, record


def _of_frames(data: bytes, ids: set[int]) -> pa.Table:
    table = pq.ParquetFile(pa.BufferReader(data)).read(use_threads=False)
    return table.filter(pc.is_in(table["frame_id"], pa.array(sorted(ids), table["frame_id"].type)))
