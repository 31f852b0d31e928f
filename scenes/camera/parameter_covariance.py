"""The parameters of a camera in OpenCV's order, and their covariance as camera files store it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import DataError

Array = NDArray[np.float64]

PROJECTION = ("fx", "fy", "cx", "cy")
LENS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty")


def parameter_names(camera: Camera) -> tuple[str, ...]:
    """Names of a camera's parameters: fx, fy, cx, cy in px, then its coefficients of OpenCV's lens model."""
    return PROJECTION + LENS[: len(camera.distortion)]


def parameter_covariance(record: dict[str, Any], camera: Camera) -> Array | None:
    """The covariance (c, c) of `parameter_names(camera)` in a camera file; None if the file has none.

    Parameters that the file's covariance lacks, such as the coefficients that a calibration left at zero, are exact;
    further ones, such as the diameter of a grid's dots, are left out.

    Raises
    ------
    DataError
        If it is damaged.
    """
    about = record.get("calibration")
    if not isinstance(about, dict) or "covariance" not in about:
        return None
    names = parameter_names(camera)
    try:
        known = [str(name) for name in about["parameters"]]
        given = np.array(about["covariance"], dtype=np.float64)
        sound = given.shape == (len(known), len(known)) and bool(np.isfinite(given).all())
    except (KeyError, TypeError, ValueError):
        sound = False
    if not sound or not _is_covariance(given):
        raise DataError("its covariance is damaged; calibrate the camera again")
    where = [known.index(name) if name in known else -1 for name in names]
    both = np.outer(np.array(where) >= 0, np.array(where) >= 0)
    return np.where(both, given[np.ix_(where, where)], 0.0)


def _is_covariance(matrix: Array) -> bool:
    """Whether a matrix is symmetric and positive semidefinite, to rounding, in units of its standard deviations."""
    variance = np.diag(matrix)
    if np.any(variance < 0):
        return False
    scale = np.sqrt(np.where(variance > 0, variance, 1.0))
    correlation = matrix / np.outer(scale, scale)
    alike = np.allclose(correlation, correlation.T, atol=1e-9)
    return bool(alike and np.linalg.eigvalsh((correlation + correlation.T) / 2)[0] > -1e-9)
