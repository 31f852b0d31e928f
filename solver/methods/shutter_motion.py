"""The motion of a detection during the readout of its camera, as the fits take it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera
from roundel.solver.fit.row_motion import RowMotion
from roundel.solver.intrinsics.shutter import is_assumed
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.pose.shape_rates import shape_rate_covariance

Array = NDArray[np.float64]


def motion_of(uncertain: UncertainCamera, ellipse: Array, radius_m: float) -> RowMotion | None:
    """Readout and prior of the ellipse's rates; None for a global shutter, or if the ellipse has no pose.

    A declared shutter is fitted; the assumed one of an unknown camera only widens the covariance.
    """
    row_time, camera = uncertain.row_time, uncertain.camera
    if row_time is None or row_time.readout_s == 0:
        return None
    try:
        covariance = shape_rate_covariance(ellipse, camera.K, radius_m, row_time)
    except ValueError:
        return None
    row_s = row_time.row_s(camera.width_px, camera.height_px)
    return RowMotion(row_s, covariance, row_time.along_x, not is_assumed(row_time))


def shutter_key(uncertain: UncertainCamera) -> tuple[object, ...] | None:
    """What two cameras must share for one fit to serve both, besides their lens."""
    row_time, camera = uncertain.row_time, uncertain.camera
    return None if row_time is None else (row_time, tuple(camera.K.ravel().tolist()), _size(camera))


def _size(camera: Camera) -> tuple[int, int]:
    return camera.width_px, camera.height_px
