"""Distances of points to an ellipse with their derivatives, in one pass."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import foot_point
from roundel.solver.kernels.trace_contour import shape_row

Array = NDArray[np.float64]


@compiled
def shape_rows(theta: Array, points: Array, inverse_sigma: Array, rows: Array) -> None:
    """Write derivatives of the signed distances by x, y, S11, S12, S22, and the distances, (6, N), over the sigmas.

    Parameters
    ----------
    theta : (5,) array
        x, y, S11, S12, S22 of the ellipse, px.
    points : (N, 2) array
    inverse_sigma : (N,) array
    rows : (6, N) array
        Written.
    """
    mean, half = (theta[2] + theta[4]) / 2.0, math.hypot((theta[2] - theta[4]) / 2.0, theta[3])
    angle = math.atan2(theta[3], (theta[2] - theta[4]) / 2.0) / 2.0
    a, b, c, s = mean + half, mean - half, math.cos(angle), math.sin(angle)
    row = np.empty(5)
    for i in range(len(points)):
        dx, dy = points[i, 0] - theta[0], points[i, 1] - theta[1]
        distance, nx, ny, ux, uy = foot_point(a, b, c * dx + s * dy, c * dy - s * dx)
        shape_row(c * nx - s * ny, s * nx + c * ny, c * ux - s * uy, s * ux + c * uy, row)
        for j in range(5):
            rows[j, i] = row[j] * inverse_sigma[i]
        rows[5, i] = distance * inverse_sigma[i]
