"""The camera: intrinsics, the lens model and the thin lens, in float64.

Camera frame: x right, y down, z forward. Pixels: the centre of the top-left pixel is (0, 0).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera.lens_fisheye import direction as fisheye_direction
from roundel.scenes.camera.lens_fisheye import distort as fisheye_distort
from roundel.scenes.camera.lens_fisheye import undistort as fisheye_undistort
from roundel.scenes.camera.lens_opencv import distort as opencv_distort
from roundel.scenes.camera.lens_opencv import undistort as opencv_undistort
from roundel.scenes.errors import DataError

Array = NDArray[np.float64]

# Thin-lens rays converge on the plane in focus; toward 90 degrees from the axis that plane is at infinity.
THIN_LENS_DEG = 85.0

# Numbers of coefficients of each lens model (OpenCV, module calib3d; module calib3d, "Fisheye camera model").
COEFFICIENTS = {"opencv": (0, 4, 5, 8, 12, 14), "fisheye": (4,)}


@dataclass(frozen=True)
class Camera:
    """A camera as one record.

    Attributes
    ----------
    width_px, height_px : int
    K : (3, 3) array
        Calibration matrix at focus, in pixels, upper triangular, K[2, 2] = 1. Nested lists of numbers are taken, too.
    distortion : tuple of float
        Coefficients of the model in OpenCV's order (k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty, the tilts in radians;
        fisheye: k1 k2 k3 k4); empty for none.
    aperture_radius_m : float
        Radius of the thin lens's aperture; 0 is a pinhole.
    focus_distance_m : float
        Distance of the plane in focus from the camera centre, along z.
    focal_35mm_mm : float or None
        Value of the EXIF tag `FocalLengthIn35mmFilm`.
    distortion_model : str
        `opencv` (0, 4, 5, 8, 12 or 14 coefficients) or `fisheye` (4).
    blades : int
        Number of corners of the aperture, on the circle of its radius; 0 is a round aperture.
    blade_turn_deg : float
        Angle of the first corner, +x toward +y.
    wavelengths_m : tuple of float
        Wavelengths of the diffracted light; empty for geometric optics. Three wavelengths with a mosaic are red, green
        and blue, otherwise they are an even mixture.
    natural_vignetting : bool
        Whether the image darkens by cos^4 of the field angle.
    barrel_radius_m, barrel_length_m : float
        Front opening of the lens barrel and its distance in front of the aperture; infinite radius for none.
    pixel_side : float
        Side of the square part of a pixel that collects light, in pixels (the square root of the fill factor).
    magnification : tuple of float
        Magnification of red, green and blue behind a mosaic, relative to K, about the principal point; empty for a lens
        without lateral chromatic aberration.
    """

    width_px: int
    height_px: int
    K: Array
    distortion: tuple[float, ...] = field(default=())
    aperture_radius_m: float = 0.0
    focus_distance_m: float = float("inf")
    focal_35mm_mm: float | None = None
    distortion_model: str = "opencv"
    blades: int = 0
    blade_turn_deg: float = 0.0
    wavelengths_m: tuple[float, ...] = field(default=())
    natural_vignetting: bool = False
    barrel_radius_m: float = float("inf")
    barrel_length_m: float = 0.0
    pixel_side: float = 1.0
    magnification: tuple[float, ...] = field(default=())

    def __post_init__(self) -> None:
        with suppress(TypeError, ValueError):  # `camera_problem` says what is wrong with it
            object.__setattr__(self, "K", np.asarray(self.K, dtype=np.float64))


def principal_point_at_centre(width_px: int, height_px: int) -> tuple[float, float]:
    """Image centre in pixels, ((W - 1) / 2, (H - 1) / 2)."""
    return (width_px - 1) / 2, (height_px - 1) / 2


def focal_at_focus_px(focal_mm: float, focus_distance_m: float, pixel_pitch_um: float) -> float:
    """Focal length in pixels of a thin lens focused at u: fx = v / pitch, v = f u / (u - f).

    Raises
    ------
    ValueError
        If the focus is inside the focal length, where no image forms.
    """
    if not focus_distance_m * 1e3 > focal_mm:
        raise ValueError(f"focus at {focus_distance_m} m is inside the focal length of {focal_mm} mm; increase it")
    image_distance_mm = focal_mm / (1.0 - focal_mm * 1e-3 / focus_distance_m)
    return image_distance_mm * 1e3 / pixel_pitch_um


def camera_of_colour(camera: Camera, colour: int) -> Camera:
    """The camera as the pixels of one filter (0 red, 1 green, 2 blue) see it: its image magnified, distortion and all.

    A magnification about the principal point is one of the focal lengths and the skew.
    """
    if not camera.magnification:
        return camera
    k = camera.K.copy()
    k[:2, :2] *= camera.magnification[colour]
    return replace(camera, K=k, magnification=())


def lateral_shift_px(camera: Camera) -> float:
    """Largest distance in the image between an edge in green and in another colour, px."""
    corners = [(u, v) for u in (0, camera.width_px - 1) for v in (0, camera.height_px - 1)]
    farthest = np.linalg.norm(np.array(corners) - camera.K[:2, 2], axis=1).max()
    return float(max((abs(m - 1) for m in camera.magnification), default=0.0) * farthest)


def distorts(camera: Camera) -> bool:
    """Whether image and undistorted pixels differ. A fisheye without coefficients still distorts: theta_d = theta.

    Raises
    ------
    ValueError
        If the model is unknown, or the number of coefficients is wrong.
    """
    problem = lens_problem(camera.distortion_model, camera.distortion)
    if problem:
        raise ValueError(problem)
    return camera.distortion_model == "fisheye" or any(camera.distortion)


def camera_problem(camera: Camera) -> str:
    """Problem with a camera's K or lens model, in one clause; empty if there is none."""
    try:
        k = np.asarray(camera.K, dtype=np.float64)
    except (TypeError, ValueError):
        return "K must be a finite 3x3 matrix with positive focal lengths"
    if k.shape != (3, 3) or not np.all(np.isfinite(k)) or k[0, 0] <= 0 or k[1, 1] <= 0:
        return "K must be a finite 3x3 matrix with positive focal lengths"
    if k[1, 0] != 0 or k[2, 0] != 0 or k[2, 1] != 0 or k[2, 2] != 1:
        return "K must be upper triangular with K[2][2] = 1"
    return lens_problem(camera.distortion_model, camera.distortion)


