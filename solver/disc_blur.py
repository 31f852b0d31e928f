"""How a circle of confusion differs from a Gaussian blur of the same variance, at an edge.

An aperture out of focus blurs by a disc of radius R, whose variance along any direction is R^2 / 4. Across a straight
edge it spreads a semicircle, f(u) = 2 sqrt(R^2 - u^2) / (pi R^2). The pixel's square is small beside it: a Gaussian of
its variance stands for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from roundel.scenes.step_response import PIXEL_VARIANCE

Array = NDArray[np.float64]

_STEPS = 500  # of the tables; linear interpolation then is right to 1e-5
_LITTLE = 1e-3
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(9)  # of the Gaussian that stands for the pixel


@dataclass(frozen=True, eq=False)
class DiscMinusGauss:
    """What replaces a Gaussian blur by a disc, at each pixel.

    Attributes
    ----------
    change : (N,) array
        Response to the disc minus that to the Gaussian.
    slope, widening : (N,) arrays
        Its derivatives by the distance and by the blur's variance.
    moment : (N,) array
        M of the disc minus that of the Gaussian, see `disc_minus_gauss`.
    """

    change: Array
    slope: Array
    widening: Array
    moment: Array


def disc_minus_gauss(z: Array, curvature: Array, variance: float) -> DiscMinusGauss:
    """The difference at distances z from an edge, corrected for its curvature as a Gaussian blur's is.

    That correction, kappa v / 2 times the density, is the Gaussian's. For an isotropic blur of any shape it is
    kappa / 2 times M(n) = E[u_t^2; u_n = n] (u_t, u_n its parts along and across), and M is the integral of u p(u)
    from n on: here 2 (R^2 - n^2)^(3/2) / (3 pi R^2).

    Parameters
    ----------
    z, curvature : (N,) arrays
    variance : float
        Of the blur without the pixel, px^2.
    """
    radius = 2.0 * math.sqrt(variance)
    total = variance + PIXEL_VARIANCE
    spread = math.sqrt(total)
    end = radius + 5.0 * spread
    grid = np.linspace(-end, end, _STEPS)
    scattered = (grid[:, None] - math.sqrt(PIXEL_VARIANCE) * _NODES) / radius
    u = np.clip(scattered, -1.0, 1.0)
    weights = _WEIGHTS / math.sqrt(2 * math.pi)
    root = np.sqrt(1.0 - u * u)
    response = 0.5 + ((u * root + np.arcsin(u)) @ weights) / math.pi
    density = (root @ weights) * (2.0 / (math.pi * radius))
    tangential = (root**3 @ weights) * (2.0 * radius / (3.0 * math.pi)) + PIXEL_VARIANCE * density
    by_radius = ((u * root) @ weights) * (-2.0 / (math.pi * radius))
    # Its derivative is singular at the disc's rim: a difference over a little more radius instead.
    wider = np.sqrt(1.0 - np.minimum((scattered / (1.0 + _LITTLE)) ** 2, 1.0)) @ weights * (2.0 / (math.pi * radius))
    by_radius_density = (wider / (1.0 + _LITTLE) - density) / (_LITTLE * radius)
    by_radius_tangential = ((3.0 * root - 2.0 * root**3) @ weights) * (2.0 / (3.0 * math.pi))
    by_radius_tangential += PIXEL_VARIANCE * by_radius_density
    by_variance = 1.0 / math.sqrt(variance)  # dR / dv
    bent_widening = ((by_radius_tangential - total * by_radius_density) * by_variance - density) / 2
    scaled = grid / spread
    gauss = np.exp(-0.5 * scaled * scaled) / (spread * math.sqrt(2 * math.pi))
    bent = (tangential - total * density) / 2
    bent_slope = np.gradient(bent, grid[1] - grid[0])
    # Of the Gaussian's response the derivative by the variance is half the slope of its density.
    widening = by_radius * by_variance + scaled * gauss / (2 * spread)
    table = np.stack(
        [
            response - ndtr(scaled),
            density - gauss,
            widening,
            tangential - total * gauss,
            bent,
            bent_slope,
            bent_widening,
        ]
    )
    # Linear interpolation in all rows at once: the grid is even.
    at = np.clip((z + end) * ((_STEPS - 1) / (2 * end)), 0.0, _STEPS - 1.001)
    left = at.astype(np.int64)
    part = at - left
    rows = table[:, left]
    rows += (table[:, left + 1] - rows) * part
    return DiscMinusGauss(
        rows[0] + curvature * rows[4], rows[1] + curvature * rows[5], rows[2] + curvature * rows[6], rows[3]
    )
