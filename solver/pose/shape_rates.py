"""How fast the ellipse of a circle moves when the camera does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.row_time import RowTime
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.solver.fit.ellipse import shape_of_ellipse
from roundel.solver.pose.circle_pose import poses_from_ellipse

Array = NDArray[np.float64]

_STEP = 1e-4  # rad, and radii: central differences are then good to 1e-7


def shape_rate_covariance(ellipse: Array, K: Array, radius_m: float, row_time: RowTime) -> Array:
    """Prior covariance of the rates of an ellipse, from that of the camera's twist; the mean of both poses'.

    Parameters
    ----------
    ellipse : (5,) array
    K : (3, 3) array
    radius_m : float
    row_time : RowTime

    Returns
    -------
    (5, 5) array
        Of the rates of (x, y, S11, S12, S22), px/s.

    Raises
    ------
    ValueError
        If the ellipse has no pose.
    """
    poses = poses_from_ellipse(ellipse, K, radius_m)
    normal, centre = poses.normal, poses.centre_m / radius_m
    # Two candidates, six twists, two directions: the unit circle after a shift along, or a turn about, each axis.
    steps = np.concatenate([np.eye(3), np.eye(3)]) * _STEP
    steps = np.stack([steps, -steps], axis=1)
    turned = np.zeros((2, 6, 2, 3, 3))
    shifted = np.broadcast_to(centre[:, None, None], (2, 6, 2, 3)).copy()
    shifted[:, :3] += steps[:3]
    shifted[:, 3:] += np.cross(steps[3:], centre[:, None, None])
    turned[..., 2] = normal[:, None, None]
    turned[:, 3:, :, :, 2] += np.cross(steps[3:], normal[:, None, None])
    turned[..., 2] /= np.linalg.norm(turned[..., 2], axis=-1, keepdims=True)
    aside = np.where(np.abs(normal[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])[:, None, None]
    turned[..., 0] = np.cross(turned[..., 2], aside)
    turned[..., 0] /= np.linalg.norm(turned[..., 0], axis=-1, keepdims=True)
    turned[..., 1] = np.cross(turned[..., 2], turned[..., 0])
    pose = np.zeros((2, 6, 2, 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = turned, shifted, 1.0
    shape = shape_of_ellipse(ellipse_of_conic(conic_of_circle(pose, 1.0, K)))
    sigma = row_time.twist_sigma
    sigma[:3] /= radius_m
    rates = (shape[:, :, 0] - shape[:, :, 1]) / (2 * _STEP) * sigma[:, None]
    return np.asarray(np.einsum("kij,kil->jl", rates, rates) / 2)
