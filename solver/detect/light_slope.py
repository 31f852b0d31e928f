"""The slope of the light beside a contour: a step that is no steeper than its surroundings is no edge.

Smooth light that falls off all round has closed contours of equal level, and rounding to grey levels makes steps of
them. Beside a true edge the levels are flat, up to shading on one of its sides.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]

_POINTS = 64
_REACH_PX = 7.0  # of the profile, on either side; less in small contours
_MIDDLE = 2.0 / 7.0  # the edge's own part of it, and where its sides begin
_SIDE = 3.0 / 7.0
_INSIDE = 0.8  # of the semi-minor axis: beyond, the profile meets the opposite edge


@compiled
def slope_beside(image: NDArray[np.float32], ellipse: Array) -> float:
    """Mean slope on the flatter side of a contour, over the slope at the contour itself.

    Parameters
    ----------
    image : (H, W) array of float32
    ellipse : (5,) array

    Returns
    -------
    float
        1 in light of constant slope; about 0 for an edge, 0.6 for one whose blur has a sigma of 5 px; negative if the
        level returns on the flatter side.
    """
    height, width = image.shape
    a, b = ellipse[2], ellipse[3]
    reach = min(_REACH_PX, _INSIDE * b)
    c, s = math.cos(math.radians(ellipse[4])), math.sin(math.radians(ellipse[4]))
    sums = np.zeros(6)
    for k in range(_POINTS):
        t = 2.0 * math.pi * k / _POINTS
        p, q = math.cos(t), math.sin(t)
        length = math.hypot(a * q, b * p)
        nx, ny = b * p / length, a * q / length
        nx, ny = c * nx - s * ny, s * nx + c * ny
        fx, fy = ellipse[0] + c * a * p - s * b * q, ellipse[1] + s * a * p + c * b * q
        left, right = min(fx - reach * nx, fx + reach * nx), max(fx - reach * nx, fx + reach * nx)
        above, below = min(fy - reach * ny, fy + reach * ny), max(fy - reach * ny, fy + reach * ny)
        if left < 0.0 or above < 0.0 or right > width - 1.0 or below > height - 1.0:
            continue
        for j in range(6):
            offset = (-1.0, -_SIDE, -_MIDDLE, _MIDDLE, _SIDE, 1.0)[j] * reach
            u, v = fx + offset * nx, fy + offset * ny
            column, line = min(int(u), width - 2), min(int(v), height - 2)
            u, v = u - column, v - line
            top = image[line, column] * (1.0 - u) + image[line, column + 1] * u
            bottom = image[line + 1, column] * (1.0 - u) + image[line + 1, column + 1] * u
            sums[j] += top * (1.0 - v) + bottom * v
    middle = (sums[3] - sums[2]) / (2.0 * _MIDDLE)
    if middle == 0.0:
        return 0.0
    side = 1.0 - _SIDE
    return float(min((sums[1] - sums[0]) / side / middle, (sums[5] - sums[4]) / side / middle))
