"""The chain for one frame: detect, fit, pose, choose; arrays, datasets and photographs all use it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.blas_threads import one_blas_thread
from roundel.scenes.camera.model import distorts
from roundel.scenes.camera.response_curve import ResponseCurve
from roundel.solver.ambiguity.disambiguation import Knowledge
from roundel.solver.estimates import NOT_FOUND, Estimate, EstimateKey
from roundel.solver.fit.ellipse import EllipseFit, FailedFit
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.fit_poses import poses_of_fits
from roundel.solver.methods.plugin import Finder, View
from roundel.solver.methods.pose_estimate import estimate_of
from roundel.solver.methods.registry import run_plugin
from roundel.solver.methods.roundel_fits import detect_circles, fit_detection, fit_points, with_estimated_curve
from roundel.solver.methods.shutter_motion import motions_of, shutter_key
from roundel.solver.methods.solve_together import with_one_plane
from roundel.solver.photometry.photometry import PLAIN, Photometry

Array = NDArray[np.float64]
Fits = list[EllipseFit | FailedFit]

NO_CIRCLE = "no circle found"


@dataclass(frozen=True, eq=False)
class SolverInput:
    """A frame to solve: an image or edge points, and the known data of camera and marker.

    Attributes
    ----------
    diameter_m : float
        Outer diameter of the printed circles.
    cameras : dict
        A camera for each intrinsics label.
    grey : (H, W) array or None
        Grey levels, linear in light; None if there are only points.
    saturation_dn : float
        The saturation level.
    photometry : Photometry
        The curve that was undone, the rounding of the levels, and the camera's processing.
    linearise : callable or None
        If the curve is to be estimated: returns grey levels and saturation level after a curve was undone. `grey` then
        has the levels as delivered.
    points_px : list of (N, 2) arrays
        Edge points of each circle, if there is no image.
    view : callable or None
        Returns the delivered image with a camera for a plug-in, as a new copy each time; None without one.
    frame_id : int
    """

    diameter_m: float
    cameras: Mapping[str, UncertainCamera]
    grey: NDArray[Any] | None = None
    saturation_dn: float = 255.0
    photometry: Photometry = PLAIN
    linearise: Callable[[ResponseCurve], tuple[NDArray[Any], float]] | None = None
    points_px: tuple[Array, ...] = ()
    view: Callable[[UncertainCamera], View] | None = None
    frame_id: int = 0


@dataclass(frozen=True, eq=False)
class SolvedFrame:
    """Estimates of one frame, the number of circles that Roundel's detector found, and its time.

    If none of Roundel's own methods ran, `detections` counts those of the first method and the first camera.
    """

    estimates: list[Estimate]
    detections: int
    detect_s: float
    pose_s: float


@one_blas_thread()
def solve_image(given: SolverInput, methods: Mapping[str, Finder | None], knowledge: Knowledge = None) -> SolvedFrame:
    """Solve every circle of a frame with every method and every camera.

    Roundel's own methods share one detection, and cameras with the same undistortion share one fit. A method that finds
    nothing gives one failed estimate per camera, with `detection_id` -1.

    Parameters
    ----------
    given : SolverInput
    methods : mapping
        See `load_methods`.
    knowledge : str, Evidence, a sequence of them, or None
        See `choose`.
    """
    started = time.perf_counter()
    fitted = [name for name, finder in methods.items() if finder is None]
    fits, about = _fits(given, fitted) if fitted and given.cameras else ({}, [])
    middle = time.perf_counter()
    estimates: list[Estimate] = []
    for name, finder in methods.items():
        for label, camera in given.cameras.items():
            if finder is None:
                estimates += _poses(given, fits[name, label], about, knowledge, (name, label))
            elif given.view is None:
                key = EstimateKey(given.frame_id, NOT_FOUND, name, label)
                estimates.append(Estimate(*key, "failed", f"{name}: needs an image, but there are only points"))
            else:
                estimates += run_plugin(name, finder, given.view(camera), camera, knowledge, given.frame_id, label)
    ended = time.perf_counter()
    first = (fitted or [*methods])[0], next(iter(given.cameras), "")
    found = {e.detection_id for e in estimates if (e.method, e.intrinsics) == first} - {NOT_FOUND}
    return SolvedFrame(estimates, len(found), middle - started, ended - middle)


def _fits(given: SolverInput, methods: list[str]) -> tuple[dict[tuple[str, str], Fits], list[tuple[Any, Any]]]:
    """The fits of each method and camera, one per detection, and for each detection its data and its image's."""
    if given.grey is None:
        points = given.points_px
        fits = _shared(given, methods, lambda c, m: [fit_points(p, None, c.camera, m) for p in points])
        return fits, [(None, None)] * len(points)
    seen = detect_circles(given.grey, given.saturation_dn, given.photometry, "edgedrawing" in methods)
    if given.linearise is not None:
        seen = with_estimated_curve(seen, given.linearise)
    found = seen.detections

    def fit(uncertain: UncertainCamera, method: str) -> Fits:
        ellipses = np.array([d.edges.ellipse for d in found]).reshape(-1, 5)
        motions = motions_of(uncertain, ellipses, given.diameter_m / 2)
        return [fit_detection(seen, d, uncertain.camera, method, m) for d, m in zip(found, motions, strict=True)]

    fits = _shared(given, methods, fit)
    return fits, [(d, seen) for d in found]


def _shared(
    given: SolverInput, methods: list[str], fit: Callable[[UncertainCamera, str], Fits]
) -> dict[tuple[str, str], Fits]:
    """Cameras with the same shutter and undistortion (no distortion, or the same K and lens model) share one fit."""
    made: dict[Any, Fits] = {}
    out = {}
    for method in methods:
        for label, uncertain in given.cameras.items():
            camera, lens = uncertain.camera, None
            if distorts(camera):
                lens = (tuple(camera.K.ravel().tolist()), camera.distortion_model, camera.distortion)
            key = method, lens, shutter_key(uncertain)
            if key not in made:
                made[key] = fit(uncertain, method)
            out[method, label] = made[key]
    return out


def _poses(
    given: SolverInput, fits: Fits, about: list[tuple[Any, Any]], knowledge: Knowledge, of: tuple[str, str]
) -> list[Estimate]:
    camera = given.cameras[of[1]]
    if not fits:
        key = EstimateKey(given.frame_id, NOT_FOUND, *of)
        return [Estimate(*key, "failed", NO_CIRCLE, camera=camera.camera)]
    poses = poses_of_fits(fits, camera, given.diameter_m / 2)
    alone = [
        estimate_of(fit, posed, camera, knowledge, EstimateKey(given.frame_id, n, *of), detection, seen)
        for n, (fit, posed, (detection, seen)) in enumerate(zip(fits, poses, about, strict=True))
    ]
    return with_one_plane(alone, fits, knowledge, camera, given.diameter_m / 2)
