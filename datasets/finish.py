"""Finish shards and the dataset: write tables, journal and records, and last the manifest.

The bytes depend on the study and the frames alone, not on who rendered what when: several processes may finish the
same shard at the same time.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from roundel.datasets.environment import Environment
from roundel.datasets.flags import marker_flags
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.developed import Developed
from roundel.datasets.layout.shards import Shard
from roundel.datasets.layout.truth_table import POINTS_SCHEMA, ROWS_SCHEMA, csv_bytes, parquet_bytes, truth_table
from roundel.datasets.numbers import check_numbers
from roundel.datasets.records import Rows, shard_record, slim
from roundel.datasets.store.records import document_of
from roundel.datasets.store.store import Listed, Store
from roundel.datasets.store.writing import sha256
from roundel.scenes.camera.model import camera_to_json
from roundel.scenes.camera.row_time import row_time_to_json
from roundel.scenes.errors import DataError
from roundel.scenes.markers.marker import Part
from roundel.scenes.study.study import Study
from roundel.scenes.truth.edge_points import edge_points_of
from roundel.scenes.truth.row_poses import row_poses_of
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import Frame, frames_of


def json_bytes(value: Any) -> bytes:
    """A value as a file of JSON; equal values give equal bytes."""
    return (json.dumps(value, indent=1, sort_keys=True) + "\n").encode()


def camera_record(frame: Frame, entry: journal.Entry | None) -> dict[str, Any]:
    """A frame's entry in cameras.json: what a solver may know, without pose or truth."""
    mode = frame.settings.mode
    record: dict[str, Any] = {"frame_id": frame.frame_id, "group": frame.group, "mode": mode}
    if mode == "images":
        record["image"] = files.image_name(frame.frame_id, frame.settings.sensor.image_suffix)
    if entry is not None and "sensor" in entry:
        record["sensor"] = entry["sensor"]
    record.update(camera_to_json(frame.camera))
    motion, prior = frame.settings.motion, frame.settings.motion.twist_prior
    declared = None if prior is None else (prior.velocity_sigma_m_s, prior.rate_sigma_deg_s)
    record.update(row_time_to_json(motion.readout_s, motion.exposure_s, declared))
    record["markers"] = [
        {
            "marker_id": part.marker_id,
            "kind": part.kind,
            "diameter_m": None if part.radius_m is None else 2 * part.radius_m,
            "layout": part.layout,
            **({} if part.size_m is None else {"size_m": list(part.size_m)}),
        }
        for view in frame.views()
        for part in view.sheet.parts
    ]
    return record


@dataclass(frozen=True)
class Frames:
    """The finished frames of a shard: journal lines, timings, and what made them."""

    entries: Mapping[int, journal.Entry]
    seconds: Mapping[int, Mapping[str, float]]
    environments: Mapping[str, Environment]


def finish_shard(
    study: Study, folder: Store, shard: Shard, done: Frames, developed: Developed | None = None
) -> dict[str, Any]:
    """Write the tables and the journal of a shard and, where there are several, its record.

    Frames with images that are not done are left out; it is complete if there are none.

    Parameters
    ----------
    study : Study
    folder : Store
        The dataset.
    shard : Shard
    done : Frames
    developed : Developed, optional
        Whose radiance was developed; None for a rendered dataset.

    Returns
    -------
    dict
        The record, where there are several shards `slim`.

    Raises
    ------
    DataError
        If a frame was rendered with other values than those that its truth would be computed from, or a file cannot
        be written.
    """
    here = folder.sub(shard.folder)
    contents, complete = _collect(study, folder, shard, done.entries)
    written = _tables(contents)
    written[files.JOURNAL] = journal.journal_bytes(done.entries.values())
    for name, data in written.items():
        here.write(name, data)
    _write_timings(here, done.seconds)
    listed: dict[str, dict[str, Any]] = {n: {"sha256": sha256(d), "bytes": len(d)} for n, d in written.items()}
    for entry in done.entries.values():
        listed.update(entry["files"])
    about = Rows(contents.cameras, contents.rows, done.entries, done.environments)
    record = shard_record(study.digest(), shard, complete, about, listed, developed)
    if not shard.folder:
        return record
    data = document_of(record)
    here.write(files.SHARD, data)
    return slim(record, Listed(len(data), sha256(data)))


@dataclass(frozen=True)
class _Contents:
    """Tables of the frames of a shard: rows of the truth, cameras, poses by sensor row, points."""

    rows: list[dict[str, Any]]
    cameras: list[dict[str, Any]]
    row_poses: list[dict[str, Any]]
    points: dict[str, list[Any]]


def _collect(study: Study, folder: Store, shard: Shard, entries: Mapping[int, journal.Entry]) -> tuple[_Contents, bool]:
    """Place every frame again and compute its truth; also whether no frame is missing."""
    contents = _Contents([], [], [], {name: [] for name in POINTS_SCHEMA.names})
    complete = True
    for frame in frames_of(study, shard.frames):
        if frame.settings.mode == "images" and frame.frame_id not in entries:
            complete = False
            continue
        check_numbers(str(folder), frame, entries.get(frame.frame_id))
        entry = entries.get(frame.frame_id, {})
        photometry = entry.get("photometry", {})
        parts = [(view, part) for view in frame.views() for part in view.sheet.parts]
        for (view, part), row in zip(parts, truth_of(frame), strict=True):
            contents.row_poses.extend(row_poses_of(view, part))
            flags = ",".join(marker_flags(entry.get("flags", ()), row["visible_fraction"]))
            contents.rows.append({**row, **photometry.get(str(part.marker_id), {}), "flags": flags})
            if frame.settings.mode == "points" and part.radius_m is not None:
                _add_points(contents.points, view, part)
        contents.cameras.append(camera_record(frame, entries.get(frame.frame_id)))
    return contents, complete


def _add_points(points: dict[str, list[Any]], frame: Frame, part: Part) -> None:
    xy = edge_points_of(frame, part)
    points["frame_id"] += [frame.frame_id] * len(xy)
    points["marker_id"] += [part.marker_id] * len(xy)
    points["x_px"] += xy[:, 0].tolist()
    points["y_px"] += xy[:, 1].tolist()


def _tables(contents: _Contents) -> dict[str, bytes]:
    table = truth_table(contents.rows)
    written = {
        files.TRUTH: parquet_bytes(table),
        files.TRUTH_CSV: csv_bytes(table),
        files.CAMERAS: json_bytes({"schema": 1, "frames": contents.cameras}),
    }
    if contents.row_poses:
        written[files.ROWS] = parquet_bytes(pa.Table.from_pylist(contents.row_poses, schema=ROWS_SCHEMA))
    if contents.points["frame_id"]:
        written[files.POINTS] = parquet_bytes(pa.table(contents.points, schema=POINTS_SCHEMA))
    return written


def _write_timings(here: Store, seconds: Mapping[int, Mapping[str, float]]) -> None:
    """Timings of the frames that have any, with those that are there already; they are in no checksum."""
    if seconds:
        whole = {**_old_timings(here), **seconds}
        lines = (json.dumps({**whole[i], "frame_id": i}, sort_keys=True) for i in sorted(whole))
        here.write(files.TIMINGS, "".join(f"{line}\n" for line in lines).encode())


def _old_timings(here: Store) -> dict[int, dict[str, float]]:
    try:
        records = [json.loads(line) for line in here.read(files.TIMINGS).splitlines()]
        return {int(record["frame_id"]): record for record in records}
    except (DataError, ValueError, KeyError, TypeError):
        return {}
