"""Poses: normals from tilt and azimuth, rotations, and rigid transforms named by their frames.

`camera_from_marker` takes marker coordinates (origin at the circle's centre, Z out of the printed face)
to camera coordinates (x right, y down, z forward).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Frame of an upright marker that faces the camera squarely: X right, Y up, Z toward the camera.
FACING = np.diag([1.0, -1.0, -1.0])


def angle_deg(a: ArrayLike, b: ArrayLike) -> Array:
    """Angle between vectors, exact at small angles: atan2(|a x b|, a . b).

    Parameters
    ----------
    a, b : (..., 3) array_like
        Vectors of any non-zero length.

    Returns
    -------
    (...) array
        Degrees in [0, 180]. acos would return 0 below 1e-8 rad.
    """
    u, v = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    angle: Array = np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v), axis=-1), np.sum(u * v, axis=-1)))
    return angle


def normal_of(tilt_deg: ArrayLike, azimuth_deg: ArrayLike) -> Array:
    """Unit normal out of the printed face, (..., 3), in the camera frame.

    `tilt_deg` is the angle between -normal and the optical axis, `azimuth_deg` is atan2(normal_y, normal_x).
    """
    t, a = np.radians(np.asarray(tilt_deg, dtype=np.float64)), np.radians(np.asarray(azimuth_deg, dtype=np.float64))
    t, a = np.broadcast_arrays(t, a)
    return np.stack([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), -np.cos(t)], axis=-1)


def tilt_azimuth_deg(normal: ArrayLike) -> tuple[Array, Array]:
    """Tilt and azimuth in degrees of unit normals (..., 3): the inverse of `normal_of`."""
    n = np.asarray(normal, dtype=np.float64)
    tilt = np.degrees(np.arctan2(np.hypot(n[..., 0], n[..., 1]), -n[..., 2]))
    return tilt, np.degrees(np.arctan2(n[..., 1], n[..., 0]))


def minimal_rotation(a: ArrayLike, b: ArrayLike) -> Array:
    """The rotation (..., 3, 3) by the smallest angle that takes unit vector a to unit vector b.

    R = I + [v]x + [v]x^2 / (1 + a . b), v = a x b (Rodrigues' formula).

    Raises
    ------
    ValueError
        If a = -b, where the axis is not defined.
    """
    u, w = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    u, w = np.broadcast_arrays(u, w)
    v = np.cross(u, w)
    c = np.sum(u * w, axis=-1)
    if np.any(c <= -1 + 1e-12):
        raise ValueError("opposite vectors: the minimal rotation between them is not unique")
    zero = np.zeros_like(c)
    x = np.stack(
        [
            np.stack([zero, -v[..., 2], v[..., 1]], axis=-1),
            np.stack([v[..., 2], zero, -v[..., 0]], axis=-1),
            np.stack([-v[..., 1], v[..., 0], zero], axis=-1),
        ],
        axis=-2,
    )
    return np.asarray(np.eye(3) + x + x @ x / (1 + c)[..., None, None], dtype=np.float64)


def camera_from_marker_of(normal: ArrayLike, centre_m: ArrayLike, roll_deg: float = 0.0) -> Array:
    """Pose (4, 4) of a marker from its normal and centre in the camera frame.

    At roll 0 the marker is an upright page facing the camera (X right, Y up), tilted by the minimal rotation that
    takes its normal to `normal`; `roll_deg` then turns it in its own plane, X toward Y.
    """
    c, s = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    in_plane = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    transform = np.eye(4)
    transform[:3, :3] = minimal_rotation([0.0, 0.0, -1.0], normal) @ FACING @ in_plane
    transform[:3, 3] = centre_m
    return transform


def transform_points(transform: ArrayLike, points_m: ArrayLike) -> Array:
    """Apply a rigid transform (4, 4) to points (..., 3)."""
    m, p = np.asarray(transform, dtype=np.float64), np.asarray(points_m, dtype=np.float64)
    return np.asarray(p @ m[:3, :3].T + m[:3, 3], dtype=np.float64)
