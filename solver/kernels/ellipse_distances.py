"""Distances of points to an ellipse with their derivatives in one pass, and the ellipse of least distances."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import foot_point
from roundel.solver.kernels.small_matrices import inverse_of
from roundel.solver.kernels.trace_contour import shape_row

Array = NDArray[np.float64]

_SMALLEST_STEP_PX = 1e-7
_MAX_ITERATIONS = 10


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


@compiled
def settled_shape(theta: Array, points: Array, inverse_sigma: Array, rows: Array, inverse: Array) -> bool:
    """Gauss-Newton from a close ellipse to that of the least squares of distances; False if it does not settle.

    Parameters
    ----------
    theta : (5,) array
        x, y, S11, S12, S22 of the start; replaced.
    points, inverse_sigma : (N, 2), (N,) arrays
    rows : (6, N) array
        Written, see `shape_rows`: those of the result.
    inverse : (5, 5) array
        Written: inverse of the normal matrix.
    """
    normal, gradient, step = np.empty((5, 5)), np.empty(5), np.empty(5)
    for _ in range(_MAX_ITERATIONS):
        shape_rows(theta, points, inverse_sigma, rows)
        for j in range(5):
            gradient[j] = 0.0
            for i in range(len(points)):
                gradient[j] += rows[j, i] * rows[5, i]
            for k in range(j + 1):
                total = 0.0
                for i in range(len(points)):
                    total += rows[j, i] * rows[k, i]
                normal[j, k] = normal[k, j] = total
        if not inverse_of(normal, inverse):
            return False
        largest = 0.0
        for j in range(5):
            step[j] = 0.0
            for k in range(5):
                step[j] -= inverse[j, k] * gradient[k]
            theta[j] += step[j]
            largest = max(largest, abs(step[j]))
        if not (theta[2] > 0.0 and theta[2] * theta[4] > theta[3] * theta[3]):
            return False
        if largest < _SMALLEST_STEP_PX:  # the derivatives tell what so small a step changes
            for i in range(len(points)):
                for j in range(5):
                    rows[5, i] += rows[j, i] * step[j]
            return True
    return False
