"""Edge response of a defocus disc minus that of a Gaussian blur, from a table for one variance.

Defocus blurs by a disc of radius R, whose variance along any direction is R^2 / 4. Its line spread function is a
semicircle, f(u) = 2 sqrt(R^2 - u^2) / (pi R^2). The pixel's square is small in comparison and is approximated by a
Gaussian of the same variance.

The curvature correction of a Gaussian blur is kappa v / 2 times the density. For an isotropic blur of any shape it is
kappa / 2 times M(n) = E[u_t^2; u_n = n] (u_t, u_n the components along and across the edge), and M is the integral of
u p(u) from n on: for the disc 2 (R^2 - n^2)^(3/2) / (3 pi R^2).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.edge_response import normal_cdf_and_density

Array = NDArray[np.float64]

STEPS = 240  # of the table; linear interpolation is then accurate to 1e-4
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(7)  # of the Gaussian that approximates the pixel


@compiled
def disc_table(variance: float, table: Array) -> float:
    """Write the table (STEPS, 5) for a blur's variance without the pixel, px^2; returns the distance of its ends.

    Columns: response, density and moment M of the disc minus those of the Gaussian, the change by curvature, and its
    derivative by the distance.
    """
    radius, pixel = 2.0 * math.sqrt(variance), math.sqrt(PIXEL_VARIANCE)
    total = variance + PIXEL_VARIANCE
    spread = math.sqrt(total)
    end = radius + 5.0 * spread
    step = 2.0 * end / (STEPS - 1)
    for i in range(STEPS // 2):  # the other half mirrors it
        at = -end + i * step
        response, density, cubes = 0.0, 0.0, 0.0
        for j in range(len(_NODES)):
            u = min(max((at - pixel * _NODES[j]) / radius, -1.0), 1.0)
            root = math.sqrt(1.0 - u * u)
            weight = _WEIGHTS[j] / math.sqrt(2.0 * math.pi)
            response += weight * (u * root + math.asin(u))
            density += weight * root
            cubes += weight * root * root * root
        response, density = 0.5 + response / math.pi, density * 2.0 / (math.pi * radius)
        tangential = cubes * 2.0 * radius / (3.0 * math.pi) + PIXEL_VARIANCE * density
        cdf, gauss = normal_cdf_and_density(at / spread)
        gauss /= spread
        table[i, 0], table[i, 1], table[i, 2] = response - cdf, density - gauss, tangential - total * gauss
        table[i, 3] = (tangential - total * density) / 2.0
        mirror = STEPS - 1 - i
        table[mirror, 0] = -table[i, 0]
        for j in range(1, 4):
            table[mirror, j] = table[i, j]
    for i in range(STEPS):
        low, high = max(i - 1, 0), min(i + 1, STEPS - 1)
        table[i, 4] = (table[high, 3] - table[low, 3]) / ((high - low) * step)
    return end


@compiled
def disc_scale(variance: float, own: float) -> tuple[float, float]:
    """How a table for a variance serves for another one: factor of the distances, and of the change.

    A wider blur scales the distances. The change by a disc falls with the fourth power of its share of the sigma.
    """
    total, whole = variance + PIXEL_VARIANCE, own + PIXEL_VARIANCE
    return math.sqrt(total / whole), min(own / whole * (total / variance), 1.0) ** 2


@compiled
def disc_minus_gauss(
    z: float, curvature: float, own: float, narrower: float, part: float, table: Array, end: float
) -> tuple[float, float, float, float]:
    """Change of a pixel's response from a Gaussian blur to a disc.

    Parameters
    ----------
    z, curvature : float
        Distance from the edge, px, and curvature, 1/px.
    own : float
        Variance across the edge at this pixel, px^2.
    narrower, part : float
        See `disc_scale`.
    table, end
        See `disc_table`.

    Returns
    -------
    change, slope, widening, moment : float
        Of the response; its derivatives by the distance and by the variance; M of the disc minus that of the Gaussian.
    """
    at = min(max((z * narrower + end) * ((STEPS - 1) / (2.0 * end)), 0.0), STEPS - 1.001)
    left = int(at)
    f = at - left
    a, b = table[left], table[left + 1]
    bent = curvature / narrower
    change = part * (a[0] + (b[0] - a[0]) * f + bent * (a[3] + (b[3] - a[3]) * f))
    slope = part * (narrower * (a[1] + (b[1] - a[1]) * f) + curvature * (a[4] + (b[4] - a[4]) * f))
    # By the same scaling; the change of the pixel's share is neglected, of order 1/12 over the variance.
    widening = -z * slope / (2.0 * (own + PIXEL_VARIANCE))
    return change, slope, widening, part * (a[2] + (b[2] - a[2]) * f) / narrower
