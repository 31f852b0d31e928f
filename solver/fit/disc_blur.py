"""Edge response of a defocus disc, relative to a Gaussian blur of the same variance.

Defocus blurs by a disc of radius R, whose variance along any direction is R^2 / 4. Its line spread function is a
semicircle, f(u) = 2 sqrt(R^2 - u^2) / (pi R^2). The pixel's square is small in comparison and is approximated by a
Gaussian of the same variance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE

Array = NDArray[np.float64]

_STEPS = 240  # of the tables; linear interpolation is then accurate to 1e-4
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(7)  # of the Gaussian that approximates the pixel


@dataclass(frozen=True, eq=False)
class DiscMinusGauss:
    """The change from a Gaussian blur to a disc, at each pixel.

    Attributes
    ----------
    change : (N,) array
        Response of the disc minus that of the Gaussian.
    slope, widening : (N,) arrays
        Its derivatives by the distance and by the blur's variance.
    moment : (N,) array
        M of the disc minus that of the Gaussian, see `disc_minus_gauss`.
    """

    change: Array
    slope: Array
    widening: Array
    moment: Array


def disc_minus_gauss(z: Array, curvature: Array, variance: float, own: float | Array) -> DiscMinusGauss:
    """The difference at distances z from an edge, with the curvature correction of a Gaussian blur.

    That correction is kappa v / 2 times the density. For an isotropic blur of any shape it is kappa / 2 times
    M(n) = E[u_t^2; u_n = n] (u_t, u_n the components along and across the edge), and M is the integral of u p(u) from n
    on: here 2 (R^2 - n^2)^(3/2) / (3 pi R^2).

    Parameters
    ----------
    z, curvature : (N,) arrays
    variance : float
        Variance of the blur without the pixel, px^2: that of the tabulated disc.
    own : float or (N,) array
        Variance across the edge at each pixel; the table is scaled to it.
    """
    radius, pixel = 2.0 * math.sqrt(variance), math.sqrt(PIXEL_VARIANCE)
    total = variance + PIXEL_VARIANCE
    spread = math.sqrt(total)
    end = radius + 5.0 * spread
    grid = np.linspace(-end, end, _STEPS)
    u = np.clip((grid[:, None] - pixel * _NODES) / radius, -1.0, 1.0)
    weights = _WEIGHTS / math.sqrt(2 * math.pi)
    root = np.sqrt(1.0 - u * u)
    response = 0.5 + ((u * root + np.arcsin(u)) @ weights) / math.pi
    density = (root @ weights) * (2.0 / (math.pi * radius))
    tangential = (root**3 @ weights) * (2.0 * radius / (3.0 * math.pi)) + PIXEL_VARIANCE * density
    scaled = grid / spread
    gauss = np.exp(-0.5 * scaled * scaled) / (spread * math.sqrt(2 * math.pi))
    bent = (tangential - total * density) / 2
    bent_slope = np.gradient(bent, grid[1] - grid[0])
    table = np.stack([response - ndtr(scaled), density - gauss, tangential - total * gauss, bent, bent_slope])
    # A wider blur scales the distances. The change by a disc falls with the fourth power of its share of the sigma.
    narrower = np.sqrt(total / (own + PIXEL_VARIANCE))
    part = np.minimum((own / (own + PIXEL_VARIANCE)) * (total / variance), 1.0) ** 2
    # Linear interpolation in all rows at once, because the grid is uniform.
    at = np.clip((z * narrower + end) * ((_STEPS - 1) / (2 * end)), 0.0, _STEPS - 1.001)
    left = at.astype(np.int64)
    rows = table[:, left]
    rows += (table[:, left + 1] - rows) * (at - left)
    rows *= part
    change = rows[0] + (curvature / narrower) * rows[3]
    slope = narrower * rows[1] + curvature * rows[4]
    # By the same scaling; the change of the pixel's share is neglected, of order 1/12 over the variance.
    return DiscMinusGauss(change, slope, -z * slope / (2 * (own + PIXEL_VARIANCE)), rows[2] / narrower)
