"""Finish a dataset: write its tables and, last, the manifest."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import pyarrow as pa
import yaml

from roundel.datasets.fidelity.summary import summarise
from roundel.datasets.flags import count_flags, flags_of_rows, marker_flags
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.truth_table import POINTS_SCHEMA, ROWS_SCHEMA, csv_bytes, parquet_bytes, truth_table
from roundel.datasets.numbers import check_numbers
from roundel.scenes.camera.model import camera_to_json
from roundel.scenes.camera.row_time import row_time_to_json
from roundel.scenes.markers.marker import Part
from roundel.scenes.study.identity import SAMPLING_VERSION
from roundel.scenes.study.study import Study
from roundel.scenes.truth.edge_points import edge_points_of
from roundel.scenes.truth.row_poses import row_poses_of
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import Frame, frames_of, total_frames

_PACKAGES = (
    "roundel",
    "mitsuba",
    "drjit",
    "numpy",
    "scipy",
    "opencv-contrib-python-headless",
    "pillow",
    "OpenEXR",
    "trimesh",
    "pyarrow",
)


def study_bytes(study: Study) -> bytes:
    """The resolved study as YAML."""
    sink = io.StringIO()
    yaml.safe_dump(study.resolved(), sink, sort_keys=False, width=120)
    return sink.getvalue().encode()


def versions() -> dict[str, str]:
    """Installed versions of the packages that the bytes of a dataset depend on."""
    found = {}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def _json(value: Any) -> bytes:
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


def finish_dataset(
    study: Study,
    dataset: Path,
    entries: dict[int, journal.Entry],
    environment: dict[str, Any],
    developed_from: str | None = None,
) -> None:
    """Write tables, cameras, sorted journal and, last, the manifest; the bytes do not depend on the order of work.

    `developed_from` is the dataset_id of the dataset whose radiance was developed; None for a rendered dataset.

    Raises
    ------
    DataError
        If a frame was rendered with other values than those that its truth would be computed from.
    """
    contents = _collect(study, dataset, entries)
    listed = _write(dataset, entries, _files_of(study, contents))
    manifest = _manifest(study, contents, entries, listed, environment)
    if developed_from is not None:
        manifest["developed_from"] = developed_from
    files.write_file(dataset / files.MANIFEST, _json(manifest))


@dataclass(frozen=True)
class _Contents:
    """Tables of all frames of a dataset: rows of the truth, cameras, poses by sensor row, points."""

    rows: list[dict[str, Any]]
    cameras: list[dict[str, Any]]
    row_poses: list[dict[str, Any]]
    points: dict[str, list[Any]]


def _collect(study: Study, dataset: Path, entries: dict[int, journal.Entry]) -> _Contents:
    """Place every frame again and compute its truth."""
    contents = _Contents([], [], [], {name: [] for name in POINTS_SCHEMA.names})
    for frame in frames_of(study):
        check_numbers(dataset, frame, entries.get(frame.frame_id))
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
    return contents


def _add_points(points: dict[str, list[Any]], frame: Frame, part: Part) -> None:
    xy = edge_points_of(frame, part)
    points["frame_id"] += [frame.frame_id] * len(xy)
    points["marker_id"] += [part.marker_id] * len(xy)
    points["x_px"] += xy[:, 0].tolist()
    points["y_px"] += xy[:, 1].tolist()


def _files_of(study: Study, contents: _Contents) -> dict[str, bytes]:
    """All files except those of the frames, the journal and the manifest."""
    table = truth_table(contents.rows)
    written = {
        files.STUDY: study_bytes(study),
        files.TRUTH: parquet_bytes(table),
        files.TRUTH_CSV: csv_bytes(table),
        files.CAMERAS: _json({"schema": 1, "frames": contents.cameras}),
    }
    if contents.row_poses:
        written[files.ROWS] = parquet_bytes(pa.Table.from_pylist(contents.row_poses, schema=ROWS_SCHEMA))
    if contents.points["frame_id"]:
        written[files.POINTS] = parquet_bytes(pa.table(contents.points, schema=POINTS_SCHEMA))
    return written


def _write(dataset: Path, entries: dict[int, journal.Entry], written: dict[str, bytes]) -> dict[str, dict[str, Any]]:
    """Write these files and the sorted journal; return checksums and sizes of all files of the dataset."""
    for name, data in written.items():
        files.write_file(dataset / name, data)
    journal.rewrite(dataset, entries)
    listed = {name: {"sha256": files.sha256(data), "bytes": len(data)} for name, data in written.items()}
    lines = (dataset / files.JOURNAL).read_bytes()
    listed[files.JOURNAL] = {"sha256": files.sha256(lines), "bytes": len(lines)}
    for entry in entries.values():
        listed.update(entry["files"])
    return listed


def _manifest(
    study: Study,
    contents: _Contents,
    entries: dict[int, journal.Entry],
    listed: dict[str, dict[str, Any]],
    environment: dict[str, Any],
) -> dict[str, Any]:
    measured = [m for i in sorted(entries) for m in entries[i]["fidelity"].values() if m]
    return {
        "schema": 1,
        "tool": "roundel",
        "name": study.name,
        "licence": study.licence,
        "study": study.resolved(),
        "study_sha256": listed[files.STUDY]["sha256"],
        "dataset_id": study.digest(),
        "sampling_version": SAMPLING_VERSION,
        "seed": study.seed,
        "versions": versions(),
        "environment": environment,
        "counts": {
            "frames": total_frames(study),
            "images": len(entries),
            "markers": len(contents.rows),
            "groups": {name: sum(c["group"] == name for c in contents.cameras) for name in study.groups},
            "flags": count_flags(flags_of_rows(contents.rows)),
        },
        "fidelity": summarise(measured),
        "files": dict(sorted(listed.items())),
    }
