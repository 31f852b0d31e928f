"""Both poses of a plane from points on it: Collins and Bartoli, Infinitesimal Plane-based Pose Estimation (2014).

The image of a small plane has two local minima of the reprojection error, mirrored about the line of sight. OpenCV's
`solvePnPGeneric` finds both; each is refined here in float64 by Levenberg-Marquardt, with or without the focal length.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera.model import Camera, denormalise
from roundel.scenes.geometry.pose import angle_deg

Array = NDArray[np.float64]

ITERATIONS = 50
# The iteration ends when a step promises to lower chi^2 by less than this part of it, or turns by less than this angle
# (rad) and moves by less than this part of the distance: the residuals are then rounding.
LEAST_DECREASE, LEAST_STEP = 1e-14, 1e-13
# Two minima closer than this are one.
SAME_POSE_DEG = 1e-3


@dataclass(frozen=True, eq=False)
class PlanePose:
    """A pose of a plane.

    Attributes
    ----------
    camera_from_marker : (4, 4) array
    chi2 : float
        Sum of squared residuals, each divided by its standard deviation.
    information : (6, 6) or (7, 7) array
        Fisher information of rotation (in the camera frame, rad), translation (m) and, if it is free, the logarithm of
        the focal length.
    log_scale : float
        Logarithm of the focal length over the camera's.
    """

    camera_from_marker: Array
    chi2: float
    information: Array
    log_scale: float = 0.0

    @property
    def normal(self) -> Array:
        """Out of the printed face, in the camera frame."""
        return self.camera_from_marker[:3, 2]

    @property
    def centre_m(self) -> Array:
        """Origin of the marker in the camera frame."""
        return self.camera_from_marker[:3, 3]


@dataclass(frozen=True, eq=False)
class PlanePoints:
    """Points of a plane and their images.

    Attributes
    ----------
    points_m : (N, 3) array
        In the marker frame, Z = 0.
    pixels : (N, 2) array
        Undistorted pixels of `camera`.
    whitener : (2N, 2N) array
        W with W^T W the inverse covariance of the pixels x0, y0, x1, ...
    camera : Camera
        Its K; the lens is taken as undone.
    """

    points_m: Array
    pixels: Array
    whitener: Array
    camera: Camera


def plane_points(points_m: ArrayLike, pixels: ArrayLike, camera: Camera, cov_px2: ArrayLike = 1.0) -> PlanePoints:
    """Points with the covariance of their images: a variance (px^2), or (2N, 2N).

    Raises
    ------
    ValueError
        If there are fewer than four points, or a pixel is not finite.
    """
    points, pixel = np.asarray(points_m, dtype=np.float64), np.asarray(pixels, dtype=np.float64)
    if len(points) < 4 or len(points) != len(pixel) or not np.all(np.isfinite(pixel)):
        raise ValueError("a plane's pose needs four or more points that the lens images")
    cov = np.asarray(cov_px2, dtype=np.float64)
    if cov.ndim == 0:
        return PlanePoints(points, pixel, np.eye(2 * len(points)) / np.sqrt(float(cov)), camera)
    return PlanePoints(points, pixel, np.linalg.inv(np.linalg.cholesky(cov)), camera)


def plane_poses(given: PlanePoints, log_scale: float = 0.0, square: bool = False) -> list[PlanePose]:
    """Poses in front of the camera that see the printed face: up to two, the better first.

    Parameters
    ----------
    given : PlanePoints
    log_scale : float
        Logarithm of the focal length over the camera's.
    square : bool
        Whether the points are the corners of a square, from the top left clockwise as seen by a reader.
    """
    # Normalised by the asked focal length, so that OpenCV needs no camera.
    xy = normalised(given, log_scale).reshape(-1, 1, 2)
    flag = cv2.SOLVEPNP_IPPE_SQUARE if square else cv2.SOLVEPNP_IPPE
    points = np.ascontiguousarray(given.points_m)
    found, rotations, translations, _ = cv2.solvePnPGeneric(points, xy, np.eye(3), None, flags=flag)
    if not found:
        return []
    poses = []
    for rotation, translation in zip(rotations, translations, strict=True):
        start = np.eye(4)
        start[:3, :3], start[:3, 3] = cv2.Rodrigues(rotation)[0], np.ravel(translation)
        if not np.all(np.isfinite(start)):
            continue
        pose = refined_pose(given, start, log_scale)
        if pose is not None and pose.centre_m[2] > 0 and pose.normal @ pose.centre_m < 0:
            poses.append(pose)
    poses.sort(key=lambda pose: pose.chi2)
    if len(poses) == 2 and angle_deg(poses[0].normal, poses[1].normal) < SAME_POSE_DEG:
        return poses[:1]
    return poses


def refined_pose(given: PlanePoints, start: Array, log_scale: float = 0.0, free: bool = False) -> PlanePose | None:
    """The minimum of the weighted reprojection error next to a pose; `free`: over the focal length, too.

    Returns
    -------
    PlanePose or None
        None if the iteration leaves the half space before the camera.
    """
    pose, scale = start.copy(), log_scale
    now = _residual(given, pose, scale, free)
    if now is None:
        return None
    damping = 1e-6
    for _ in range(ITERATIONS):
        residual, jacobian = now
        chi2, gradient, normal = float(residual @ residual), jacobian.T @ residual, jacobian.T @ jacobian
        diagonal = np.diagonal(normal)
        step = -np.linalg.solve(normal + np.diag(damping * diagonal + 1e-15 * diagonal.max()), gradient)
        still = max(np.abs(step[:3]).max(), np.abs(step[3:6]).max() / pose[2, 3]) < LEAST_STEP
        moved = np.eye(4)
        moved[:3, :3] = cv2.Rodrigues(step[:3])[0] @ pose[:3, :3]
        moved[:3, 3] = pose[:3, 3] + step[3:6]
        new_scale = scale + (float(step[6]) if free else 0.0)
        after = _residual(given, moved, new_scale, free)
        if after is None or after[0] @ after[0] > chi2:
            damping *= 10
            if damping > 1e6 or still:
                break
            continue
        pose, scale, now, damping = moved, new_scale, after, max(damping / 10, 1e-15)
        # What a step promises, and what it kept: at the minimum both are rounding.
        if -step @ gradient < LEAST_DECREASE * chi2 or still:
            break
    return PlanePose(pose, float(now[0] @ now[0]), now[1].T @ now[1], scale)


def normalised(given: PlanePoints, log_scale: float) -> Array:
    """Normalised coordinates (N, 2) of the points for the asked focal length."""
    k = given.camera.K
    y = (given.pixels[:, 1] - k[1, 2]) / k[1, 1]
    x = (given.pixels[:, 0] - k[0, 2] - k[0, 1] * y) / k[0, 0]
    return np.ascontiguousarray(np.stack([x, y], axis=-1) / np.exp(log_scale))


def _residual(given: PlanePoints, pose: Array, log_scale: float, free: bool) -> tuple[Array, Array] | None:
    """Whitened residuals (2N,), and their Jacobian (2N, 6 or 7)."""
    turned = given.points_m @ pose[:3, :3].T
    point = turned + pose[:3, 3]
    z = point[:, 2]
    if np.any(z <= 0):
        return None
    scale = float(np.exp(log_scale))
    xy = scale * point[:, :2] / z[:, None]
    k = given.camera.K[:2, :2]
    residual = denormalise(given.camera, xy) - given.pixels
    # d xy / d point
    by_point = np.zeros((len(z), 2, 3))
    by_point[:, 0, 0] = by_point[:, 1, 1] = scale / z
    by_point[:, :, 2] = -xy / z[:, None]
    jacobian = np.empty((len(z), 2, 7 if free else 6))
    # A turn w of the rotation moves a point by w x (R X): columns are minus the cross product's matrix.
    cross = np.zeros((len(z), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = turned[:, 2], -turned[:, 1], turned[:, 0]
    cross -= np.swapaxes(cross, 1, 2)
    jacobian[:, :, :3] = k @ (by_point @ cross)
    jacobian[:, :, 3:6] = k @ by_point
    if free:
        jacobian[:, :, 6] = xy @ k.T
    flat = jacobian.reshape(2 * len(z), -1)
    return given.whitener @ residual.ravel(), given.whitener @ flat
