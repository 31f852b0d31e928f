"""`locate`: the circles of one image, given as an array, with both poses of each."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, camera_problem
from roundel.scenes.camera.response_curve import LINEAR, UNKNOWN, ResponseCurve, parse_curve
from roundel.solver.ambiguity.disambiguation import Knowledge, check_knowledge
from roundel.solver.estimates import Estimate
from roundel.solver.intrinsics.specification import parse_intrinsics, uncertain_camera_for
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.plugin import View
from roundel.solver.methods.registry import NOTHING, load_methods
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD
from roundel.solver.methods.solve_image import NO_CIRCLE, SolverInput, solve_image
from roundel.solver.photometry.image_levels import averaged_rounding, encodable, grey_levels
from roundel.solver.photometry.photometry import Photometry, level_step


def locate(
    image: NDArray[Any],
    diameter_m: float,
    camera: Camera | UncertainCamera | None = None,
    curve: ResponseCurve | str | None = None,
    knowledge: Knowledge = None,
    method: str = DEFAULT_METHOD,
) -> list[Estimate]:
    """Find the circles of an image and estimate both poses of each.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Integer levels, or real numbers up to 1, 255 or 65,535; colours are averaged, a fourth channel is ignored.
    diameter_m : float
        Outer diameter of the printed circles; pass 1 if it is unknown to get lengths in diameters.
    camera : Camera or UncertainCamera, optional
        A `Camera` is taken as exact. Default: the default phone's focal length with its standard deviation, a centred
        principal point, square pixels, no distortion.
    curve : str or ResponseCurve, optional
        How levels depend on light: `linear` (most machine-vision cameras, raw data), `srgb` (what `cv2.imread` returns
        for almost every file), `gamma:2.2`, or `estimate`, the default: an array does not say what its levels are, so
        it is estimated from the edges of the circles, whatever the type of the array. Where they do not tell, the
        curve is unknown, linear or sRGB, and the covariance includes both. Arrays with negative levels, or levels
        beyond 65,535, are linear. `Estimate.curve` says what was used, and why.
    knowledge : str, Evidence, a sequence of them, or None
        Prior knowledge of the pose, see `choose`.
    method : str
        See `roundel.solver.methods.registry.installed_methods`; or a file, `path/to/file.py:function`.

    Returns
    -------
    list of Estimate
        The strongest detection first; empty if no circle is found.

    Raises
    ------
    ValueError
        If the image or camera is invalid, the diameter is not positive, or the camera is for another image size.
    UsageError
        If the knowledge, the method or the curve is unknown.
    """
    wanted = curve if isinstance(curve, ResponseCurve) or curve is None else parse_curve(curve)
    grey, full_scale_dn = grey_levels(image, wanted or UNKNOWN, keep_8bit=True)
    pixels = np.asarray(image)
    if wanted is None and not encodable(pixels):
        wanted = LINEAR.because("no encoded image has levels below 0 or beyond 65,535")
    if wanted is not None and not wanted.known:
        wanted = None  # `unknown` of an earlier estimate
    diameter_m = checked_diameter(diameter_m)
    check_knowledge(knowledge)
    methods = load_methods([method])
    label, uncertain = camera_of_image(camera, grey.shape[1], grey.shape[0])

    def view(given: UncertainCamera) -> View:
        return View(np.array(image), given.camera, diameter_m, [], full_scale_dn, wanted or UNKNOWN, given.focal_sigma)

    given = SolverInput(
        diameter_m,
        {label: uncertain},
        grey,
        full_scale_dn,
        Photometry(wanted or UNKNOWN, full_scale_dn, level_step(pixels, full_scale_dn), averaged_rounding(pixels)),
        None if wanted else lambda found: grey_levels(pixels, found),
        view=view,
    )
    nothing = (NO_CIRCLE, *(f"{name}: {NOTHING}" for name in methods))
    return [e for e in solve_image(given, methods, knowledge).estimates if e.reason not in nothing]


def camera_of_image(
    camera: Camera | UncertainCamera | None, width_px: int, height_px: int
) -> tuple[str, UncertainCamera]:
    """The label of the intrinsics and the camera with its standard deviations; ValueError if it is for another size."""
    if camera is None:
        return "default", uncertain_camera_for(parse_intrinsics("default"), None, width_px, height_px)
    uncertain = camera if isinstance(camera, UncertainCamera) else UncertainCamera(camera)
    _check_camera(uncertain.camera, width_px, height_px)
    return ("true" if uncertain.camera is camera else "assumed"), uncertain


def checked_diameter(diameter_m: float) -> float:
    """The diameter as a float; a ValueError if it is no positive number of metres."""
    try:
        value = float(diameter_m)
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not 1e-100 < value < 1e100:  # its square is in the covariance; the comparison also rejects NaN
        raise ValueError(f"the diameter must be a positive number of metres, not {diameter_m!r}")
    return value


def _check_camera(camera: Camera, width_px: int, height_px: int) -> None:
    if not isinstance(camera, Camera):
        raise ValueError(f"the camera must be a roundel.scenes.camera.model.Camera, not {type(camera).__name__}")
    problem = camera_problem(camera)
    if problem:
        raise ValueError(f"the camera is invalid: {problem}")
    # Principal point and focal length in pixels of another image size would give a plausible but wrong pose.
    if (camera.width_px, camera.height_px) != (width_px, height_px):
        raise ValueError(
            f"the camera is for {camera.width_px}x{camera.height_px} px, but the image has {width_px}x{height_px}; "
            "give the camera for the size of the image"
        )
