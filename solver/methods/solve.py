"""Solve a dataset: every frame with every method and every intrinsics label, into one file.

Only images and cameras are read, never the truth. Frames are solved in blocks, whose results are parts on disk until
all are joined.
"""

from __future__ import annotations

import json
import pickle
import secrets
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path

import pyarrow as pa

from roundel.datasets.cluster import ClusterPool, pool_of
from roundel.datasets.layout.contents import Part
from roundel.datasets.layout.files import CAMERAS, check_no_dataset
from roundel.datasets.layout.images import Images, open_images
from roundel.datasets.layout.shards import SHARD_FRAMES
from roundel.datasets.store.addresses import Address
from roundel.datasets.store.writing import clear_leftovers
from roundel.datasets.worker_pool import Lost, WorkerPool
from roundel.scenes.errors import UsageError
from roundel.solver.ambiguity.disambiguation import Knowledge, check_knowledge
from roundel.solver.estimates import NOT_FOUND, Estimate, estimates_table
from roundel.solver.intrinsics.specification import Intrinsics, parse_intrinsics, uncertain_camera_for
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.companions import companions_of, equivalent_diameter_m, printed_markers
from roundel.solver.methods.method_file import MODULE, MethodFile
from roundel.solver.methods.plugin import Finder, View
from roundel.solver.methods.registry import NOTHING, absolute_names, load_methods
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD
from roundel.solver.methods.solve_image import SolverInput, solve_image
from roundel.solver.methods.solved_parts import (
    PARTS,
    Tally,
    join_parts,
    part_name,
    read_part,
    source_stamp,
    whole_part,
    write_part,
    write_table_part,
)
from roundel.solver.methods.worker_start import after_warm_up, one_opencv_thread, pickled
from roundel.solver.photometry.frame_levels import frame_levels

Progress = Callable[[int, int], None]

# Frames of a block: at least this many blocks, so that the last ones end at about the same time in all processes.
_BLOCKS, _LARGEST_BLOCK = 64, 64


@dataclass(frozen=True)
class _Frame:
    """One frame to solve."""

    index: int
    frame_id: int
    diameter_m: float
    cameras: dict[str, UncertainCamera]


def solve_dataset(
    dataset_path: Address,
    out_path: str | Path,
    methods: Sequence[str] = (DEFAULT_METHOD,),
    intrinsics: Sequence[str] = ("true",),
    groups: Sequence[str] | None = None,
    knowledge: Knowledge = None,
    frames: range | None = None,
    progress: Progress | None = None,
    on_warning: Callable[[str], None] | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
) -> dict[str, int]:
    """Estimate the pose of every circle in a dataset.

    Every circle of a frame is assumed to have the diameter of the frame's first circular marker, because the solver
    cannot distinguish markers. Frames without a circular marker (boards, tags) are skipped, unless every method is a
    plug-in. Frames in points mode start at the fit.

    Parameters
    ----------
    dataset_path, out_path : path
        `out_path` is a folder: `estimates.parquet` and `timings.jsonl` are written there, atomically. If the run is
        killed, the same call continues where it stopped.
    methods : sequence of str
        See `roundel.solver.methods.registry.installed_methods`; or files, `path/to/file.py:function`.
    intrinsics : sequence of str
        See `parse_intrinsics`.
    groups : sequence of str, optional
        Only these groups.
    knowledge : str, Evidence, a sequence of them, or None
        See `choose`.
    frames : range, optional
        Only these frame_ids.
    progress : callable, optional
        Called with (frames done, total frames).
    on_warning : callable, optional
        Called with one line for each third-party method that failed by an exception or an invalid result: the number of
        frames, and the first reason. Its rows have the reason of each frame.
    jobs : int
        Number of processes. The estimates do not depend on it, to the byte.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers solve instead of processes of this machine. They share the disk.

    Returns
    -------
    dict
        Numbers of frames, detections, frames without detections, and failed estimates.

    Raises
    ------
    UsageError
        If a method, an intrinsics label or a group is unknown, no frame has a circular marker, or the output folder is
        a dataset.
    DataError
        If a file is missing or corrupt, the result cannot be written, or a process died.
    """
    check_no_dataset(Path(out_path))
    loaded = load_methods(methods)
    check_knowledge(knowledge)
    images = open_images(dataset_path)
    only_circles = any(finder is None for finder in loaded.values())
    run = _Run(images, loaded, tuple(absolute_names(methods)), knowledge)
    plan = _Plan(run, _specs(intrinsics), groups, frames, only_circles, Path(out_path))
    clear_leftovers(plan.out)
    clear_leftovers(plan.out / PARTS)
    with closing(_solved(run, plan.missing(), jobs, scheduler, plan.set_aside)) as solved:
        for count in solved:
            if progress:
                progress(plan.passed, plan.total)
            plan.passed += count
    if progress:
        progress(plan.total, plan.total)
    if not plan.parts:
        which = "" if frames is None else f" among {frames.start}:{frames.stop}"
        raise UsageError(f"no frame with a circular marker{which}; give a group or frames that have one")
    tally = join_parts(plan.parts, plan.out, images.dataset_id, images.images_sha256)
    if on_warning:
        for name in (name for name in loaded if name in tally.failures):
            number, first, reason = tally.failures[name]
            on_warning(f"method {name} failed in {number} of the frames; first in frame {first}: {reason}")
    return tally.counts


