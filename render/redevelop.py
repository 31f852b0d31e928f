"""`roundel develop`: re-expose a dataset's radiance with another sensor, without rendering."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from roundel.datasets.cluster import pool_of
from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.environment import Environment, environment_of
from roundel.datasets.index import is_whole, tidy
from roundel.datasets.layout import files, journal
from roundel.datasets.layout.contents import Contents, Part
from roundel.datasets.layout.developed import Developed, Repeated, developed_of
from roundel.datasets.layout.images import open_images
from roundel.datasets.layout.manifest import read_manifest
from roundel.datasets.layout.masks import only_masks
from roundel.datasets.layout.radiance import Planes, decode_radiance, encode_planes, rounded
from roundel.datasets.layout.schema import ManifestRecord
from roundel.datasets.numbers import check_numbers
from roundel.datasets.resume import held_study, prepare
from roundel.datasets.store.addresses import Address, store_at
from roundel.datasets.store.store import Store
from roundel.datasets.store.writing import sha256
from roundel.datasets.work import Participant, Task, Work, finish, refuse_lost, shards_within, work_through
from roundel.render.frame_files import entry_of, image_file, write_frame
from roundel.render.sensor.develop import develop
from roundel.scenes.errors import DataError, UsageError
from roundel.scenes.study.sensor_file import study_with_sensor
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import Frame, frame_of, group_ranges, total_frames


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

    def part_of(self, frame_id: int) -> Part:
        """Its shard with a frame."""
        part = next((p for p in self.contents.parts if frame_id in p.shard.frames), None)
        if part is None:
            raise DataError(f"{self.contents.folder}: has no frame {frame_id}; run `roundel render` again")
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


def _develop_frame(
    source: _Source, source_id: int, frame: Frame, here: Store
) -> tuple[journal.Entry, dict[str, float]]:
    """Develop a frame from the radiance of the frame `source_id` of another dataset."""
    clock = [time.perf_counter()]
    before, part = frame_of(source.study, source_id), source.part_of(source_id)
    old = source.entry(part, source_id)
    then, now = (
        one.settings.model_dump(exclude={"sensor": True, "sweep": True, "render": {"radiance"}})
        for one in (before, frame)
    )
    if then != now or not np.array_equal(before.camera_from_sheet, frame.camera_from_sheet):
        raise UsageError(
            f"frame {frame.frame_id}: distributions in this sensor would redraw its other values; give numbers instead"
        )
    check_numbers(str(source.contents.folder), before, old)
    planes, keeps = source.planes(part, source_id), frame.settings.render
    developed = develop(frame, planes["Y"])
    noise = developed.noise_dn()
    written = image_file(frame, developed)
    name, there = files.radiance_name(frame.frame_id), files.radiance_name(source_id)
    # Only the noise plane depends on the sensor; if it is equal, both datasets share the file.
    kept = keeps.radiance and np.array_equal(planes.get("noise_dn", np.empty(0)), rounded("noise_dn", noise))
    if keeps.radiance and not kept:
        written[name] = encode_planes(planes | {"noise_dn": noise})
    elif keeps.masks and not keeps.radiance:
        written[files.masks_name(frame.frame_id)] = encode_planes(only_masks(planes))
    clock.append(time.perf_counter())
    listed = write_frame(here, written)
    if kept:
        here.take(name, source.contents.folder, part.shard.name(there))
        listed[name] = old["files"][there]
    clock.append(time.perf_counter())
    entry = entry_of(frame, developed, planes, old["fidelity"], listed, str(old.get("backend", "llvm")))
    encode, write = np.diff(clock)
    return entry, {"encode_s": float(encode), "write_s": float(write)}


def _repeated(before: Study, study: Study) -> dict[str, Repeated]:
    """The frames of a study whose radiance each group of the re-exposed study has."""
    old = group_ranges(before)
    return {
        name: Repeated(first_frame=ids.start, source_first_frame=old[name].start, source_frames=len(old[name]))
        for name, ids in group_ranges(study).items()
    }


def _origin(manifest: ManifestRecord, before: Study, study: Study) -> Developed:
    """Whose radiance the frames of the re-exposed study have, back to those that were rendered."""
    parent = developed_of(manifest.model_dump(exclude_none=True))
    groups: dict[str, Repeated] = {}
    for (name, ids), its in zip(group_ranges(study).items(), _repeated(before, study).values(), strict=True):
        first, count = its.source_first_frame, its.source_frames
        if parent is not None:
            first = parent.source_of(name, first)
            count = parent.groups[name].source_frames if name in parent.groups else count
        if (first, count) != (ids.start, len(ids)):
            groups[name] = Repeated(first_frame=ids.start, source_first_frame=first, source_frames=count)
    return Developed(manifest.dataset_id, parent.rendered_id if parent else manifest.dataset_id, groups)


def develop_dataset(
    dataset: Address,
    out: Address,
    sensor_file: str | Path,
    progress: Callable[[int, int], None] | None = None,
    on_warning: Callable[[str], None] | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    keep_radiance: bool = True,
) -> Dataset:
    """Re-expose the radiance of a dataset with another sensor, or several; existing frames are kept.

    With a sweep, every frame of the dataset is developed once per level.

    Parameters
    ----------
    dataset : path
        A finished dataset with its radiance.
    out : path
        A new or empty folder, or one that already holds the requested dataset.
    sensor_file : path
        YAML: keys of a `sensor:` section, which override each group's own, and perhaps a `sweep:` over one of them.
    progress : callable, optional
        Called with (done, total).
    on_warning : callable, optional
        Called with one line for each damaged log or journal whose frames are developed again.
    jobs : int
        Number of processes; the bytes do not depend on it.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers develop instead of processes of this machine.
    keep_radiance : bool
        Whether the new dataset has the radiance, too. Without it, it cannot be developed again.

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
    study = study_with_sensor(before, sensor_file, keep_radiance)
    if store_at(out).address() == contents.folder.address():
        raise UsageError(f"{out}: is the dataset itself; name another folder")
    total = total_frames(study)
    shards = shards_within(total, range(total))
    folder = prepare(study, out)
    if is_whole(folder, shards):
        tidy(folder, shards, study)
        return open_dataset(out)
    together = jobs > 1 or scheduler is not None
    own = environment_of(manifest.environment)
    mix = manifest.environments is not None
    origin = _origin(manifest, before, study)
    work = Work(study, folder, range(total), own, mix, progress, on_warning, origin, together)
    with ExitStack() as stack:
        if together:
            arguments = contents.folder.address(), folder.address(), study.digest(), own, mix
            died = "the developing processes died as they started; free some memory, or use fewer --jobs"
            pool = pool_of(jobs, scheduler, _work, _start_worker, arguments, died, _stop_worker)
            stack.enter_context(pool)
            finished = work_through(work, pool.in_order)
        else:
            mine = _Developer(work, contents, before)
            stack.callback(mine.leave)
            finished = work_through(work, lambda tasks: map(mine.do, tasks))
    refuse_lost(work)
    tidy(folder, shards if finished else work.finished, study)
    return open_dataset(out)


