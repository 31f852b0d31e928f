"""The camera: intrinsics, OpenCV's five-coefficient distortion and the thin lens, in float64.

Camera frame: x right, y down, z forward. Pixels: the centre of the top-left pixel is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.errors import DataError

Array = NDArray[np.float64]

# Newton's method doubles its digits a step: from the distorted point itself, within any invertible
# field, eight steps reach the last bit; the loop ends earlier when nothing moves.
_NEWTON_STEPS = 20


@dataclass(frozen=True)
class Camera:
    """A camera as one record.

    Attributes
    ----------
    width_px, height_px : int
    K : (3, 3) array
        Calibration matrix at focus, in pixels, upper triangular, K[2, 2] = 1.
    distortion : tuple of float
        OpenCV's coefficients in OpenCV's order; empty for none.
    aperture_radius_m : float
        Radius of the thin lens's aperture; 0 is a pinhole.
    focus_distance_m : float
        Distance of the plane in focus from the camera centre, along z.
    focal_35mm_mm : float or None
        What the EXIF tag `FocalLengthIn35mmFilm` would say.
    distortion_model : str
        `opencv` (0, 4, 5, 8, 12 or 14 coefficients) or `fisheye` (4).
    blades : int
        Corners of the aperture, on the circle of its radius; 0 is a round one.
    blade_turn_deg : float
        Angle of the first corner, +x toward +y.
    wavelengths_m : tuple of float
        Of the light that is diffracted by the aperture; empty for geometric optics. With three and a mosaic they are
        red, green and blue, otherwise an even mixture.
    natural_vignetting : bool
        Whether the image darkens by cos^4 of the field angle.
    barrel_radius_m, barrel_length_m : float
        Front opening of the lens barrel and its distance before the aperture; infinite radius for none.
    pixel_side : float
        Side of the square part of a pixel that collects light, in pixels (the square root of the fill factor).
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


def principal_point_at_centre(width_px: int, height_px: int) -> tuple[float, float]:
    """Image centre in pixels, ((W - 1) / 2, (H - 1) / 2)."""
    return (width_px - 1) / 2, (height_px - 1) / 2


def focal_at_focus_px(focal_mm: float, focus_distance_m: float, pixel_pitch_um: float) -> float:
    """Focal length in pixels of a thin lens focused at u: fx = v / pitch, v = f u / (u - f).

    Raises
    ------
    ValueError
        If the focus lies inside the focal length, where no image forms.
    """
    if not focus_distance_m * 1e3 > focal_mm:
        raise ValueError(f"focus at {focus_distance_m} m lies inside the focal length of {focal_mm} mm; focus farther")
    image_distance_mm = focal_mm / (1.0 - focal_mm * 1e-3 / focus_distance_m)
    return image_distance_mm * 1e3 / pixel_pitch_um


def _coefficients(camera: Camera) -> tuple[float, float, float, float, float]:
    d = camera.distortion
    if len(d) not in (0, 4, 5):
        raise ValueError(f"distortion has {len(d)} coefficients; give k1, k2, p1, p2 and perhaps k3")
    k1, k2, p1, p2, k3 = (*d, 0.0) if len(d) == 4 else (d or (0.0,) * 5)
    return k1, k2, p1, p2, k3


def distort_normalised(distortion: tuple[float, ...], xy: Array) -> tuple[Array, Array]:
    """Brown-Conrady distortion of normalised coordinates, and its Jacobian.

    Source: OpenCV, module calib3d, "Detailed description" (k1, k2, p1, p2, k3).

    Returns
    -------
    distorted : (..., 2) array
    jacobian : (..., 2, 2) array
        d distorted / d xy.
    """
    k1, k2, p1, p2, k3 = (tuple(distortion) + (0.0,) * 5)[:5]
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))  # d radial / d(r2), doubled: d(r2) = 2 x dx
    out = np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    cross = x * y * slope + 2 * p1 * x + 2 * p2 * y
    jacobian = np.stack(
        [
            np.stack([radial + x * x * slope + 2 * p1 * y + 6 * p2 * x, cross], axis=-1),
            np.stack([cross, radial + y * y * slope + 6 * p1 * y + 2 * p2 * x], axis=-1),
        ],
        axis=-2,
    )
    return out, jacobian