@dataclass(frozen=True)
class _Run:
    """What all frames share."""

    images: Images
    methods: dict[str, Finder | None]
    asked: tuple[str, ...]  # the methods as arguments: names, or files
    knowledge: Knowledge


@dataclass
class _Plan:
    """Which frames are solved in which parts, found out shard by shard."""

    run: _Run
    specs: list[Intrinsics]
    groups: Sequence[str] | None
    frames: range | None
    only_circles: bool
    out: Path
    parts: list[Path] = field(default_factory=list)
    passed: int = 0

    def __post_init__(self) -> None:
        known = self.run.images.group_names
        for group in self.groups or ():
            if group not in known:
                raise UsageError(f"group {group!r}: the dataset has {', '.join(known)}")
        images, whole = self.run.images, len(self.run.images)
        self._shared = _shared_by_parts(self.run)
        # At once, so that a wrong argument fails before anything is solved.
        self._first = self._frames_of(0) if images.contents.parts else []
        single = len(images.contents.parts) == 1
        self.total = len(self._first) if single else whole if self.frames is None else len(self.frames[:whole])

    def missing(self) -> Iterator[tuple[list[_Frame], Path]]:
        """Blocks of frames that are not solved yet, and the files of their results."""
        images = self.run.images
        for number in range(len(images.contents.parts)):
            todo = self._frames_of(number) if number else self._first
            part = images.contents.parts[number]
            if len(images.contents.parts) > 1:
                self.passed += self._within(part) - len(todo)
            # Files of estimates say of which images they are, and so do the parts of them.
            cameras = images.contents.files_of(part)[CAMERAS].sha256
            about = f"{images.dataset_id} {part.images_sha256} {cameras}".encode()
            missing = []
            for block in _blocks(todo):
                name = part_name(len(self.parts), self._shared, about, pickle.dumps(block))
                path = self.out.resolve() / PARTS / name  # for workers in other folders
                self.parts.append(path)
                if read_part(path) is None:
                    missing.append((block, path))
                else:
                    self.passed += len(block)
            yield from missing

    def _within(self, part: Part) -> int:
        """Frames of a shard that are in the wanted range."""
        if self.frames is None:
            return part.frames
        ids = part.shard.frames
        return max(0, min(ids.stop, self.frames.stop) - max(ids.start, self.frames.start))

    def _frames_of(self, number: int) -> list[_Frame]:
        part = self.run.images.contents.parts[number]
        first, end = part.shard.frames.start, part.shard.frames.start + max(SHARD_FRAMES, part.frames)
        if self.frames is not None and (first >= self.frames.stop or end <= self.frames.start):
            return []
        return _frames(self.run.images, number, self.specs, self.groups, self.frames, self.only_circles)

    def set_aside(self, frame: _Frame, why: str) -> list[Estimate]:
        """Failed estimates of a frame whose processes died."""
        keys = ((method, label) for method in self.run.methods for label in frame.cameras)
        return [Estimate(frame.frame_id, NOT_FOUND, m, label, "failed", reason=why) for m, label in keys]


