"""Estimates for a dataset: every frame, method and kind of intrinsics, in one file.

Only images and cameras are opened; the truth stays closed.
"""

from __future__ import annotations

import copy
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout.files import check_no_dataset, write_file
from roundel.datasets.layout.images import Images, open_images
from roundel.scenes.camera.model import Camera, distorts
from roundel.scenes.errors import UsageError
from roundel.solver.ambiguity.disambiguation import Knowledge, check_knowledge
from roundel.solver.estimates import ESTIMATES, NOT_FOUND, Estimate, write_estimates
from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.fit.image_levels import grey_levels
from roundel.solver.intrinsics.specification import Intrinsics, assumed_camera_for, parse_intrinsics
from roundel.solver.intrinsics.uncertain_camera import AssumedCamera
from roundel.solver.methods.plugin import Finder, View
from roundel.solver.methods.pose_estimate import estimate_of
from roundel.solver.methods.registry import NOTHING, check_methods, find, finder_of
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD, Seen, fit_detection, fit_points, look_at

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

TIMINGS = "timings.jsonl"


@dataclass(frozen=True)
class _Frame:
    """One frame to solve: position, id, size of its circles, and a camera for each kind of intrinsics."""

    index: int
    frame_id: int
    diameter_m: float
    cameras: list[AssumedCamera]


def solve_dataset(
    dataset_path: str | Path,
    out_path: str | Path,
    methods: Sequence[str] = (DEFAULT_METHOD,),
    intrinsics: Sequence[str] = ("true",),
    groups: Sequence[str] | None = None,
    knowledge: Knowledge = None,
    frames: range | None = None,
    progress: Progress | None = None,
    complain: Callable[[str], None] | None = None,
) -> dict[str, int]:
    """Estimate the pose of every circle in a dataset.

    Every circle of a frame is taken to have the diameter of the frame's first circular marker: a blind solver cannot
    tell one marker from another. Frames without a circular marker (boards) are left out. Frames in points mode
    start at the fit.

    Parameters
    ----------
    dataset_path, out_path : path
        `out_path` is a folder: `estimates.parquet` and `timings.jsonl` are written there, whole or not at all.
    methods : sequence of str
        See `roundel.solver.methods.registry.installed_methods`.
    intrinsics : sequence of str
        See `parse_intrinsics`.
    groups : sequence of str, optional
        Only these.
    knowledge : str, Evidence, a sequence of them, or None
        See `choose`.
    frames : range, optional
        Only these frame_ids.
    progress : callable, optional
        Called with (frames done, frames in all).
    complain : callable, optional
        Called with a line for each installed method that failed by its own fault (an exception, an answer that cannot
        be): in how many frames, and what it said first. Its rows say so, frame by frame.

    Returns
    -------
    dict
        Numbers of frames, detections, frames in which nothing was found, and failed estimates.

    Raises
    ------
    UsageError
        If a method, an intrinsics label or a group is unknown, no frame has a circular marker, or the folder for the
        result is a dataset.
    DataError
        If a file is missing or corrupt, or the result cannot be written.
    """
    check_no_dataset(Path(out_path))
    check_methods(methods)
    check_knowledge(knowledge)
    methods = list(dict.fromkeys(methods))
    finders = {name: finder for name in methods if (finder := finder_of(name)) is not None}
    fitted = [name for name in methods if name not in finders]
    specs = _specs(intrinsics)
    images = open_images(dataset_path)
    todo = _frames(images, specs, groups, frames)
    labels = [spec.label for spec in specs]
    estimates: list[Estimate] = []
    timings: list[str] = []
    counts = {"frames": len(todo), "detections": 0, "empty_frames": 0, "failed_estimates": 0}
    for done, frame in enumerate(todo):
        if progress:
            progress(done, len(todo))
        started = time.perf_counter()
        seen, found, fits = _fits(images, frame, fitted) if fitted else (None, 0, {})
        middle = time.perf_counter()
        solved = []
        for method in methods:
            if method in finders:
                solved += _found(images, frame, method, finders[method], labels, knowledge)
            else:
                solved += _solve_frame(frame, seen, found, fits, method, labels, knowledge)
        ended = time.perf_counter()
        estimates += solved
        # Fits share their detections; where there are none, the first method's count.
        first = (fitted or methods)[0], labels[0]
        found = len({e.detection_id for e in solved if (e.method, e.intrinsics) == first} - {NOT_FOUND})
        counts["detections"] += found
        counts["empty_frames"] += found == 0
        counts["failed_estimates"] += sum(not estimate for estimate in solved)
        seconds = {"detect_s": round(middle - started, 6), "pose_s": round(ended - middle, 6)}
        timings.append(json.dumps({"frame_id": frame.frame_id, "detections": found, **seconds}))
    if progress:
        progress(len(todo), len(todo))
    out = Path(out_path)
    write_estimates(estimates, out / ESTIMATES, images.dataset_id)
    write_file(out / TIMINGS, "".join(f"{line}\n" for line in timings).encode())
    if complain:
        for line in _complaints(estimates, list(finders)):
            complain(line)
    return counts


