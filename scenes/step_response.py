"""What a pixel records of a straight edge: the area of a square, blurred by a Gaussian, in closed form."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

Array = NDArray[np.float64]

PIXEL_VARIANCE = 1.0 / 12.0


def step_response(z: Array, half_sum: Array, half_difference: Array, variance: float) -> tuple[Array, Array, Array]:
    """Mean of a unit step at 0 over a square pixel centred at z along the normal, after a Gaussian blur; T, T', T''.

    The pixel projects to a trapezoid, the convolution of two boxes of widths w1 = |nu_x| and w2 = |nu_y|: a second
    difference of the Gaussian's iterated integrals.
    """
    sigma = math.sqrt(variance)
    w1w2 = half_sum**2 - half_difference**2
    # Along a row or column one box has no width: a thin one is the same to 1e-6 and keeps the differences finite.
    thin = w1w2 < 1e-3
    corner = np.where(thin, np.abs(half_difference) - 5e-4, np.abs(half_difference))
    outer = np.where(thin, corner + 1e-3, half_sum)
    area = np.where(thin, (outer - corner) * (outer + corner), w1w2)
    value, slope, bend = np.zeros_like(z), np.zeros_like(z), np.zeros_like(z)
    for shift, sign in ((outer, 1.0), (corner, -1.0), (-corner, -1.0), (-outer, 1.0)):
        s = (z + shift) / sigma
        normal_cdf = ndtr(s)
        density = np.exp(-0.5 * s * s) / math.sqrt(2.0 * math.pi)
        value += sign * (variance / 2) * ((s * s + 1.0) * normal_cdf + s * density)
        slope += sign * sigma * (s * normal_cdf + density)
        bend += sign * normal_cdf
    return value / area, slope / area, bend / area
