"""How fast the ellipse of a circle moves when the camera does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.row_time import RowTime
from roundel.solver.pose.circle_pose import poses_from_ellipse

Array = NDArray[np.float64]

_STEP = 1e-4  # rad, and radii: central differences are then good to 1e-7
_AXES = np.eye(3)[:, None] * [[_STEP], [-_STEP]]  # (3, 2, 3)


def shape_rate_covariance(ellipse: Array, K: Array, radius_m: float, row_time: RowTime) -> Array:
    """Prior covariance of the rates of an ellipse, from that of the camera's twist; the mean of both poses'.

    Parameters
    ----------
    ellipse : (..., 5) array
    K : (3, 3) array
    radius_m : float
    row_time : RowTime

    Returns
    -------
    (..., 5, 5) array
        Of the rates of (x, y, S11, S12, S22), px/s.

    Raises
    ------
    ValueError
        If an ellipse has no pose.
    """
    poses = poses_from_ellipse(ellipse, K, radius_m)
    rates = shape_rates(poses.normal, poses.centre_m, K, radius_m) * row_time.twist_sigma
    return np.asarray(np.mean(rates @ np.swapaxes(rates, -1, -2), axis=-3))


def shape_rates(normal: Array, centre_m: Array, K: Array, radius_m: float) -> Array:
    """Derivative (..., 5, 6) of the rates of x, y, S11, S12, S22 (px/s) by the camera's twist (m/s, rad/s).

    Parameters
    ----------
    normal, centre_m : (..., 3) arrays
        The circle's pose.
    K : (3, 3) array
    radius_m : float
    """
    normal, centre = normal[..., None, None, :], centre_m[..., None, None, :] / radius_m
    # Six twists in two directions: a shift along, and a turn about, each axis. The scene moves against the camera.
    shape = image_shape(
        np.concatenate([normal + 0.0 * _AXES, _turned(normal)], axis=-3),
        np.concatenate([centre + _AXES, _turned(centre)], axis=-3),
        K,
    )
    rates = (shape[..., 1, :] - shape[..., 0, :]) / (2 * _STEP)
    rates[..., :3, :] /= radius_m
    return np.asarray(np.swapaxes(rates, -1, -2))


def _turned(vector: Array) -> Array:
    """A vector (..., 1, 1, 3) after small turns about the axes, either way: (..., 3, 2, 3)."""
    a, v = _AXES, vector
    return np.asarray(v * np.cos(_STEP) + a[..., [1, 2, 0]] * v[..., [2, 0, 1]] - a[..., [2, 0, 1]] * v[..., [1, 2, 0]])


def image_shape(normal: Array, centre: Array, K: Array) -> Array:
    """The image (..., 5) x, y, S11, S12, S22 of unit circles, from normals and centres (..., 3).

    Source: errata, section 2: the dual conic K (c c^T + n n^T - I) K^T.
    """
    c, n = centre @ K.T, normal @ K.T
    dual = c[..., :, None] * c[..., None, :] + n[..., :, None] * n[..., None, :] - K @ K.T
    dual /= dual[..., 2:, 2:]
    x, y = dual[..., 0, 2], dual[..., 1, 2]
    m11, m12, m22 = x * x - dual[..., 0, 0], x * y - dual[..., 0, 1], y * y - dual[..., 1, 1]
    # The square root of a 2x2 matrix by its determinant and trace.
    area = np.sqrt(m11 * m22 - m12 * m12)
    scale = 1.0 / np.sqrt(m11 + m22 + 2.0 * area)
    return np.stack([x, y, (m11 + area) * scale, m12 * scale, (m22 + area) * scale], axis=-1)
