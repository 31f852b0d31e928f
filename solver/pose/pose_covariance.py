"""Covariance of both poses, propagated from the ellipse and from the camera.

The image of the circle determines its dual conic, K (c c^T + R^2 (n n^T - I)) K^T up to scale (errata, section 2). Its
centre x and its shape M = S S^T are five numbers, and the pose (n, c) has five degrees of freedom: with
B = d(x, M) / d(pose), any change of ellipse or camera changes the pose by B^-1 times its effect on (x, M).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.fit.ellipse import shape_of_ellipse
from roundel.solver.pose.circle_pose import CirclePoses, poses_from_ellipse

Array = NDArray[np.float64]

# The normal's offset from the line of sight is the square root of a number q that is linear in the ellipse. If noise
# dominates q, the root is of size E|q|^(1/2), q complex Gaussian with sigma per axis: the squared offset is replaced by
# this many sigma, which avoids an infinite derivative.
DROWNED = 0.4
# Sine of the offset at which the noise of q is measured, if the pose's own offset is smaller.
_REFERENCE = 0.05
_SIGNS = np.array([1.0, 1.0, -1.0, -1.0, -1.0])


def poses_with_covariance(
    ellipse: ArrayLike,
    shape_cov: ArrayLike,
    K: ArrayLike,
    radius_m: float,
    focal_sigma: float = 0.0,
    principal_sigma_px: float = 0.0,
) -> tuple[CirclePoses, Array | None]:
    """Both poses of a circle and the covariance of each.

    Parameters
    ----------
    ellipse : (..., 5) array_like
        x_px, y_px, a_px, b_px, angle_deg; undistorted pixel coordinates.
    shape_cov : (..., 5, 5) array_like
        Covariance of (x, y, S11, S12, S22), px: `EllipseFit.shape_cov`.
    K : (3, 3) array_like
    radius_m : float
        1 for a circle of unknown size: the centres and their covariance are then in units of the radius.
    focal_sigma : float
        Standard deviation of the focal length, as a fraction of it (both focal lengths together).
    principal_sigma_px : float
        Standard deviation of each coordinate of the principal point.

    Returns
    -------
    poses : CirclePoses
    cov : (..., 2, 6, 6) array or None
        Covariance of (centre x, y, z in m, normal x, y, z) for each candidate: rank 5, because a normal has no error
        along itself. None if `shape_cov` is not finite. First order in the errors; below the breakdown tilt (errata,
        section 6), where the first order would be infinite, it has the size of the actual errors.

    Raises
    ------
    ValueError
        As `poses_from_ellipse`; if a standard deviation is negative.
    """
    if not (0 <= focal_sigma < math.inf and 0 <= principal_sigma_px < math.inf):
        raise ValueError("focal_sigma and principal_sigma_px must be zero or positive numbers")
    k, e = np.asarray(K, dtype=np.float64), np.asarray(ellipse, dtype=np.float64)
    poses = poses_from_ellipse(e, k, radius_m)
    noise = np.zeros((*e.shape[:-1], 1, 8, 8))
    noise[..., 0, :5, :5] = shape_cov
    if not np.all(np.isfinite(noise)):
        return poses, None
    noise[..., 5, 5], noise[..., 6, 6], noise[..., 7, 7] = focal_sigma**2, principal_sigma_px**2, principal_sigma_px**2

    normal, centre = poses.normal, poses.centre_m / radius_m
    sight = centre / _length(centre)
    across = normal - np.sum(normal * sight, axis=-1, keepdims=True) * sight
    offset = _length(across)  # sine of the angle between normal and line of sight
    if np.min(offset) < 1e-9:  # viewed along its own axis, a circle may tilt to any side: one is taken
        across = np.where(offset < 1e-9, _cross(sight, np.array([1.0, 0.0, 0.0])), across)
    across /= _length(across)
    frame = (sight, across, _cross(sight, across), offset)

    tilted = np.maximum(offset, _REFERENCE)
    cov = _carried(e[..., None, :], k, frame, tilted, centre, noise)
    # q = offset^2, so sigma_q = 2 offset sigma_n, with half the normal's variance for each tangential axis.
    sigma_q = 2 * tilted * np.sqrt((cov[..., 3, 3] + cov[..., 4, 4] + cov[..., 5, 5]) / 2)[..., None]
    enough = np.minimum((offset**4 + (DROWNED * sigma_q) ** 2) ** 0.25, 1.0)
    if np.any(np.abs(enough - tilted) > 1e-3 * tilted):
        cov = _carried(e[..., None, :], k, frame, enough, centre, noise)
    cov[..., :3, :] *= radius_m
    cov[..., :, :3] *= radius_m
    return poses, cov


def _carried(
    ellipse: Array, k: Array, frame: tuple[Array, Array, Array, Array], sine: Array, centre: Array, noise: Array
) -> Array:
    """Covariance (..., 2, 6, 6), in radii, by derivatives at normals with this sine from the line of sight."""
    sight, across, one, offset = frame
    seen, two = _tilted(sight, across, sine)
    # The image in units of b, with its origin at the ellipse's centre: no cancellation for any size of the ellipse.
    b = ellipse[..., 3]
    s11, s12, s22 = np.moveaxis(shape_of_ellipse(ellipse)[..., 2:], -1, 0) / b
    m11, m12, m22 = s11 * s11 + s12 * s12, s12 * (s11 + s22), s12 * s12 + s22 * s22
    to_image = np.zeros((*b.shape, 3, 3))
    to_image[..., :2, :] = k[:2] / (k[2, 2] * b[..., None, None])
    to_image[..., :2, 2] -= ellipse[..., :2] / b[..., None]
    to_image[..., 2, 2] = 1.0

    c, n = (to_image @ centre[..., None])[..., 0], (to_image @ seen[..., None])[..., 0]
    turned = np.swapaxes(to_image @ np.stack([one, two], axis=-1), -1, -2)  # d normal, the tangents in rows
    # d D of the dual conic D = c c^T + n n^T - K K^T, by two rotations and three shifts.
    half = np.concatenate(
        [turned[..., None] * n[..., None, None, :], np.swapaxes(to_image, -1, -2)[..., None] * c[..., None, None, :]],
        axis=-3,
    )
    elements = (half + np.swapaxes(half, -1, -2)).reshape(*c.shape[:-1], 5, 9)
    # x = D[:2, 2] / D33 (here 0), M = x x^T - D[:2, :2] / D33; elements 2, 5 of D are x, and 0, 1, 4 are M.
    moved = elements[..., [2, 5, 0, 1, 4]] * _SIGNS
    moved[..., 2:] -= elements[..., 8:] * np.stack([m11, m12, m22], axis=-1)[..., None, :]
    by_pose = np.swapaxes(moved, -1, -2) / (c[..., 2] ** 2 + n[..., 2] ** 2 - 1.0)[..., None, None]
    # (x, M) by (x, S); a change of pose has to compensate the effect of ln f and the principal point on (x, M).
    told = np.zeros((*b.shape, 5, 8))
    told[..., 0, 0] = told[..., 1, 1] = 1.0
    told[..., 2, 2] = 2 * s11
    told[..., 2, 3] = told[..., 4, 3] = 2 * s12
    told[..., 3, 2] = told[..., 3, 4] = s12
    told[..., 3, 3] = s11 + s22
    told[..., 4, 4] = 2 * s22
    told[..., 0, 6] = told[..., 1, 7] = -1.0
    told /= b[..., None, None]
    told[..., :2, 5] = to_image[..., :2, 2]
    told[..., 2, 5], told[..., 3, 5], told[..., 4, 5] = -2 * m11, -2 * m12, -2 * m22
    pose = np.linalg.solve(by_pose, np.broadcast_to(told, (*by_pose.shape[:-1], 8)))
    tangents = np.stack([one, _tilted(sight, across, offset)[1]], axis=-1)
    jacobian = np.concatenate([pose[..., 2:, :], tangents @ pose[..., :2, :]], axis=-2)
    return np.asarray(jacobian @ noise @ np.swapaxes(jacobian, -1, -2))


def _tilted(sight: Array, across: Array, sine: Array) -> tuple[Array, Array]:
    """The normal at this sine from the line of sight, and its tangent in the plane of both."""
    cosine = np.sqrt((1 - sine) * (1 + sine))
    return sine * across - cosine * sight, sine * sight + cosine * across


def _length(a: Array) -> Array:
    return np.asarray(np.sqrt(np.sum(a * a, axis=-1, keepdims=True)))


def _cross(a: Array, b: Array) -> Array:
    """Cross products; NumPy's own function takes 25 microseconds to find its axes."""
    return np.asarray(a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]])
