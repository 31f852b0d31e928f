"""Ratio of two errors over cameras, calibrations of each, and frames of each: a nested bootstrap.

Frames of one camera share the error of its intrinsics, and frames solved with one calibration share that of the
calibration. Resampling frames alone says nothing about the next camera or the next set of boards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.validate.statistics.intervals import LEVEL, Interval

Array = NDArray[np.float64]

_RESAMPLES = 1999
_WITHIN = 200  # resamples of sets and frames of each camera, of which each draw of the camera takes one
# Fewer cameras, or sets of a single camera, say too little about their spread for percentiles of a bootstrap.
MIN_UNITS = 6


@dataclass(frozen=True, eq=False)
class CameraErrors:
    """Errors of the same frames of one camera, without and with calibration.

    Attributes
    ----------
    without : (n,) array
        Positive errors with assumed intrinsics.
    calibrated : (m, n) array
        Errors with each of m independent calibrations.
    """

    without: Array
    calibrated: Array

    @property
    def factors(self) -> Array:
        """(m,) Median error without calibration over that with each of them."""
        return np.asarray(np.median(self.without) / np.median(self.calibrated, axis=1))


def nested_factor(cameras: Sequence[CameraErrors], level: float = LEVEL, seed: int = 0) -> Interval:
    """Geometric mean over cameras of the factor by which calibrating divides the median error, with its interval.

    Cameras are drawn with replacement, and of each its calibrations and its frames. The factor of a camera is its
    median error without calibration over the median with it, over all its calibrations and frames. With a single
    camera, the interval is one over calibrations and frames of that camera only.

    Parameters
    ----------
    cameras : sequence of CameraErrors
    level : float
    seed : int

    Returns
    -------
    Interval
        `n` is the number of cameras, or of the calibrations of a single one; without bounds below `MIN_UNITS`.

    Notes
    -----
    A. C. Davison, D. V. Hinkley, Bootstrap Methods and their Application (1997), section 3.8: resampling below the top
    level counts the lower levels' scatter twice, by its share of the whole: the interval is rather too wide than too
    narrow.
    """
    if not cameras:
        return Interval(None, None, None, 0, "no cameras")
    rng = np.random.default_rng(seed)
    value = float(np.exp(np.mean([_log_factor(c.without, c.calibrated) for c in cameras])))
    units = len(cameras) if len(cameras) > 1 else len(cameras[0].calibrated)
    what = "cameras" if len(cameras) > 1 else "calibrations of one camera"
    if units < MIN_UNITS:
        return Interval(value, None, None, units, f"fewer than {MIN_UNITS} {what}")
    many = _RESAMPLES if len(cameras) == 1 else _WITHIN
    within = np.stack([_resampled(c, many, rng) for c in cameras])
    if len(cameras) == 1:
        drawn = within[0]
    else:
        shape = _RESAMPLES, len(cameras)
        drawn = within[rng.integers(0, len(cameras), shape), rng.integers(0, many, shape)].mean(axis=1)
    low, high = np.exp(np.percentile(drawn, [50 - 50 * level, 50 + 50 * level]))
    return Interval(value, float(low), float(high), units, f"percentile, nested over {what}")


def _log_factor(without: Array, calibrated: Array) -> float:
    return float(np.log(np.median(without)) - np.log(np.median(calibrated)))


def _resampled(camera: CameraErrors, many: int, rng: np.random.Generator) -> Array:
    sets, frames = camera.calibrated.shape
    calibration, frame = rng.integers(0, sets, (many, sets)), rng.integers(0, frames, (many, frames))
    without = np.median(camera.without[frame], axis=1)
    calibrated = camera.calibrated[calibration[:, :, None], frame[:, None, :]].reshape(many, -1)
    return np.asarray(np.log(without) - np.log(np.median(calibrated, axis=1)))
