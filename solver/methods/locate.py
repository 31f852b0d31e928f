"""The whole chain for one image in one call: detect, fit, pose, choose."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, camera_problem
from roundel.solver.ambiguity.disambiguation import Knowledge, check_knowledge
from roundel.solver.estimates import Estimate
from roundel.solver.fit.image_levels import grey_levels
from roundel.solver.intrinsics.specification import assumed_camera_for, parse_intrinsics
from roundel.solver.intrinsics.uncertain_camera import AssumedCamera
from roundel.solver.methods.plugin import View
from roundel.solver.methods.pose_estimate import estimate_of
from roundel.solver.methods.registry import find, finder_of
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD, fit_detection, look_at


def locate(
    image: NDArray[Any],
    diameter_m: float,
    camera: Camera | AssumedCamera | None = None,
    knowledge: Knowledge = None,
    method: str = DEFAULT_METHOD,
) -> list[Estimate]:
    """Find the circles of an image and estimate both poses of each.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Integer levels, or real numbers up to 1, 255 or 65,535; colours are averaged, a fourth channel is left out.
        Levels are taken as proportional to light: of a photograph, `read_photo` undoes the curve.
    diameter_m : float
        Outer diameter of the printed circles; 1 for an unknown one, and lengths are in diameters.
    camera : Camera or AssumedCamera, optional
        A `Camera` is taken as exact. Left out: the default phone's focal length with its spread, a centred principal
        point, square pixels, no distortion.
    knowledge : str, Evidence, a sequence of them, or None
        What is known of the pose, see `choose`.
    method : str
        See `roundel.solver.methods.registry.installed_methods`.

    Returns
    -------
    list of Estimate
        The strongest detection first; empty if there is none.

    Raises
    ------
    ValueError
        If the image is not one, the diameter is not positive, or the camera is not one or of another image size.
    UsageError
        If the knowledge or the method is of no known kind.
    """
    grey, full_scale_dn = grey_levels(image)
    diameter_m = _diameter(diameter_m)
    check_knowledge(knowledge)
    finder = finder_of(method)
    label, assumed = _assumed(camera, grey.shape[1], grey.shape[0])
    if finder is not None:
        pixels = np.array(image)  # a copy: the method may write into it
        view = View(pixels, assumed.camera, diameter_m, saturation_dn=full_scale_dn)
        return find(method, finder, view, assumed, knowledge, 0, label)
    seen = look_at(grey, full_scale_dn)
    out = []
    for i, detection in enumerate(seen.detections):
        fit = fit_detection(seen, detection, assumed.camera, method)
        out.append(estimate_of(fit, assumed, diameter_m, knowledge, (0, i, method, label), detection, grey))
    return out


def _assumed(camera: Camera | AssumedCamera | None, width_px: int, height_px: int) -> tuple[str, AssumedCamera]:
    """The label of the intrinsics, and the camera with its spreads."""
    if camera is None:
        return "default", assumed_camera_for(parse_intrinsics("default"), None, width_px, height_px)
    assumed = camera if isinstance(camera, AssumedCamera) else AssumedCamera(camera)
    _check_camera(assumed.camera, width_px, height_px)
    return ("true" if assumed.camera is camera else "assumed"), assumed


def _diameter(diameter_m: float) -> float:
    try:
        value = float(diameter_m)
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not 1e-100 < value < 1e100:  # its square is in the covariance; NaN is no number between
        raise ValueError(f"the diameter must be a positive number of metres, not {diameter_m!r}")
    return value


def _check_camera(camera: Camera, width_px: int, height_px: int) -> None:
    if not isinstance(camera, Camera):
        raise ValueError(f"the camera must be a roundel.scenes.camera.model.Camera, not {type(camera).__name__}")
    problem = camera_problem(camera)
    if problem:
        raise ValueError(f"the camera is not one: {problem}")
    # Its principal point and focal length are in pixels of another image: the pose would only look right.
    if (camera.width_px, camera.height_px) != (width_px, height_px):
        raise ValueError(
            f"the camera is of {camera.width_px}x{camera.height_px} px, but the image has {width_px}x{height_px}; "
            "give the camera at the size of the image"
        )