def lens_problem(model: str, distortion: tuple[float, ...]) -> str:
    """Problem with a lens model, in one clause; empty if there is none."""
    if model not in COEFFICIENTS:
        return f"distortion_model {model!r} is unknown; use {' or '.join(COEFFICIENTS)}"
    counts = COEFFICIENTS[model]
    if len(distortion) not in counts:
        return f"distortion has {len(distortion)} coefficients; {model} takes {', '.join(map(str, counts))}"
    return "" if np.all(np.isfinite(distortion)) else "distortion has a coefficient that is not finite"


def distort_normalised(camera: Camera, xy: ArrayLike) -> tuple[Array, Array]:
    """Image of normalised coordinates, and the Jacobian.

    Parameters
    ----------
    camera : Camera
    xy : (..., 2) array_like

    Returns
    -------
    distorted : (..., 2) array
    jacobian : (..., 2, 2) array
        d distorted / d xy. Both are NaN outside the lens's field (see `distort_px`).
    """
    p = np.asarray(xy, dtype=np.float64)
    if not distorts(camera):
        return p.copy(), np.broadcast_to(np.eye(2), (*p.shape, 2)).copy()
    lens = fisheye_distort if camera.distortion_model == "fisheye" else opencv_distort
    return lens(camera.distortion, p)


def undistort_normalised(camera: Camera, xy: ArrayLike) -> Array:
    """The inverse of `distort_normalised`, (..., 2): NaN where no point of the lens's field is imaged."""
    p = np.asarray(xy, dtype=np.float64)
    if not distorts(camera):
        return p.copy()
    lens = fisheye_undistort if camera.distortion_model == "fisheye" else opencv_undistort
    return lens(camera.distortion, p)


def normalise(camera: Camera, undistorted_px: ArrayLike) -> Array:
    """Undistorted pixel coordinates (..., 2) to normalised coordinates (x/z, y/z), (..., 2)."""
    px = np.asarray(undistorted_px, dtype=np.float64)
    k = camera.K
    y = (px[..., 1] - k[1, 2]) / k[1, 1]
    x = (px[..., 0] - k[0, 2] - k[0, 1] * y) / k[0, 0]
    return np.stack([x, y], axis=-1)


def denormalise(camera: Camera, xy: ArrayLike) -> Array:
    """Normalised coordinates (..., 2) to undistorted pixel coordinates (..., 2)."""
    p = np.asarray(xy, dtype=np.float64)
    k = camera.K
    return np.stack([k[0, 0] * p[..., 0] + k[0, 1] * p[..., 1] + k[0, 2], k[1, 1] * p[..., 1] + k[1, 2]], axis=-1)


def distort_px(camera: Camera, undistorted_px: ArrayLike) -> Array:
    """Undistorted pixel coordinates to image pixels.

    Parameters
    ----------
    camera : Camera
    undistorted_px : (..., 2) array_like
        Pixel coordinates under K alone.

    Returns
    -------
    (..., 2) array
        Their images, in pixels; NaN outside the lens's field. A polynomial describes a lens only as far out as it
        increases: beyond, points far outside the view would be imaged inside the image again.
    """
    if not distorts(camera):
        return np.array(undistorted_px, dtype=np.float64)
    return denormalise(camera, distort_normalised(camera, normalise(camera, undistorted_px))[0])


def undistort_px(camera: Camera, image_px: ArrayLike) -> Array:
    """Image pixels to undistorted pixel coordinates (same K): the inverse of `distort_px`.

    Parameters
    ----------
    camera : Camera
    image_px : (..., 2) array_like

    Returns
    -------
    (..., 2) array
        Exact to rounding; NaN where the lens images nothing, and at 90 degrees from a fisheye's axis and beyond.
    """
    if not distorts(camera):
        return np.array(image_px, dtype=np.float64)
    return denormalise(camera, undistort_normalised(camera, normalise(camera, image_px)))