def _undistort_normalised(distortion: tuple[float, ...], xy: Array) -> Array:
    guess = xy.copy()
    for _ in range(_NEWTON_STEPS):
        value, jacobian = distort_normalised(distortion, guess)
        # A fold (singular Jacobian) leaves NaN, which the caller reports; it must not raise here.
        a, b = jacobian[..., 0, 0], jacobian[..., 0, 1]
        c, d = jacobian[..., 1, 0], jacobian[..., 1, 1]
        miss = xy - value
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            determinant = a * d - b * c
            step = np.stack([d * miss[..., 0] - b * miss[..., 1], a * miss[..., 1] - c * miss[..., 0]], axis=-1)
            step /= determinant[..., None]
            guess = guess + step
        if np.nanmax(np.abs(step), initial=0.0) < 1e-15:
            break
    return guess


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
        Where the lens images them, in pixels.
    """
    _coefficients(camera)
    if not any(camera.distortion):
        return np.array(undistorted_px, dtype=np.float64)
    distorted, _ = distort_normalised(camera.distortion, normalise(camera, undistorted_px))
    return denormalise(camera, distorted)


def undistort_px(camera: Camera, image_px: ArrayLike) -> Array:
    """Image pixels to undistorted pixel coordinates (same K): the inverse of `distort_px`.

    Parameters
    ----------
    camera : Camera
    image_px : (..., 2) array_like

    Returns
    -------
    (..., 2) array
        By Newton's method; NaN where the distortion folds and has no inverse.
    """
    _coefficients(camera)
    if not any(camera.distortion):
        return np.array(image_px, dtype=np.float64)
    return denormalise(camera, _undistort_normalised(camera.distortion, normalise(camera, image_px)))


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
        Pixels; NaN for points that are not in front of the camera.
    """
    p = np.asarray(points_m, dtype=np.float64)
    z = np.where(p[..., 2] > 0, p[..., 2], np.nan)
    return distort_px(camera, denormalise(camera, p[..., :2] / z[..., None]))


def _determinant(jacobian: Array) -> Array:
    value: Array = jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0]
    return value


def folds_inside_image(camera: Camera) -> bool:
    """Whether the distortion cannot be inverted somewhere in the image (a mirrored or folded field)."""
    if not any(camera.distortion):
        return False
    return _folds(camera.width_px, camera.height_px, tuple(camera.K.ravel()), camera.distortion)


@lru_cache(maxsize=64)
def _folds(width_px: int, height_px: int, k: tuple[float, ...], distortion: tuple[float, ...]) -> bool:
    camera = Camera(width_px, height_px, np.reshape(k, (3, 3)), distortion)
    # The determinant is smooth: a grid of 25 x 25 points over the image sees any sign change that matters.
    grid = np.stack(np.meshgrid(np.linspace(-0.5, width_px - 0.5, 25), np.linspace(-0.5, height_px - 0.5, 25)), axis=-1)
    xy = normalise(camera, undistort_px(camera, grid))
    if not np.all(np.isfinite(xy)):
        return True
    back, _ = distort_normalised(distortion, xy)
    # Behind a fold another branch can answer exactly: walk from the axis to the point and look for a sign change.
    walk = np.linspace(0, 1, 33)[:, None, None, None] * xy
    _, along = distort_normalised(distortion, walk)
    return bool(np.abs(denormalise(camera, back) - grid).max() > 1e-6 or _determinant(along).min() <= 0)


def camera_to_json(camera: Camera) -> dict[str, Any]:
    """The camera as it stands in `cameras.json` (the lens's aperture is no business of a solver)."""
    return {
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "K": [[float(v) for v in row] for row in camera.K],
        "distortion_model": "opencv" if camera.distortion else "none",
        "distortion": [float(v) for v in camera.distortion],
        "exif": {} if camera.focal_35mm_mm is None else {"focal_35mm_mm": camera.focal_35mm_mm},
    }


def camera_from_json(record: dict[str, Any]) -> Camera:
    """Read the keys that `camera_to_json` writes; other keys are left alone.

    Raises
    ------
    DataError
        If a key is missing or K is not an upper triangular calibration matrix.
    """
    try:
        width_px, height_px = int(record["width_px"]), int(record["height_px"])
        k = np.array(record["K"], dtype=np.float64)
        distortion = tuple(float(v) for v in record.get("distortion", []))
        exif = record.get("exif") or {}
        focal_35mm_mm = exif.get("focal_35mm_mm")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError(f"camera record: {type(error).__name__} at {error}; it needs width_px, height_px, K") from error
    if k.shape != (3, 3) or not np.all(np.isfinite(k)) or k[0, 0] <= 0 or k[1, 1] <= 0:
        raise DataError("camera record: K must be a finite 3x3 matrix with positive focal lengths")
    if k[1, 0] != 0 or k[2, 0] != 0 or k[2, 1] != 0 or k[2, 2] != 1:
        raise DataError("camera record: K must be upper triangular with K[2][2] = 1")
    if width_px <= 0 or height_px <= 0 or len(distortion) not in (0, 4, 5) or not np.all(np.isfinite(distortion)):
        raise DataError("camera record: needs a positive size and 0, 4 or 5 finite distortion coefficients")
    return Camera(
        width_px, height_px, k, distortion, focal_35mm_mm=None if focal_35mm_mm is None else float(focal_35mm_mm)
    )