def _complaints(estimates: list[Estimate], finders: list[str]) -> list[str]:
    """A line for each method of others that failed, other than by finding nothing."""
    out = []
    for name in finders:
        wrong = [e for e in estimates if e.method == name and not e and e.reason != f"{name}: {NOTHING}"]
        if wrong:
            frames = len({e.frame_id for e in wrong})
            said = wrong[0].reason.removeprefix(f"{name}: ")
            out.append(f"method {name} failed in {frames} of the frames; first in frame {wrong[0].frame_id}: {said}")
    return out


def _specs(intrinsics: Sequence[str]) -> list[Intrinsics]:
    if not intrinsics:
        raise UsageError("no intrinsics; use true, default, exif, scaled:0.7 or calibrated:FILE")
    specs = {text: parse_intrinsics(text) for text in intrinsics}
    by_label: dict[str, str] = {}
    for text, spec in specs.items():
        other = by_label.setdefault(spec.label, text)
        if other != text and spec.kind == "calibrated":
            raise UsageError(f"--intrinsics {other} and {text} would both be called {spec.label}; rename one file")
    return list({spec.label: spec for spec in specs.values()}.values())


def _frames(
    images: Images, specs: list[Intrinsics], groups: Sequence[str] | None, wanted: range | None
) -> list[_Frame]:
    """Frames with a circular marker; their cameras are made first, so that a wrong argument ends the run at once."""
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
        camera = images.camera(i)
        cameras = [assumed_camera_for(spec, camera, camera.width_px, camera.height_px) for spec in specs]
        out.append(_Frame(i, frame_id, float(diameters[0]), cameras))
    if not out:
        which = "" if wanted is None else f" among {wanted.start}:{wanted.stop}"
        raise UsageError(f"no frame with a circular marker{which}; name a group, or frames, that have one")
    return out


Fits = dict[tuple[str, int], list[EllipseFit | FailedFit]]


def _fits(images: Images, frame: _Frame, methods: list[str]) -> tuple[Seen | None, int, Fits]:
    """What was seen (nothing in points mode), number of detections, and the fits {(method, camera): one a detection}.

    Cameras that undistort alike (none of them distorts, or K and lens model agree) share one fit.
    """
    if images.mode(frame.index) == "points":
        by_marker = images.points(frame.index)
        points = [by_marker[marker_id] for marker_id in sorted(by_marker)]
        return None, len(points), _shared(frame, methods, lambda c, m: [fit_points(p, None, c, m) for p in points])
    levels, saturation_dn = images.linear_image(frame.index)
    grey, full_scale_dn = grey_levels(levels)
    seen = look_at(grey, saturation_dn or full_scale_dn)
    found = seen.detections
    return seen, len(found), _shared(frame, methods, lambda c, m: [fit_detection(seen, d, c, m) for d in found])


def _shared(frame: _Frame, methods: list[str], fit: Callable[[Camera, str], list[EllipseFit | FailedFit]]) -> Fits:
    made: dict[Any, list[EllipseFit | FailedFit]] = {}
    out: Fits = {}
    for method in methods:
        for i, assumed in enumerate(frame.cameras):
            camera, lens = assumed.camera, None
            if distorts(camera):
                lens = (tuple(camera.K.ravel().tolist()), camera.distortion_model, camera.distortion)
            if (method, lens) not in made:
                made[method, lens] = fit(camera, method)
            out[method, i] = made[method, lens]
    return out


def _solve_frame(
    frame: _Frame,
    seen: Seen | None,
    found: int,
    fits: Fits,
    method: str,
    labels: list[str],
    knowledge: Knowledge,
) -> list[Estimate]:
    out = []
    for i, label in enumerate(labels):
        if not found:
            out.append(Estimate(frame.frame_id, NOT_FOUND, method, label, "failed", "no ellipse found"))
        for n, fit in enumerate(fits[method, i]):
            key = (frame.frame_id, n, method, label)
            detection, grey = (None, None) if seen is None else (seen.detections[n], seen.grey)
            out.append(estimate_of(fit, frame.cameras[i], frame.diameter_m, knowledge, key, detection, grey))
    return out


def _found(
    images: Images, frame: _Frame, method: str, finder: Finder, labels: list[str], knowledge: Knowledge
) -> list[Estimate]:
    """What an installed method finds in a frame, with each camera."""
    if images.mode(frame.index) == "points":
        reason = f"{method}: needs an image, and there are only points"
        return [Estimate(frame.frame_id, NOT_FOUND, method, label, "failed", reason) for label in labels]
    image = images.image(frame.index)
    saturation_dn = images.saturation_dn(frame.index) or float(np.iinfo(image.dtype).max)
    out = []
    for label, assumed in zip(labels, frame.cameras, strict=True):
        # Copies: what a method does to its image or its markers must reach nobody else.
        markers = images.markers(frame.index)
        view = View(image.copy(), assumed.camera, frame.diameter_m, copy.deepcopy(markers), saturation_dn)
        out += find(method, finder, view, assumed, knowledge, frame.frame_id, label)
    return out
