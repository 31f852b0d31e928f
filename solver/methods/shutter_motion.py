"""The motion of detections during the readout of its camera, as the fits take it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera
from roundel.solver.fit.row_motion import RowMotion
from roundel.solver.intrinsics.shutter import is_assumed
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.pose.shape_rates import shape_rate_covariance

Array = NDArray[np.float64]


def motions_of(uncertain: UncertainCamera, ellipses: Array, radius_m: float) -> list[RowMotion | None]:
    """Readout and prior of the rates of each ellipse (N, 5); None for a camera at rest, or an ellipse without a pose.

    A declared motion is fitted; the assumed one of an unknown camera only widens the covariance.
    """
    row_time, camera = uncertain.row_time, uncertain.camera
    if row_time is None or not row_time.moves or not len(ellipses):
        return [None] * len(ellipses)
    try:
        covariances = shape_rate_covariance(ellipses, camera.K, radius_m, row_time)
    except ValueError:
        one_by_one = ([None] if len(ellipses) == 1 else motions_of(uncertain, e[None], radius_m) for e in ellipses)
        return [motion for motions in one_by_one for motion in motions]
    row_s, fitted = row_time.row_s(camera.width_px, camera.height_px), not is_assumed(row_time)
    return [RowMotion(row_s, covariance, row_time.along_x, fitted) for covariance in covariances]


def shutter_key(uncertain: UncertainCamera) -> tuple[object, ...] | None:
    """What two cameras must share for one fit to serve both, besides their lens."""
    row_time, camera = uncertain.row_time, uncertain.camera
    return None if row_time is None else (row_time, tuple(camera.K.ravel().tolist()), _size(camera))


def _size(camera: Camera) -> tuple[int, int]:
    return camera.width_px, camera.height_px
