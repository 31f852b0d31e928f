"""Motion over the exposure: constant twists, and the exposure time of each sensor row.

Time 0 is mid-exposure of the row that images the centre of the sheet's first part; the pose of record of that part is
the one at time 0. A body's twist, velocity and rate of rotation, is given in its own frame:

    camera_from_sheet(t) = exp(-t [camera twist]) camera_from_sheet(0) exp(t [marker twist]).

The exponential of a twist has a closed form (Murray, Li and Sastry 1994, eq. 2.36).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.pose import transform_points

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """When rows are exposed and how camera and marker move.

    Attributes
    ----------
    exposure_s : float
        Exposure time of each row.
    row_s : float
        Delay from one row to the next; 0 is a global shutter.
    centre_row_px : float
        The row whose exposure is centred on time 0.
    camera_twist, marker_twist : (6,) array
        Velocity in m/s, then rate of rotation in rad/s, each in the body's own frame.
    """

    exposure_s: float
    row_s: float
    centre_row_px: float
    camera_twist: Array
    marker_twist: Array

    @property
    def moves(self) -> bool:
        """Whether the scene changes with time."""
        return bool(np.any(self.camera_twist) or np.any(self.marker_twist))

    def row_time_s(self, row_px: ArrayLike) -> Array:
        """Mid-exposure of rows, in seconds."""
        return np.asarray((np.asarray(row_px, dtype=np.float64) - self.centre_row_px) * self.row_s, dtype=np.float64)


def adjoint(transform: ArrayLike, twist: ArrayLike) -> Array:
    """A twist (6,) in the frame that `transform` (4, 4) leads to (Murray, Li and Sastry, eq. 2.57).

    exp(adjoint(T, xi)) = T exp(xi) T^-1.
    """
    pose, xi = np.asarray(transform, dtype=np.float64), np.asarray(twist, dtype=np.float64)
    rate = pose[:3, :3] @ xi[3:]
    return np.concatenate([pose[:3, :3] @ xi[:3] + np.cross(pose[:3, 3], rate), rate])


def exp_twist(twist: ArrayLike, time_s: ArrayLike) -> Array:
    """Rigid motion (..., 4, 4) of a body after `time_s` (...) seconds at a constant twist (6,).

    R = I + sin(a)/a [w] + (1 - cos a)/a^2 [w]^2, p = (I + (1 - cos a)/a^2 [w] + (a - sin a)/a^3 [w]^2) v, with v and w
    the twist times the time and a = |w|.
    """
    xi = np.asarray(twist, dtype=np.float64) * np.asarray(time_s, dtype=np.float64)[..., None]
    v, w = xi[..., :3], xi[..., 3:]
    a2 = np.sum(w * w, axis=-1)[..., None, None]
    a = np.sqrt(a2)
    # Below 1e-3 rad the series is exact to double precision, and the quotients are not.
    small = a < 1e-3
    safe = np.where(small, 1.0, a)
    first = np.where(small, 1 - a2 / 6 + a2 * a2 / 120, np.sin(safe) / safe)
    second = np.where(small, 0.5 - a2 / 24 + a2 * a2 / 720, (1 - np.cos(safe)) / safe**2)
    third = np.where(small, 1 / 6 - a2 / 120 + a2 * a2 / 5040, (safe - np.sin(safe)) / safe**3)
    # Filled in place, because stacking took a third of the time.
    cross = np.zeros((*xi.shape[:-1], 3, 3))
    cross[..., 0, 1], cross[..., 1, 0] = -w[..., 2], w[..., 2]
    cross[..., 2, 0], cross[..., 0, 2] = -w[..., 1], w[..., 1]
    cross[..., 1, 2], cross[..., 2, 1] = -w[..., 0], w[..., 0]
    square = cross @ cross
    out = np.zeros((*xi.shape[:-1], 4, 4))
    out[..., :3, :3] = np.eye(3) + first * cross + second * square
    out[..., :3, 3] = np.einsum("...ij,...j->...i", np.eye(3) + second * cross + third * square, v)
    out[..., 3, 3] = 1.0
    return out


def pose_at(motion: Motion, camera_from_sheet: Array, time_s: ArrayLike) -> Array:
    """Pose (..., 4, 4) of the sheet at times (...), from its pose (4, 4) at time 0."""
    time = np.asarray(time_s, dtype=np.float64)
    if not motion.moves:
        return np.broadcast_to(camera_from_sheet, (*time.shape, 4, 4)).copy()
    pose = exp_twist(motion.camera_twist, -time) @ camera_from_sheet
    # A marker at rest is the usual case, and needs no transform.
    return pose @ exp_twist(motion.marker_twist, time) if np.any(motion.marker_twist) else pose


# Newton steps for the row where a moving point is imaged; each doubles the correct digits.
_ROW_STEPS = 12
_ROW_SLOPE_PX = 1e-3


def image_of(camera: Camera, motion: Motion, camera_from_sheet: Array, points_m: ArrayLike) -> tuple[Array, Array]:
    """Images of points of the sheet, each at mid-exposure of the row on which it is imaged.

    Parameters
    ----------
    camera : Camera
    motion : Motion
    camera_from_sheet : (4, 4) array
        Pose at time 0.
    points_m : (n, 3) array_like
        In the sheet's frame, metres.

    Returns
    -------
    px : (n, 2) array
        Image pixels; NaN behind the camera, or where the scene outruns the rolling shutter.
    time_s : (n,) array
    """
    points = np.asarray(points_m, dtype=np.float64)

    def at(time: Array) -> Array:
        pose = pose_at(motion, camera_from_sheet, time)
        return project(camera, np.einsum("nij,nj->ni", pose[:, :3, :3], points) + pose[:, :3, 3])

    if not motion.moves or motion.row_s == 0:
        return project(camera, transform_points(camera_from_sheet, points)), np.zeros(len(points))
    row = at(np.zeros(len(points)))[:, 1]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for _ in range(_ROW_STEPS):
            miss = at(motion.row_time_s(row))[:, 1] - row
            beside = at(motion.row_time_s(row + _ROW_SLOPE_PX))[:, 1] - (row + _ROW_SLOPE_PX)
            before, row = row, row - miss * _ROW_SLOPE_PX / (beside - miss)
            if np.array_equal(before, row, equal_nan=True):
                break  # later steps would repeat this one
        time = motion.row_time_s(row)
        px = at(time)
        # A point as fast as the shutter is never imaged, and a faster one is imaged upside down.
        lost = ~(np.abs(px[:, 1] - row) < 1e-6) | ~(beside < miss)
    px[lost] = np.nan
    return px, time
