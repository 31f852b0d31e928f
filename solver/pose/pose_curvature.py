"""What the bent map from ellipse and focal length to pose adds to a covariance of first order.

If one direction of the ellipse is known badly (the motion during a readout, most of the contour hidden), the pose moves
along a curve, and leaves the thin ellipsoid of its linear covariance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.ellipse import ellipse_of_shape, shape_of_ellipse
from roundel.solver.pose.circle_pose import CirclePoses, poses_from_ellipse

Array = NDArray[np.float64]

_STEP = 3.0**0.5  # sigmas: differences at these points give the second moments of a quadratic exactly
_LEAST_FOCAL = 0.1  # of the focal length
_SMALL = 0.003  # standard deviation of the ellipse over its semi-minor axis: the map is straight within less


def curved_covariance(
    poses: CirclePoses, cov: Array, ellipse: Array, shape_cov: Array, K: Array, radius_m: float
) -> Array:
    """Covariance (..., 2, 6, 6) about the poses, to second order in the main directions of the ellipse's error.

    Parameters
    ----------
    poses : CirclePoses
        Of the ellipse, (..., 2, 3) each.
    cov : (..., 2, 6, 6) array
        Of (centre, normal), to first order.
    ellipse : (..., 5) array
    shape_cov : (..., 5, 5) array
        Covariance of (x, y, S11, S12, S22), px.
    K : (3, 3) array
    radius_m : float
    """
    values, vectors = np.linalg.eigh(shape_cov)
    wide = values[..., -1] > (_SMALL * ellipse[..., 3]) ** 2
    if not np.any(wide):
        return cov
    shifts = np.swapaxes(vectors[wide], -1, -2) * (_STEP * np.sqrt(np.maximum(values[wide], 0.0)))[..., None]
    shape = shape_of_ellipse(ellipse[wide])[:, None]
    theta = np.concatenate([shape + shifts, shape - shifts], axis=1)
    # If the error is so wide that no ellipse is left, the linear covariance is as good as any.
    some = np.all((theta[..., 2] * theta[..., 4] > theta[..., 3] ** 2) & (theta[..., 2] > 0), axis=1)
    wide[wide] = some
    if not np.any(some):
        return cov
    there = poses_from_ellipse(ellipse_of_shape(theta[some]), K, radius_m)
    some_poses = CirclePoses(poses.normal[wide], poses.centre_m[wide])
    out = cov.copy()
    out[wide] += _second_order(some_poses, there)
    return out


def focal_curvature(poses: CirclePoses, ellipse: Array, K: Array, radius_m: float, focal_sigma: float) -> Array:
    """What the error of an assumed focal length adds to a covariance of first order, (..., 2, 6, 6).

    A focal length that is off by 20 % moves the pose along a curve: off the axis by degrees, which the lens and the
    principal point do not cover.

    Parameters
    ----------
    poses : CirclePoses
        Of the ellipse, (..., 2, 3) each.
    ellipse : (..., 5) array
    K : (3, 3) array
    radius_m : float
    focal_sigma : float
        Standard deviation of the focal length, as a fraction of it.
    """
    there = []
    for side in (1.0, -1.0):
        other = np.array(K, dtype=np.float64)
        other[:2, :2] *= max(1.0 + side * _STEP * focal_sigma, _LEAST_FOCAL)
        there.append(poses_from_ellipse(ellipse, other, radius_m))
    normal, centre = (np.stack([getattr(p, name) for p in there], axis=-3) for name in ("normal", "centre_m"))
    return _second_order(poses, CirclePoses(normal, centre))


def _second_order(poses: CirclePoses, there: CirclePoses) -> Array:
    """The second moments (..., 2, 6, 6) of half the second derivatives, and the square of the shift of the mean.

    `there` has the poses (..., 2 m, 2, 3) at the m upward steps, then at the m downward ones.
    """
    normal, centre = poses.normal, poses.centre_m
    # The same candidate: near-frontal ones may change their order.
    same = np.argmax(normal[..., None, :, :] @ np.swapaxes(there.normal, -1, -2), axis=-1)[..., None]
    moved = np.concatenate([np.take_along_axis(of, same, axis=-2) for of in (there.centre_m, there.normal)], axis=-1)
    here = np.concatenate([centre, normal], axis=-1)[..., None, :, :]
    steps = moved.shape[-3] // 2
    # Half the second derivative, times the variance.
    bent = (moved[..., :steps, :, :] + moved[..., steps:, :, :] - 2.0 * here) / 2.0 / _STEP**2
    bent = np.swapaxes(bent, -3, -2)  # (..., 2, m, 6)
    # A normal has no error along itself.
    bent[..., 3:] -= (bent[..., 3:] @ normal[..., None]) * normal[..., None, :]
    total = bent.sum(axis=-2)
    return np.asarray(2.0 * np.swapaxes(bent, -1, -2) @ bent + total[..., :, None] * total[..., None, :])