def ray_direction(camera: Camera, image_px: ArrayLike) -> Array:
    """Unit vectors (..., 3) from the camera centre through image pixels (..., 2); NaN where the lens images nothing.

    Only rays can describe what a fisheye sees at 90 degrees from its axis and beyond.
    """
    xy = normalise(camera, image_px)
    if camera.distortion_model == "fisheye" and distorts(camera):
        return fisheye_direction(camera.distortion, xy)
    straight = undistort_normalised(camera, xy)
    ray = np.concatenate([straight, np.ones_like(straight[..., :1])], axis=-1)
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))


def project(camera: Camera, points_m: ArrayLike) -> Array:
    """Camera-frame points to image pixels, through the distortion.

    Parameters
    ----------
    camera : Camera
    points_m : (..., 3) array_like
        In the camera frame, metres.

    Returns
    -------
    (..., 2) array
        Pixels; NaN for points that are not in front of the camera, or outside the lens's field.
    """
    p = np.asarray(points_m, dtype=np.float64)
    z = np.where(p[..., 2] > 0, p[..., 2], np.nan)
    return distort_px(camera, denormalise(camera, p[..., :2] / z[..., None]))


def sees_through_thin_lens(camera: Camera) -> bool:
    """Whether the whole field of view is within `THIN_LENS_DEG` of the axis."""
    corners = [(u, v) for u in (-0.5, camera.width_px - 0.5) for v in (-0.5, camera.height_px - 0.5)]
    return bool(np.all(ray_direction(camera, np.array(corners))[:, 2] > np.cos(np.radians(THIN_LENS_DEG))))


def folds_inside_image(camera: Camera) -> bool:
    """Whether part of the image is outside the lens's field, where the distortion has no inverse."""
    if not distorts(camera):
        return False
    return _folds(
        camera.width_px, camera.height_px, tuple(camera.K.ravel()), camera.distortion_model, camera.distortion
    )


@lru_cache(maxsize=64)
def _folds(width_px: int, height_px: int, k: tuple[float, ...], model: str, distortion: tuple[float, ...]) -> bool:
    camera = Camera(width_px, height_px, np.reshape(k, (3, 3)), distortion, distortion_model=model)
    # The field is star-shaped about the axis: a gap appears first at the image border, which is sampled at every 64th
    # of a side; a coarser grid checks the interior.
    u, v = np.linspace(-0.5, width_px - 0.5, 65), np.linspace(-0.5, height_px - 0.5, 65)
    points = [np.stack(np.meshgrid(a, b), axis=-1).reshape(-1, 2) for a, b in ((u[[0, -1]], v), (u, v[[0, -1]]))]
    points.append(np.stack(np.meshgrid(u[::4], v[::4]), axis=-1).reshape(-1, 2))
    return not bool(np.all(np.isfinite(ray_direction(camera, np.concatenate(points)))))


def camera_to_json(camera: Camera) -> dict[str, Any]:
    """The camera as stored in `cameras.json` (without the aperture, which a solver does not need).

    K and distortion are those of green if a lens has lateral chromatic aberration.
    """
    aberration = {"lateral_ca": [camera.magnification[0], camera.magnification[2]]} if camera.magnification else {}
    return {
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "K": [[float(v) for v in row] for row in camera.K],
        "distortion_model": camera.distortion_model if distorts(camera) or camera.distortion else "none",
        "distortion": [float(v) for v in camera.distortion],
        "exif": {} if camera.focal_35mm_mm is None else {"focal_35mm_mm": camera.focal_35mm_mm},
        **aberration,
    }


def camera_from_json(record: dict[str, Any]) -> Camera:
    """Read the keys that `camera_to_json` writes; other keys are ignored.

    Raises
    ------
    DataError
        If a key is missing, K is not an upper triangular calibration matrix, the lens model is unknown, or the number
        of coefficients is wrong.
    """
    try:
        width_px, height_px = int(record["width_px"]), int(record["height_px"])
        k = np.array(record["K"], dtype=np.float64)
        distortion = tuple(float(v) for v in record.get("distortion", []))
        model = record.get("distortion_model", "opencv")
        exif = record.get("exif") or {}
        focal_35mm_mm = exif.get("focal_35mm_mm")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError(f"camera record: {type(error).__name__} at {error}; it needs width_px, height_px, K") from error
    if width_px <= 0 or height_px <= 0:
        raise DataError("camera record: width_px and height_px must be positive")
    if model == "none":
        if distortion:
            raise DataError(f"camera record: distortion_model none takes no coefficients, not {len(distortion)}")
        model = "opencv"
    focal = None if focal_35mm_mm is None else float(focal_35mm_mm)
    camera = Camera(width_px, height_px, k, distortion, focal_35mm_mm=focal, distortion_model=str(model))
    problem = camera_problem(camera)
    if problem:
        raise DataError(f"camera record: {problem}")
    return camera
