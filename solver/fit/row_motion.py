"""The motion of an ellipse while the rows of the image are read.

A static circle seen from a moving camera is an ellipse at every moment, so to first order in time the contour in row
time t is the ellipse theta + t theta', with the same five rates theta' all along. Those of x and y shear and stretch
the contour in the image, and it stays an ellipse: the fit is of that one, which the pixels determine whatever the
motion. What its edge tells about the rates is fitted with it, under a prior so wide that it only keeps them finite; the
prior of the motion enters with the pose (`roundel.solver.pose.centre_rows`), for it is another one for each candidate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_WIDE = 5.0
_LEAST = 1e-3  # px/s: even where a rate is known to be zero


@dataclass(frozen=True, eq=False)
class RowMotion:
    """Readout of the rows, and the prior of the rates.

    Attributes
    ----------
    row_s : float
        Delay from one row to the next, s; 0 if the camera moves, but its shutter is global.
    covariance : (5, 5) array
        Of the rates of (x, y, S11, S12, S22), px/s, with mean zero: that of the mean candidate.
    along_x : bool
        Whether the sensor's rows are columns of the image.
    fitted : bool
        Whether the rates are fitted with the ellipse; otherwise they widen its covariance.
    """

    row_s: float
    covariance: Array
    along_x: bool = False
    fitted: bool = True

    def wide_information(self) -> Array:
        """Information (5, 5) of a prior of the rates whose standard deviations are five times those of the motion."""
        variance = np.diag(self.covariance)
        wide = _WIDE**2 * np.repeat([np.max(variance[:2]), np.max(variance[2:])], [2, 3])
        return np.diag(1.0 / np.maximum(wide, _LEAST**2))

    def time_s(self, points_px: Array, centre_px: Array) -> Array:
        """Time (N,) of image points (N, 2) relative to that of the centre."""
        axis = 0 if self.along_x else 1
        return np.asarray((points_px[:, axis] - centre_px[axis]) * self.row_s)


def widened(shape_cov: Array, shape: Array, sigma: Array, time_s: Array, motion: RowMotion) -> Array:
    """Covariance (5, 5) of a shape that was fitted as if nothing moved.

    Parameters
    ----------
    shape_cov : (5, 5) array
    shape : (N, 5) array
        Derivative of the distances of points by the shape.
    sigma, time_s : (N,) arrays
        Their standard deviations, and their times.
    motion : RowMotion
    """
    rows = shape / sigma[:, None]
    # A rate r moves the point i by shape_i r t_i; the fit takes the part of it that is a change of the shape.
    gram = rows.T @ rows
    gram += np.diag(1e-12 * np.diag(gram) + 1e-300)  # a short arc hardly determines five parameters
    carried = np.linalg.solve(gram, rows.T @ (rows * time_s[:, None]))
    return np.asarray(shape_cov + carried @ motion.covariance @ carried.T)
