"""Errors of a pose and of an ellipse.

All functions are vectorised over frames (leading axes `...`) and accept any candidate. For errors that are lengths in
the image, both sides are first projected to the *delivered image*, each with its own camera: an application draws on
that image, and it is the only plane that two cameras share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera.model import Camera, distort_px, project, undistort_px
from roundel.scenes.geometry.conic import ellipse_points
from roundel.scenes.geometry.pose import angle_deg, minimal_rotation

Array = NDArray[np.float64]


def normal_error_deg(a: ArrayLike, b: ArrayLike) -> Array:
    """Angle between two normals.

    Parameters
    ----------
    a, b : (..., 3) array_like
        Unit vectors in the camera frame.

    Returns
    -------
    (...) array
        Degrees in [0, 180], by `atan2(|a x b|, a . b)`, because acos returns 0 below 1e-8 rad.

    Raises
    ------
    ValueError
        If the last axis of either is not 3.
    """
    u, v = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if u.shape[-1:] != (3,) or v.shape[-1:] != (3,):
        raise ValueError(f"normals have shapes {u.shape} and {v.shape}; the last axis must be 3")
    return angle_deg(u, v)


@dataclass(frozen=True)
class PositionErrors:
    """Errors of position, each (...): total, in two relative units, and by components relative to the true ray."""

    absolute_m: Array
    in_D: Array
    percent: Array
    along_ray_m: Array
    across_ray_m: Array


def position_errors(estimate_m: ArrayLike, truth_m: ArrayLike, diameter_m: ArrayLike) -> PositionErrors:
    """Errors of the circle's centre.

    Parameters
    ----------
    estimate_m, truth_m : (..., 3) array_like
        Centres in the camera frame, metres.
    diameter_m : (...) array_like
        NaN if the marker has none.

    Returns
    -------
    PositionErrors
        The paper's position error is `in_D` (errata, section 5, verdict 2: in percent, a wrong focal length gives a
        constant). `along_ray_m` is signed, positive if the estimate is too far.
    """
    truth = np.asarray(truth_m, dtype=np.float64)
    error = np.asarray(estimate_m, dtype=np.float64) - truth
    distance = np.linalg.norm(truth, axis=-1)
    ray = truth / distance[..., None]
    along = np.sum(error * ray, axis=-1)
    across = np.linalg.norm(error - along[..., None] * ray, axis=-1)
    absolute = np.linalg.norm(error, axis=-1)
    return PositionErrors(
        absolute, absolute / np.asarray(diameter_m, dtype=np.float64), 100.0 * absolute / distance, along, across
    )


# The grid's corners, edges and centre, in units of the extent.
_GRID = np.array([[x, y] for y in (1.0, 0.0, -1.0) for x in (-1.0, 0.0, 1.0)])


def reprojection_error_px(
    camera_from_marker: ArrayLike,
    camera_true: Camera,
    normal: ArrayLike,
    centre_m: ArrayLike,
    camera_used: Camera,
    extent_m: ArrayLike,
) -> Array:
    """Mean image distance over a 3x3 grid in the marker's plane.

    Parameters
    ----------
    camera_from_marker : (..., 4, 4) array_like
        True pose.
    camera_true : Camera
        The camera that took the image.
    normal, centre_m : (..., 3) array_like
        Estimated pose.
    camera_used : Camera
        The intrinsics with which the pose was estimated, right or wrong. A projection with the true ones would not
        describe the situation of a user without a calibration (errata, section 5, verdict 3).
    extent_m : (...) array_like
        Half side of the grid; default 3 diameters.

    Returns
    -------
    (...) array
        Pixels of the delivered image: true points are projected with the true camera's distortion, estimated points
        with that of the camera used (none for default intrinsics). NaN if a point of either grid is not in front of its
        camera.

    Notes
    -----
    The in-plane rotation of a plain circle is unobservable. The true grid is moved to the estimated plane by the
    minimal rotation between the normals, about the centre; the paper's beta = 0 gives the same within 1 % (errata).
    """
    pose = np.asarray(camera_from_marker, dtype=np.float64)
    n, c = np.asarray(normal, dtype=np.float64), np.asarray(centre_m, dtype=np.float64)
    flat = np.asarray(extent_m, dtype=np.float64)[..., None, None] * _GRID
    offsets = flat[..., :1] * pose[..., None, :3, 0] + flat[..., 1:] * pose[..., None, :3, 1]
    # Opposite normals have no minimal rotation; such a pair gets NaN instead of an error for all.
    opposite = np.sum(n * pose[..., :3, 2], axis=-1) < -1 + 1e-9
    rotation = minimal_rotation(pose[..., :3, 2], np.where(opposite[..., None], pose[..., :3, 2], n))
    carried = offsets @ np.swapaxes(rotation, -1, -2)
    true_px = project(camera_true, pose[..., None, :3, 3] + offsets)
    used_px = project(camera_used, c[..., None, :] + carried)
    error = np.linalg.norm(used_px - true_px, axis=-1).mean(axis=-1)
    return np.where(opposite, np.nan, error)


def pose_error_bounds(
    camera_from_marker: ArrayLike, normal: ArrayLike, centre_m: ArrayLike, information: ArrayLike
) -> Array:
    """Length of a pose's error in units of its Cramer-Rao bound: sqrt(e^T F e / 5).

    Parameters
    ----------
    camera_from_marker : (..., 4, 4) array_like
        True pose.
    normal, centre_m : (..., 3) array_like
        Estimated pose.
    information : (..., 5, 5) array_like
        Fisher information F at the true pose, from `scenes.information.contour_information`: rotation about the
        marker's X and Y axes (rad), centre (m) in the camera frame.

    Returns
    -------
    (...) array
        Dimensionless. For an efficient method, e^T F e is chi-square with 5 degrees of freedom, so the RMS is 1. NaN if
        F is NaN.

    Notes
    -----
    e is the error in the parameters of F: the rotation vector of the minimal rotation between the normals has no
    component along the marker's Z, and the in-plane rotation of a circle is unobservable. The normal and the position
    of a circle are correlated (a tilt looks like a shift), which this number includes and the two errors do not.
    """
    pose = np.asarray(camera_from_marker, dtype=np.float64)
    true_normal = pose[..., :3, 2]
    cross = np.cross(true_normal, np.asarray(normal, dtype=np.float64))
    sine = np.linalg.norm(cross, axis=-1)
    angle = np.arctan2(sine, np.sum(true_normal * np.asarray(normal, dtype=np.float64), axis=-1))
    # Opposite normals are half a turn apart about any axis of the plane; X is used.
    axis = np.where(sine[..., None] > 0, cross / np.where(sine > 0, sine, 1.0)[..., None], pose[..., :3, 0])
    turn = angle[..., None] * axis
    about = [np.sum(turn * pose[..., :3, i], axis=-1) for i in (0, 1)]
    shift = np.asarray(centre_m, dtype=np.float64) - pose[..., :3, 3]
    e = np.concatenate([np.stack(about, axis=-1), shift], axis=-1)
    power = np.einsum("...i,...ij,...j->...", e, np.asarray(information, dtype=np.float64), e)
    return np.asarray(np.sqrt(np.maximum(power, 0.0) / 5.0))


def ellipse_centre_offset_px(
    ellipse_true: ArrayLike, camera_true: Camera, ellipse: ArrayLike, camera_used: Camera
) -> Array:
    """From the centre of the true ellipse to that of the estimated one, (..., 2), in pixels of the delivered image.

    Each ellipse (..., 5) is in the undistorted pixel coordinates of its own camera. The centre of the ellipse is not
    the image of the circle's centre: this is a detection error, relative to the true ellipse's centre.
    """
    a = distort_px(camera_true, np.asarray(ellipse_true, dtype=np.float64)[..., :2])
    b = distort_px(camera_used, np.asarray(ellipse, dtype=np.float64)[..., :2])
    return np.asarray(b - a, dtype=np.float64)


def contour_error_px(contour_px: ArrayLike, ellipse: ArrayLike, camera_used: Camera) -> Array:
    """Mean distance from the true contour to the estimated ellipse, in pixels of the delivered image.

    Parameters
    ----------
    contour_px : (..., n, 2) array_like
        True contour in the delivered image, with its distortion; NaN points are left out.
    ellipse : (..., 5) array_like
        Estimated ellipse in the undistorted pixel coordinates of `camera_used`.
    camera_used : Camera

    Returns
    -------
    (...) array
        NaN if no point of the contour is finite.

    Notes
    -----
    The nearest point is found in undistorted coordinates and the distance measured in the image: over the few pixels of
    an error, distortion is a similarity, and the difference is of second order.
    """
    contour = np.asarray(contour_px, dtype=np.float64)
    foot = distort_px(camera_used, _nearest_on_ellipse(undistort_px(camera_used, contour), ellipse))
    distance = np.linalg.norm(foot - contour, axis=-1)
    finite = np.isfinite(distance)
    count = finite.sum(axis=-1)
    total = np.where(finite, distance, 0.0).sum(axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def contour_of_ellipse_px(ellipse: ArrayLike, camera_used: Camera, count: int = 256) -> Array:
    """Estimated contour (..., count, 2) in the delivered image: the ellipse through the distortion of `camera_used`."""
    return distort_px(camera_used, ellipse_points(ellipse, count))


def _nearest_on_ellipse(points: Array, ellipse: ArrayLike) -> Array:
    """Nearest point (..., n, 2) of an ellipse (..., 5) to each of points (..., n, 2).

    The ellipse is repeatedly replaced by its circle of curvature at the current foot point. Five steps reach 1e-9 of
    the major axis from outside: at a ratio of axes up to 2 from three axes away, up to 10 from 2 % of the axis away.
    """
    e = np.asarray(ellipse, dtype=np.float64)[..., None, :]
    angle = np.radians(e[..., 4])
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = points[..., 0] - e[..., 0], points[..., 1] - e[..., 1]
    u, v = cos * x + sin * y, cos * y - sin * x
    a, b = e[..., 2], e[..., 3]
    p, q = np.abs(u), np.abs(v)
    length = np.hypot(p * b, q * a)
    safe = np.where(length > 0, length, 1.0)
    s, t = np.where(length > 0, p * b / safe, 1.0), np.where(length > 0, q * a / safe, 0.0)
    excess = a * a - b * b
    for _ in range(5):
        # From the centre of curvature, one radius of curvature in the direction of the point.
        cx, cy = excess * s**3 / a, -excess * t**3 / b
        radius = np.hypot(a * s - cx, b * t - cy)
        away = np.hypot(p - cx, q - cy)
        ratio = radius / np.where(away > 0, away, 1.0)
        s = np.clip(((p - cx) * ratio + cx) / a, 0.0, 1.0)
        t = np.clip(((q - cy) * ratio + cy) / b, 0.0, 1.0)
        norm = np.hypot(s, t)
        norm = np.where(norm > 0, norm, 1.0)
        s, t = s / norm, t / norm
    fu, fv = np.copysign(a * s, u), np.copysign(b * t, v)
    return np.stack([e[..., 0] + cos * fu - sin * fv, e[..., 1] + sin * fu + cos * fv], axis=-1)
