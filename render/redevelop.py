"""`roundel develop`: re-expose a dataset's radiance with another sensor, without rendering."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.environment import environment_of
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.contents import Contents, Part
from roundel.datasets.layout.images import open_images
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.layout.radiance import Planes, decode_radiance, encode_radiance, rounded
from roundel.datasets.layout.schema import ManifestRecord
from roundel.datasets.layout.shards import Shard
from roundel.datasets.numbers import check_numbers
from roundel.datasets.resume import held_study, prepare
from roundel.datasets.store.addresses import Address, store_at
from roundel.datasets.store.store import Store
from roundel.datasets.store.writing import sha256
from roundel.datasets.work import Participant, Work, is_whole, shards_within, tidy, work_through
from roundel.render.frame_files import entry_of, image_file, write_frame
from roundel.render.sensor.develop import develop
from roundel.scenes.errors import DataError, UsageError
from roundel.scenes.study.sensor_file import study_with_sensor
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import Frame, frame_of, total_frames


def _source_study(folder: Store, manifest: ManifestRecord) -> Study:
    """The study of a dataset in which every frame has its radiance."""
    # Compare file checksums: the computation of a dataset_id may change between versions.
    if sha256(folder.read(files.STUDY)) != manifest.study_sha256:
        raise DataError(f"{folder.place(files.STUDY)}: is not the study of this dataset; restore it")
    study = held_study(folder)
    rendered = {name: group for name, group in study.groups.items() if group.mode == "images"}
    if not rendered:
        raise UsageError(f"{folder}: has points but no images; there is nothing to develop")
    for name, group in rendered.items():
        if not group.render.radiance:
            raise UsageError(
                f"{folder}: group {name} was rendered without its radiance; render it with render.radiance: true"
            )
    return study


class _Source:
    """The dataset whose radiance is developed: a shard's journal, and a frame's planes."""

    def __init__(self, contents: Contents, study: Study) -> None:
        self.contents, self.study = contents, study
        self._entries: tuple[Part, dict[int, journal.Entry]] | None = None

    def part_of(self, shard: Shard) -> Part:
        """Its shard with these frames."""
        found = (p for p in self.contents.parts if p.shard.frames.start == shard.frames.start)
        part = next(found, None)
        if part is None:
            raise DataError(f"{self.contents.folder}: has no frame {shard.frames.start}; run `roundel render` again")
        return part

    def entry(self, part: Part, frame_id: int) -> journal.Entry:
        """The journal line of a frame."""
        if self._entries is None or self._entries[0] != part:
            place = self.contents.folder.place(part.shard.name(files.JOURNAL))
            self._entries = part, journal.entries_of(self.contents.read(part, files.JOURNAL), place)[0]
        if frame_id not in self._entries[1]:
            place = self.contents.folder.place(part.shard.name(files.JOURNAL))
            raise DataError(f"{place}: has no frame {frame_id}; run `roundel render` again")
        return self._entries[1][frame_id]

    def planes(self, part: Part, frame_id: int) -> Planes:
        """The radiance of a frame, held against its checksum."""
        name = files.radiance_name(frame_id)
        return decode_radiance(self.contents.read(part, name), self.contents.folder.place(part.shard.name(name)))


def _develop_frame(source: _Source, shard: Shard, frame: Frame, here: Store) -> tuple[journal.Entry, dict[str, float]]:
    clock = [time.perf_counter()]
    before, part = frame_of(source.study, frame.frame_id), source.part_of(shard)
    old = source.entry(part, frame.frame_id)
    same = before.settings.model_dump(exclude={"sensor"}) == frame.settings.model_dump(exclude={"sensor"})
    if not same or not np.array_equal(before.camera_from_sheet, frame.camera_from_sheet):
        raise UsageError(
            f"frame {frame.frame_id}: distributions in this sensor would redraw its other values; give numbers instead"
        )
    check_numbers(str(source.contents.folder), before, old)
    planes = source.planes(part, frame.frame_id)
    developed = develop(frame, planes["Y"])
    noise = developed.noise_dn()
    written = image_file(frame, developed)
    name = files.radiance_name(frame.frame_id)
    # Only the noise plane depends on the sensor; if it is equal, both datasets share the file.
    kept = np.array_equal(planes.get("noise_dn", np.empty(0)), rounded("noise_dn", noise))
    if not kept:
        written[name] = encode_radiance(planes | {"noise_dn": noise})
    clock.append(time.perf_counter())
    listed = write_frame(here, written)
    if kept:
        here.take(name, source.contents.folder, part.shard.name(name))
        listed[name] = old["files"][name]
    clock.append(time.perf_counter())
    entry = entry_of(frame, developed, planes, old["fidelity"], listed, str(old.get("backend", "llvm")))
    encode, write = np.diff(clock)
    return entry, {"encode_s": float(encode), "write_s": float(write)}


def develop_dataset(
    dataset: Address,
    out: Address,
    sensor_file: str | Path,
    progress: Callable[[int, int], None] | None = None,
    on_warning: Callable[[str], None] | None = None,
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
    # Open it first: for a folder that is not a dataset, that error is clearer than a missing manifest.
    contents = open_images(dataset).contents
    _, manifest = read_manifest(contents.folder)
    before = _source_study(contents.folder, manifest)
    study = study_with_sensor(before, sensor_file)
    if store_at(out).address() == contents.folder.address():
        raise UsageError(f"{out}: is the dataset itself; name another folder")
    total = total_frames(study)
    shards = shards_within(total, range(total))
    folder = prepare(study, out)
    if is_whole(folder, shards):
        tidy(folder, shards, study)
        return open_dataset(out)
    work = Work(
        study,
        folder,
        range(total),
        environment_of(manifest.environment),
        manifest.environments is not None,
        progress,
        on_warning,
        developed_from=manifest.dataset_id,
    )
    source, mine = _Source(contents, before), Participant(study, folder, work.own, work.mix)

    def make(shard: Shard, ids: list[int]) -> Iterator[int]:
        state = mine.enter(shard)
        for i in ids:
            if state.claim(i):
                state.record(*_develop_frame(source, shard, frame_of(study, i), state.here))
                yield i

    try:
        work_through(work, make)
    finally:
        mine.leave()
    tidy(folder, shards, study)
    return open_dataset(out)
