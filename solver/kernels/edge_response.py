"""Response of a square pixel to a blurred edge, one pixel at a time.

The formulas and their sources are those of `roundel.scenes.geometry.edge_spread_function`, which tests compare.
"""

from __future__ import annotations

import math

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.normal_distribution import normal_cdf_and_density


@compiled
def step_response(
    z: float, half_sum: float, half_difference: float, variance: float
) -> tuple[float, float, float]:
    """Mean of a unit step over a pixel at distance z (px), blurred by a variance (px^2), and two derivatives by z."""
    sigma = math.sqrt(variance)
    if z > half_sum + 8.0 * sigma:
        return 1.0, 0.0, 0.0
    if z < -half_sum - 8.0 * sigma:
        return 0.0, 0.0, 0.0
    corner, outer = abs(half_difference), half_sum
    area = (half_sum - corner) * (half_sum + corner)
    if area < 1e-3:  # along a row or column one side of the trapezoid is vertical: a steep one is equal to 1e-6
        corner -= 5e-4
        outer = corner + 1e-3
        area = (outer - corner) * (outer + corner)
    value, slope, bend = 0.0, 0.0, 0.0
    for i in range(4):
        s = ((outer, corner, -corner, -outer)[i] + z) / sigma
        sign = 1.0 if i == 0 or i == 3 else -1.0
        cdf, density = normal_cdf_and_density(s)
        value += sign * ((s * s + 1.0) * cdf + s * density)
        slope += sign * (s * cdf + density)
        bend += sign * cdf
    return value * variance / (2.0 * area), slope * sigma / area, bend / area


@compiled
def gaussian_step(z: float, variance: float) -> tuple[float, float, float]:
    """Step blurred by a Gaussian alone, and two derivatives by z: enough for a rough contour."""
    sigma = math.sqrt(variance)
    cdf, density = normal_cdf_and_density(z / sigma)
    return cdf, density / sigma, -density * z / (sigma * variance)


@compiled
def curved_distance(
    distance: float, curvature: float, curvature_ss: float, variance: float
) -> tuple[float, float]:
    """Distance to the straight edge with the same blurred image, and its derivative by the variance (with the pixel)."""
    square = curvature * curvature
    fourth = square * curvature / 12.0 + curvature_ss / 8.0
    first = curvature / 2.0 - square * distance / 4.0 + square * curvature * distance * distance / 6.0
    return distance + variance * (first + variance * fourth), first + 2.0 * variance * fourth
