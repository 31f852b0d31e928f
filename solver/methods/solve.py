"""Solve a dataset: every frame with every method and every intrinsics label, into one file.

Only images and cameras are read, never the truth. Frames are solved in blocks, whose results are parts on disk until
all are joined.
"""

from __future__ import annotations

import json
import pickle
import secrets
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from roundel.datasets.layout.files import MANIFEST, check_no_dataset
from roundel.datasets.layout.images import Images, open_images
from roundel.datasets.layout.worker_pool import in_order
from roundel.scenes.errors import UsageError
from roundel.solver.ambiguity.disambiguation import Knowledge, check_knowledge
from roundel.solver.estimates import Estimate
from roundel.solver.intrinsics.specification import Intrinsics, parse_intrinsics, uncertain_camera_for
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.companions import companions_of, printed_markers
from roundel.solver.methods.plugin import Finder, View
from roundel.solver.methods.registry import NOTHING, load_methods
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD
from roundel.solver.methods.solve_image import SolverInput, solve_image
from roundel.solver.methods.solved_parts import PARTS, Tally, join_parts, part_name, read_part, write_part
from roundel.solver.methods.worker_start import after_warm_up, one_opencv_thread, pickled
from roundel.solver.photometry.frame_levels import frame_levels

Progress = Callable[[int, int], None]

# Frames of a block: at least this many blocks, so that the last ones end at about the same time in all processes.
_BLOCKS, _LARGEST_BLOCK = 64, 64


@dataclass(frozen=True)
class _Frame:
    """One frame to solve: position, id, size of its circles, and a camera for each intrinsics label."""

    index: int
    frame_id: int
    diameter_m: float
    cameras: dict[str, UncertainCamera]


def solve_dataset(
    dataset_path: str | Path,
    out_path: str | Path,
    methods: Sequence[str] = (DEFAULT_METHOD,),
    intrinsics: Sequence[str] = ("true",),
    groups: Sequence[str] | None = None,
    knowledge: Knowledge = None,
    frames: range | None = None,
    progress: Progress | None = None,
    on_warning: Callable[[str], None] | None = None,
    jobs: int = 1,
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
        See `roundel.solver.methods.registry.installed_methods`.
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
    todo = _frames(images, _specs(intrinsics), groups, frames, only_circles)
    blocks, out = _blocks(todo), Path(out_path)
    run = _Run(images, loaded, knowledge)
    parts = [out / PARTS / name for name in _part_names(run, blocks)]
    missing = [i for i, path in enumerate(parts) if read_part(path) is None]
    done = len(todo) - sum(len(blocks[i]) for i in missing)
    with closing(_solved(run, [(blocks[i], parts[i]) for i in missing], jobs)) as solved:
        for count in solved:
            if progress:
                progress(done, len(todo))
            done += count
    if progress:
        progress(done, len(todo))
    tally = join_parts(parts, out, images.dataset_id)
    if on_warning:
        for name in (name for name in loaded if name in tally.failures):
            number, first, said = tally.failures[name]
            on_warning(f"method {name} failed in {number} of the frames; first in frame {first}: {said}")
    return tally.counts


@dataclass(frozen=True)
class _Run:
    """What all frames share."""

    images: Images
    methods: dict[str, Finder | None]
    knowledge: Knowledge


def _blocks(todo: list[_Frame]) -> list[list[_Frame]]:
    """Consecutive frames, by their number alone: a part has the same frames in every run."""
    size = max(1, min(len(todo) // _BLOCKS, _LARGEST_BLOCK))
    return [todo[i : i + size] for i in range(0, len(todo), size)]


def _part_names(run: _Run, blocks: list[list[_Frame]]) -> list[str]:
    """Names of the blocks' parts; another dataset, argument or version of Roundel gives other names."""
    try:
        shared = pickle.dumps((list(run.methods), run.knowledge, _source_stamp()))
        manifest = (run.images.path / MANIFEST).read_bytes()
        if not all(f is None or f.__module__.startswith("roundel.") for f in run.methods.values()):
            raise ValueError("nothing tells whether a third-party method has changed")
    except (OSError, ValueError, TypeError, AttributeError, pickle.PicklingError):
        shared, manifest = secrets.token_bytes(), b""  # nothing to continue from
    return [part_name(i, shared, manifest, pickle.dumps(block)) for i, block in enumerate(blocks)]


def _source_stamp() -> tuple[Any, ...]:
    """What tells two versions of the solver apart."""
    rooms = Path(__file__).parents[2]
    files = sorted(f for room in ("scenes", "solver") for f in (rooms / room).rglob("*.py"))
    packages = [version(name) for name in ("roundel", "numpy", "scipy", "numba")]
    return (*packages, *((f.stat().st_mtime_ns, f.stat().st_size) for f in files))


def _solved(run: _Run, work: list[tuple[list[_Frame], Path]], jobs: int) -> Generator[int, None, None]:
    """Solve blocks and write their parts; yields numbers of solved frames."""
    jobs = min(jobs, len(work))
    if jobs <= 1:
        for block, part in work:
            yield from _solve_block(run, block, part)
        return
    shared = pickled((run.images.path, run.knowledge))
    died = "a solving process died, perhaps from lack of memory; run the command again to continue"
    yield from in_order(jobs, _work, after_warm_up(work), _start_worker, (shared, list(run.methods)), died)


# A worker process keeps what all frames share.
_worker: list[_Run] = []


def _start_worker(shared: bytes, methods: list[str]) -> None:
    one_opencv_thread()
    path, knowledge = pickle.loads(shared)
    _worker.append(_Run(open_images(path), load_methods(methods), knowledge))


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
            said = wrong[0].reason.removeprefix(f"{name}: ")
            out[name] = len({e.frame_id for e in wrong}), wrong[0].frame_id, said
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
    specs: list[Intrinsics],
    groups: Sequence[str] | None,
    wanted: range | None,
    only_circles: bool,
) -> list[_Frame]:
    """Frames to solve; their cameras are made first, so that a wrong argument fails immediately.

    `only_circles`: only frames with a circular marker.
    """
    known = sorted(set(images.groups))
    for group in groups or ():
        if group not in known:
            raise UsageError(f"group {group!r}: the dataset has {', '.join(known)}")
    out = []
    for i, (frame_id, group) in enumerate(zip(images.frame_ids, images.groups, strict=True)):
        markers = images.markers(i)
        diameters = [m["diameter_m"] for m in markers if m["diameter_m"] is not None]
        if not diameters and not only_circles:
            diameters = [_equivalent_diameter_m(marker) for marker in markers]
        if not diameters or (groups is not None and group not in groups):
            continue
        if wanted is not None and frame_id not in wanted:
            continue
        camera, row_time = images.camera(i), images.row_time(i)
        size = camera.width_px, camera.height_px
        cameras = {spec.label: uncertain_camera_for(spec, camera, *size, row_time=row_time) for spec in specs}
        out.append(_Frame(i, frame_id, float(diameters[0]), cameras))
    if not out:
        which = "" if wanted is None else f" among {wanted.start}:{wanted.stop}"
        raise UsageError(f"no frame with a circular marker{which}; give a group or frames that have one")
    return out


def _equivalent_diameter_m(marker: dict[str, Any]) -> float:
    """Diameter of the disc with the area of a print that is no circle; 1 m if an older dataset does not tell."""
    width, height = marker.get("size_m") or (1.0, 1.0)
    return float(np.sqrt(4 * width * height / np.pi))


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
