"""`roundel develop`: re-expose a dataset's radiance with another sensor, without rendering."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.finish import finish_dataset
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.images import open_images
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.layout.radiance import Planes, encode_radiance, read_radiance, rounded
from roundel.datasets.numbers import check_numbers
from roundel.datasets.resume import backend_of, prepare, record, reopen
from roundel.render.frame_files import entry_of, image_file, write_frame
from roundel.render.sensor.develop import develop
from roundel.scenes.errors import DataError, UsageError
from roundel.scenes.study.sensor_file import study_with_sensor
from roundel.scenes.study.study import Study, load_study
from roundel.scenes.world.frame import Frame, frame_of, group_ranges


def _source_study(dataset: Path, manifest: dict[str, Any]) -> Study:
    """The study of a finished dataset in which every frame has its radiance."""
    study = load_study(dataset / files.STUDY)
    # Compare file checksums: the computation of a dataset_id may change between versions.
    if files.sha256((dataset / files.STUDY).read_bytes()) != manifest.get("study_sha256"):
        raise DataError(f"{dataset / files.STUDY}: is not the study of this dataset; restore it")
    rendered = {name: group for name, group in study.groups.items() if group.mode == "images"}
    if not rendered:
        raise UsageError(f"{dataset}: has points but no images; there is nothing to develop")
    for name, group in rendered.items():
        if not group.render.radiance:
            raise UsageError(
                f"{dataset}: group {name} was rendered without its radiance; render it with render.radiance: true"
            )
    return study


def _checked_radiance(dataset: Path, entry: journal.Entry) -> Planes:
    """A frame's planes; the file must match its journal line."""
    name = files.radiance_name(entry["frame_id"])
    path = dataset / name
    planes = read_radiance(path)
    if name not in entry["files"] or files.sha256(path.read_bytes()) != entry["files"][name]["sha256"]:
        raise DataError(f"{path}: differs from what was rendered; delete it and run `roundel render` again")
    return planes


def _develop_frame(
    source: Path, old: journal.Entry, before: Frame, frame: Frame, out: Path
) -> tuple[journal.Entry, dict[str, float]]:
    clock = [time.perf_counter()]
    same = before.settings.model_dump(exclude={"sensor"}) == frame.settings.model_dump(exclude={"sensor"})
    if not same or not np.array_equal(before.camera_from_sheet, frame.camera_from_sheet):
        raise UsageError(
            f"frame {frame.frame_id}: distributions in this sensor would redraw its other values; give numbers instead"
        )
    check_numbers(source, before, old)
    planes = _checked_radiance(source, old)
    developed = develop(frame, planes["Y"])
    noise = developed.noise_dn()
    written = image_file(frame, developed)
    name = files.radiance_name(frame.frame_id)
    # Only the noise plane depends on the sensor; if it is equal, both datasets share the file.
    kept = np.array_equal(planes.get("noise_dn", np.empty(0)), rounded("noise_dn", noise))
    if not kept:
        written[name] = encode_radiance(planes | {"noise_dn": noise})
    clock.append(time.perf_counter())
    listed = write_frame(out, written)
    if kept:
        files.link_file(source / name, out / name)
        listed[name] = old["files"][name]
    clock.append(time.perf_counter())
    entry = entry_of(frame, developed, planes, old["fidelity"], listed, backend_of(old))
    encode, write = np.diff(clock)
    return entry, {"encode_s": float(encode), "write_s": float(write)}


def develop_dataset(
    dataset: str | Path,
    out: str | Path,
    sensor_file: str | Path,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Re-expose the radiance of a dataset with another sensor; existing frames are kept.

    Parameters
    ----------
    dataset : path
        A finished dataset with its radiance.
    out : path
        A new or empty folder, or one that already holds the requested dataset.
    sensor_file : path
        YAML: keys of a `sensor:` section, which override each group's own.
    progress : callable, optional
        Called with (done, total).

    Raises
    ------
    StudyError
        If the file is not a sensor, or changes what needs rendering.
    UsageError
        If there is no radiance, or `out` holds something else.
    DataError
        If the dataset is corrupt, or a file cannot be written; finished frames are kept.
    """
    source, out = Path(dataset), Path(out)
    # Open it first: for a folder that is not a dataset, that error is clearer than a missing manifest.
    open_images(source)
    manifest = read_manifest(source)
    before = _source_study(source, manifest)
    study = study_with_sensor(before, sensor_file)
    if out.resolve() == source.resolve():
        raise UsageError(f"{out}: is the dataset itself; name another folder")
    rendered = journal.read(source)
    ranges = group_ranges(study)
    wanted = [i for name, ids in ranges.items() if study.groups[name].mode == "images" for i in ids]
    absent = next((i for i in wanted if i not in rendered), None)
    if absent is not None:
        raise DataError(f"{source / files.JOURNAL}: has no frame {absent}; run `roundel render` again")
    entries = prepare(study, out)
    missing = [i for i in wanted if i not in entries]
    if missing:
        reopen(out, entries)
    for done, i in enumerate(missing):
        if progress:
            progress(len(wanted) - len(missing) + done, len(wanted))
        entry, seconds = _develop_frame(source, rendered[i], frame_of(before, i), frame_of(study, i), out)
        record(out, entries, entry, seconds)
    if progress:
        progress(len(wanted), len(wanted))
    finish_dataset(study, out, entries, manifest.get("environment", {}), developed_from=manifest["dataset_id"])
    return open_dataset(out)
