"""Solve a dataset: every frame with every method and every intrinsics label, into one file.

Only images and cameras are read, never the truth.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roundel.datasets.layout.files import check_no_dataset, write_file
from roundel.datasets.layout.images import Images, open_images
from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import UsageError
from roundel.solver.ambiguity.disambiguation import Knowledge, check_knowledge
from roundel.solver.estimates import ESTIMATES, Estimate, write_estimates
from roundel.solver.fit.image_levels import grey_levels
from roundel.solver.intrinsics.specification import Intrinsics, parse_intrinsics, uncertain_camera_for
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.plugin import View
from roundel.solver.methods.registry import NOTHING, load_methods
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD
from roundel.solver.methods.solve_image import SolverInput, solve_image

Progress = Callable[[int, int], None]

TIMINGS = "timings.jsonl"


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
) -> dict[str, int]:
    """Estimate the pose of every circle in a dataset.

    Every circle of a frame is assumed to have the diameter of the frame's first circular marker, because the solver
    cannot distinguish markers. Frames without a circular marker (boards) are skipped. Frames in points mode start at
    the fit.

    Parameters
    ----------
    dataset_path, out_path : path
        `out_path` is a folder: `estimates.parquet` and `timings.jsonl` are written there, atomically.
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
        If a file is missing or corrupt, or the result cannot be written.
    """
    check_no_dataset(Path(out_path))
    loaded = load_methods(methods)
    check_knowledge(knowledge)
    images = open_images(dataset_path)
    todo = _frames(images, _specs(intrinsics), groups, frames)
    estimates: list[Estimate] = []
    timings: list[str] = []
    counts = {"frames": len(todo), "detections": 0, "empty_frames": 0, "failed_estimates": 0}
    for done, frame in enumerate(todo):
        if progress:
            progress(done, len(todo))
        solved = solve_image(_input(images, frame), loaded, knowledge)
        estimates += solved.estimates
        counts["detections"] += solved.detections
        counts["empty_frames"] += solved.detections == 0
        counts["failed_estimates"] += sum(not estimate for estimate in solved.estimates)
        seconds = {"detect_s": round(solved.detect_s, 6), "pose_s": round(solved.pose_s, 6)}
        timings.append(json.dumps({"frame_id": frame.frame_id, "detections": solved.detections, **seconds}))
    if progress:
        progress(len(todo), len(todo))
    out = Path(out_path)
    write_estimates(estimates, out / ESTIMATES, images.dataset_id)
    write_file(out / TIMINGS, "".join(f"{line}\n" for line in timings).encode())
    if on_warning:
        for line in _plugin_failures(estimates, [name for name, finder in loaded.items() if finder]):
            on_warning(line)
    return counts


def _plugin_failures(estimates: list[Estimate], plugins: list[str]) -> list[str]:
    """One line per third-party method that failed, except by finding nothing."""
    out = []
    for name in plugins:
        wrong = [e for e in estimates if e.method == name and not e and e.reason != f"{name}: {NOTHING}"]
        if wrong:
            frames = len({e.frame_id for e in wrong})
            said = wrong[0].reason.removeprefix(f"{name}: ")
            out.append(f"method {name} failed in {frames} of the frames; first in frame {wrong[0].frame_id}: {said}")
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
    images: Images, specs: list[Intrinsics], groups: Sequence[str] | None, wanted: range | None
) -> list[_Frame]:
    """Frames with a circular marker; their cameras are made first, so that a wrong argument fails immediately."""
    known = sorted(set(images.groups))
    for group in groups or ():
        if group not in known:
            raise UsageError(f"group {group!r}: the dataset has {', '.join(known)}")
    out = []
    for i, (frame_id, group) in enumerate(zip(images.frame_ids, images.groups, strict=True)):
        diameters = [m["diameter_m"] for m in images.markers(i) if m["diameter_m"] is not None]
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


def _input(images: Images, frame: _Frame) -> SolverInput:
    """A frame as input of the chain."""
    if images.mode(frame.index) == "points":
        by_marker = images.points(frame.index)
        points = tuple(by_marker[marker_id] for marker_id in sorted(by_marker))
        return SolverInput(frame.diameter_m, frame.cameras, points_px=points, frame_id=frame.frame_id)
    delivered = images.image(frame.index)
    levels, saturation_dn = images.linear_image(frame.index, delivered)
    grey, full_scale_dn = grey_levels(levels)

    def view(camera: Camera) -> View:
        # Copies, so that a method's changes to its image or markers do not affect others.
        markers = copy.deepcopy(images.markers(frame.index))
        saturation = images.saturation_dn(frame.index) or float(np.iinfo(delivered.dtype).max)
        return View(delivered.copy(), camera, frame.diameter_m, markers, saturation)

    return SolverInput(
        frame.diameter_m, frame.cameras, grey, saturation_dn or full_scale_dn, view=view, frame_id=frame.frame_id
    )
