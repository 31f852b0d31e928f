"""What the bent map from ellipse to pose adds to a covariance of first order.

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
_SMALL = 0.003  # standard deviation of the ellipse over its semi-minor axis: the map is straight within less


def curved_covariance(
    poses: CirclePoses, cov: Array, ellipse: Array, shape_cov: Array, K: Array, radius_m: float
) -> Array:
    """Covariance (2, 6, 6) about the poses, to second order in the main directions of the ellipse's error.

    Parameters
    ----------
    poses : CirclePoses
        Of the ellipse, (2, 3) each.
    cov : (2, 6, 6) array
        Of (centre, normal), to first order.
    ellipse : (5,) array
    shape_cov : (5, 5) array
        Covariance of (x, y, S11, S12, S22), px.
    K : (3, 3) array
    radius_m : float
    """
    values, vectors = np.linalg.eigh(shape_cov)
    if not values[-1] > (_SMALL * ellipse[3]) ** 2:
        return cov
    shifts = (vectors * (_STEP * np.sqrt(np.maximum(values, 0.0)))).T
    shape = shape_of_ellipse(ellipse)
    theta = np.concatenate([shape + shifts, shape - shifts])
    if np.any(theta[:, 2] * theta[:, 4] <= theta[:, 3] ** 2) or np.any(theta[:, 2] <= 0):
        return cov  # so wide that no ellipse is left: the linear one is as good as any
    there = poses_from_ellipse(ellipse_of_shape(theta), K, radius_m)
    out = cov.copy()
    for i in range(2):
        # The same candidate: near-frontal ones may change their order.
        same = np.argmax(there.normal @ poses.normal[i], axis=1)
        rows = np.arange(len(theta))
        moved = np.concatenate([there.centre_m[rows, same], there.normal[rows, same]], axis=1)
        here = np.concatenate([poses.centre_m[i], poses.normal[i]])
        bent = (moved[:5] + moved[5:] - 2.0 * here) / 2.0 / _STEP**2  # half the second derivative, times the variance
        bent[:, 3:] -= np.outer(bent[:, 3:] @ poses.normal[i], poses.normal[i])  # a normal has no error along itself
        out[i] += 2.0 * bent.T @ bent + np.outer(bent.sum(axis=0), bent.sum(axis=0))
    return out