class _Developer(Participant):
    """A process that develops frames of a dataset."""

    def __init__(self, work: Work, contents: Contents, before: Study) -> None:
        super().__init__(work.study, work.folder, work.own, work.mix)
        self.work, self.source = work, _Source(contents, before)
        self.groups = _repeated(before, work.study)

    def do(self, task: Task) -> tuple[Task, int]:
        """Develop frames, or finish a shard; with how much of it was done."""
        if not task.frame_ids:
            return task, finish(self.work, task.shard)
        state = self.enter(task.shard)
        claimed = [i for i in task.frame_ids if state.claim(i)]
        for i in claimed:
            frame = frame_of(self.study, i)
            source_id = self.groups[frame.group].source_of(i)
            state.record(*_develop_frame(self.source, source_id, frame, state.here))
        return task, len(claimed)


# A worker process keeps what it is at from one frame to the next.
_worker: list[_Developer] = []


def _start_worker(source: str, out: str, digest: str, own: Environment, mix: bool) -> None:
    contents = open_images(source).contents
    _, manifest = read_manifest(contents.folder)
    folder = store_at(out)
    study = held_study(folder)
    if study.digest() != digest:
        raise UsageError(f"{out}: changed while it was being developed; run again")
    _stop_worker()  # one of a cluster may have worked for somebody else before
    before = _source_study(contents.folder, manifest)
    origin = _origin(manifest, before, study)
    work = Work(study, folder, range(total_frames(study)), own, mix, developed=origin)
    _worker[:] = [_Developer(work, contents, before)]


def _stop_worker() -> None:
    for developer in _worker:
        developer.leave()
    _worker.clear()


def _work(task: Task) -> tuple[Task, int]:
    return _worker[0].do(task)
