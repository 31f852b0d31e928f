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
    each = [rate_covariance_of(n, c, K, radius_m, row_time) for n, c in zip(poses.normal, poses.centre_m, strict=True)]
    return np.asarray((each[0] + each[1]) / 2)


def rate_covariance_of(normal: Array, centre_m: Array, K: Array, radius_m: float, row_time: RowTime) -> Array:
    """The same (5, 5) for one pose."""
    rates = np.empty((5, 6))
    for i in range(6):
        ends = [_shape(normal, centre_m / radius_m, i, sign * _STEP, K) for sign in (1.0, -1.0)]
        rates[:, i] = (ends[0] - ends[1]) / (2 * _STEP)
    sigma = row_time.twist_sigma
    sigma[:3] /= radius_m
    rates *= sigma
    return np.asarray(rates @ rates.T)


def _shape(normal: Array, centre: Array, axis: int, step: float, K: Array) -> Array:
    """Shape (5,) of the unit circle after a shift along, or a turn about, an axis of the camera."""
    direction = np.zeros(3)
    direction[axis % 3] = step
    if axis < 3:
        centre = centre + direction
    else:
        centre, normal = centre + np.cross(direction, centre), normal + np.cross(direction, normal)
        normal = normal / np.linalg.norm(normal)
    across = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.7 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.stack([across, np.cross(normal, across), normal], axis=1), centre
    return np.asarray(shape_of_ellipse(ellipse_of_conic(conic_of_circle(pose, 1.0, K))))