def _blocks(todo: list[_Frame]) -> list[list[_Frame]]:
    """Consecutive frames of a shard, by their number alone: a part has the same frames in every run."""
    size = max(1, min(len(todo) // _BLOCKS, _LARGEST_BLOCK))
    return [todo[i : i + size] for i in range(0, len(todo), size)]


def _shared_by_parts(run: _Run) -> bytes:
    """What all parts depend on beside their frames: another argument or version of Roundel gives them other names."""
    try:
        files = [file for file in map(MethodFile.of, run.asked) if file]
        if not all(f is None or f.__module__.startswith(("roundel.", MODULE)) for f in run.methods.values()):
            raise ValueError("nothing tells whether a method of a package has changed")
        return pickle.dumps((run.asked, [file.stamp() for file in files], run.knowledge, source_stamp()))
    except (OSError, ValueError, TypeError, AttributeError, pickle.PicklingError):
        return secrets.token_bytes()  # nothing to continue from


def _solved(
    run: _Run,
    work: Iterator[tuple[list[_Frame], Path]],
    jobs: int,
    scheduler: str | None,
    set_aside: Callable[[_Frame, str], list[Estimate]],
) -> Generator[int, None, None]:
    """Solve blocks and write their parts; yields numbers of solved frames."""
    # No more processes than there are blocks.
    first = list(islice(work, jobs))
    work = chain(first, work)
    if min(jobs, len(first)) <= 1 and (scheduler is None or not first):
        for block, part in work:
            yield from _solve_block(run, block, part)
        return
    shared = pickled((run.images.contents.folder.address(), run.knowledge))
    died = "the solving processes died as they started; free some memory, or use fewer --jobs"
    arguments = shared, run.asked
    with pool_of(min(jobs, len(first)), scheduler, _work, _start_worker, arguments, died) as pool:
        for done in pool.in_order(after_warm_up(work)):
            if isinstance(done, Lost):
                yield from _one_by_one(pool, done.item[0], done.item[1], set_aside)
            else:
                yield done


def _one_by_one(
    pool: WorkerPool | ClusterPool, block: list[_Frame], part: Path, set_aside: Callable[[_Frame, str], list[Estimate]]
) -> Generator[int, None, None]:
    """Solve the frames of a block whose process died twice each by itself; that which it dies of fails."""
    estimates, tally = [], Tally()
    single = [(frame, part.with_name(f"{part.stem}-{frame.frame_id}.arrow")) for frame in block]
    for (frame, path), done in zip(single, pool.in_order([([f], p) for f, p in single]), strict=True):
        if isinstance(done, Lost):
            failed = set_aside(frame, str(done))
            its = Tally({"frames": 1, "detections": 0, "empty_frames": 1, "failed_estimates": len(failed)})
            its.timings.append(json.dumps({"frame_id": frame.frame_id, "detections": 0}))
            estimates.append(estimates_table(failed))
        else:
            table, its = whole_part(path)
            estimates.append(table)
        tally.add(its)
        tally.timings += its.timings
        yield 1
    write_table_part(part, pa.concat_tables(estimates), tally)


# A worker process keeps what all frames share.
_worker: list[_Run] = []


def _start_worker(shared: bytes, methods: tuple[str, ...]) -> None:
    one_opencv_thread()
    path, knowledge = pickle.loads(shared)
    _worker[:] = [_Run(open_images(path), load_methods(methods), methods, knowledge)]


def _work(work: tuple[list[_Frame], Path]) -> int:
    return sum(_solve_block(_worker[0], *work))


def _solve_block(run: _Run, block: list[_Frame], part: Path) -> Generator[int, None, None]:
    """Solve the frames of a block and write its part; yields 1 for each frame."""
    estimates: list[Estimate] = []
    tally = Tally()
    for frame in block:
        solved = solve_image(_input(run.images, frame), run.methods, run.knowledge)
        estimates += solved.estimates
        tally.counts["frames"] += 1
        tally.counts["detections"] += solved.detections
        tally.counts["empty_frames"] += solved.detections == 0
        tally.counts["failed_estimates"] += sum(not estimate for estimate in solved.estimates)
        seconds = {"detect_s": round(solved.detect_s, 6), "pose_s": round(solved.pose_s, 6)}
        tally.timings.append(json.dumps({"frame_id": frame.frame_id, "detections": solved.detections, **seconds}))
        yield 1
    tally.failures = _plugin_failures(estimates, [name for name, finder in run.methods.items() if finder])
    write_part(part, estimates, tally)


def _plugin_failures(estimates: list[Estimate], plugins: list[str]) -> dict[str, tuple[int, int, str]]:
    """Third-party methods that failed, except by finding nothing: frames, first frame_id, first reason."""
    out = {}
    for name in plugins:
        wrong = [e for e in estimates if e.method == name and not e and e.reason != f"{name}: {NOTHING}"]
        if wrong:
            reason = wrong[0].reason.removeprefix(f"{name}: ")
            out[name] = len({e.frame_id for e in wrong}), wrong[0].frame_id, reason
    return out


def _specs(intrinsics: Sequence[str]) -> list[Intrinsics]:
    if not intrinsics:
        raise UsageError("no intrinsics given; use true, default, exif, scaled:0.7 or calibrated:FILE")
    specs = {text: parse_intrinsics(text) for text in intrinsics}
    by_label: dict[str, str] = {}
    for text, spec in specs.items():
        other = by_label.setdefault(spec.label, text)
        if other != text and spec.kind == "calibrated":
            raise UsageError(f"--intrinsics {other} and {text} would both have the label {spec.label}; rename one file")
    return list({spec.label: spec for spec in specs.values()}.values())


def _frames(
    images: Images,
    number: int,
    specs: list[Intrinsics],
    groups: Sequence[str] | None,
    wanted: range | None,
    only_circles: bool,
) -> list[_Frame]:
    """Frames of a shard to solve, with their cameras; `only_circles`: only those with a circular marker."""
    before = sum(part.frames for part in images.contents.parts[:number])
    out = []
    for i in range(before, before + images.contents.parts[number].frames):
        record = images.records[i]
        diameters = [m["diameter_m"] for m in record["markers"] if m["diameter_m"] is not None]
        if not diameters and not only_circles:
            diameters = [equivalent_diameter_m(marker) for marker in record["markers"]]
        if not diameters or (groups is not None and record["group"] not in groups):
            continue
        if wanted is not None and record["frame_id"] not in wanted:
            continue
        camera, row_time = images.camera(i), images.row_time(i)
        size = camera.width_px, camera.height_px
        cameras = {spec.label: uncertain_camera_for(spec, camera, *size, row_time=row_time) for spec in specs}
        out.append(_Frame(i, int(record["frame_id"]), float(diameters[0]), cameras))
    return out


def _input(images: Images, frame: _Frame) -> SolverInput:
    """A frame as input of the chain."""
    if images.mode(frame.index) == "points":
        by_marker = images.points(frame.index)
        points = tuple(by_marker[marker_id] for marker_id in sorted(by_marker))
        return SolverInput(frame.diameter_m, frame.cameras, points_px=points, frame_id=frame.frame_id)
    delivered = images.image(frame.index)
    levels = frame_levels(images, frame.index, delivered)
    saturation = images.saturation_dn(frame.index) or levels.photometry.top_dn

    def view(given: UncertainCamera) -> View:
        # Copies, so that a method's changes to its image or markers do not affect others.
        return View(
            delivered.copy(),
            given.camera,
            frame.diameter_m,
            printed_markers(images, frame.index),
            saturation,
            levels.photometry.curve,
            given.focal_sigma,
            lambda: companions_of(images, frame.index, frame.diameter_m, given),
        )

    about = levels.grey, levels.full_scale_dn, levels.photometry, levels.linearise
    return SolverInput(frame.diameter_m, frame.cameras, *about, view=view, frame_id=frame.frame_id)
