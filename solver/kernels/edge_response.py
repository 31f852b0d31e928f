"""Response of a square pixel to a blurred edge, one pixel at a time.

The formulas and their sources are those of `roundel.scenes.geometry.edge_spread_function`, which tests compare.
"""

from __future__ import annotations

import math

import numpy as np

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.kernels.compiled import compiled

_SERIES = 0.4  # variance of the blur above which the series is exact to 2e-5
# The normal distribution from a table, ten times faster than the C library's.
_END = 8.5  # beyond, the distribution is 0 or 1 to 1e-17
_PER_UNIT = 64  # knots; cubic interpolation by values and derivatives is then accurate to 2e-10
_KNOTS = np.arange(-int(_END * _PER_UNIT), int(_END * _PER_UNIT) + 1) / _PER_UNIT
_DENSITY = np.exp(-0.5 * _KNOTS**2) / math.sqrt(2 * math.pi)
_TABLE = np.stack(
    [np.array([0.5 * math.erfc(-x / math.sqrt(2)) for x in _KNOTS.tolist()]), _DENSITY, -_KNOTS * _DENSITY], axis=1
)


@compiled
def step_response(z: float, half_sum: float, half_difference: float, variance: float) -> tuple[float, float, float]:
    """Mean of a unit step over a pixel at distance z (px), blurred by a variance (px^2), and two derivatives by z."""
    if variance > _SERIES:
        return _series(z, (half_sum - half_difference) * (half_sum + half_difference), variance + PIXEL_VARIANCE)
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
    scale = 1.0 / sigma
    s1, s2, s3, s4 = (z + outer) * scale, (z + corner) * scale, (z - corner) * scale, (z - outer) * scale
    cdf1, density1 = normal_cdf_and_density(s1)
    cdf2, density2 = normal_cdf_and_density(s2)
    cdf3, density3 = normal_cdf_and_density(s3)
    cdf4, density4 = normal_cdf_and_density(s4)
    first1, first2, first3, first4 = (
        s1 * cdf1 + density1,
        s2 * cdf2 + density2,
        s3 * cdf3 + density3,
        s4 * cdf4 + density4,
    )
    # (s^2 + 1) Phi + s phi = s (s Phi + phi) + Phi
    value = (s1 * first1 + cdf1 - s2 * first2 - cdf2) - (s3 * first3 + cdf3 - s4 * first4 - cdf4)
    inverse = 1.0 / area
    return (
        value * variance * inverse / 2.0,
        ((first1 - first2) - (first3 - first4)) * sigma * inverse,
        ((cdf1 - cdf2) - (cdf3 - cdf4)) * inverse,
    )


@compiled
def _series(z: float, area: float, variance: float) -> tuple[float, float, float]:
    """The same for a blur wider than the pixel, by Edgeworth's series in the cumulants of the pixel's two boxes.

    The cumulants of a box of width w are -w^4 / 120 and w^6 / 252; the squared widths nx^2 and ny^2 sum to one, and
    `area` is |nx ny|. `variance` includes the pixel. Source: M. Kendall, A. Stuart, The Advanced Theory of Statistics,
    volume 1, section 6.18.
    """
    inverse = 1.0 / math.sqrt(variance)
    x = z * inverse
    cdf, density = normal_cdf_and_density(x)
    if density == 0.0:
        return cdf, 0.0, 0.0
    square = inverse * inverse
    fourth = -(1.0 - 2.0 * area * area) / 120.0 * square * square
    sixth = (1.0 - 3.0 * area * area) / 252.0 * square * square * square
    k4, k6, k44 = fourth / 24.0, sixth / 720.0, fourth * fourth / 1152.0
    # Hermite polynomials.
    h2 = x * x - 1.0
    h3 = x * h2 - 2.0 * x
    h4 = x * h3 - 3.0 * h2
    h5 = x * h4 - 4.0 * h3
    h6 = x * h5 - 5.0 * h4
    h7 = x * h6 - 6.0 * h5
    h8 = x * h7 - 7.0 * h6
    h9 = x * h8 - 8.0 * h7
    value = cdf - density * (k4 * h3 + k6 * h5 + k44 * h7)
    slope = density * inverse * (1.0 + k4 * h4 + k6 * h6 + k44 * h8)
    return value, slope, -density * square * (x + k4 * h5 + k6 * h7 + k44 * h9)


@compiled
def gaussian_step(z: float, variance: float) -> tuple[float, float, float]:
    """Step blurred by a Gaussian alone, and two derivatives by z: enough for a rough contour."""
    sigma = math.sqrt(variance)
    cdf, density = normal_cdf_and_density(z / sigma)
    return cdf, density / sigma, -density * z / (sigma * variance)


@compiled
def curved_distance(distance: float, curvature: float, curvature_ss: float, variance: float) -> tuple[float, float]:
    """Distance to the straight edge with the same image, and its derivative by the variance (pixel included)."""
    square = curvature * curvature
    fourth = square * curvature / 12.0 + curvature_ss / 8.0
    first = curvature / 2.0 - square * distance / 4.0 + square * curvature * distance * distance / 6.0
    return distance + variance * (first + variance * fourth), first + 2.0 * variance * fourth


@compiled
def normal_cdf_and_density(x: float) -> tuple[float, float]:
    """Phi(x) and phi(x), with absolute errors below 1e-9."""
    if not x > -_END:
        return 0.0, 0.0
    if x >= _END:
        return 1.0, 0.0
    at = (x + _END) * _PER_UNIT
    i = int(at)
    f = at - i
    step = 1.0 / _PER_UNIT
    f2 = f * f
    h01 = f2 * (3.0 - 2.0 * f)
    h00 = 1.0 - h01
    h10, h11 = step * f * (1.0 - f) ** 2, step * f2 * (f - 1.0)
    cdf = h00 * _TABLE[i, 0] + h10 * _TABLE[i, 1] + h01 * _TABLE[i + 1, 0] + h11 * _TABLE[i + 1, 1]
    return cdf, h00 * _TABLE[i, 1] + h10 * _TABLE[i, 2] + h01 * _TABLE[i + 1, 1] + h11 * _TABLE[i + 1, 2]
