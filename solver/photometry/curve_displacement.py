"""Uncertainty of an ellipse whose image has an unknown response curve, for fits that do not know of it.

Where light is halfway between both sides, an encoded level is not: undoing the wrong curve, or none, moves the edge
along its normal by a distance that depends on the blur and both levels, the same all around the contour.
"""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.response_curve import SRGB
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.fit.ellipse import EllipseFit, finished_fit, shape_of_ellipse
from roundel.solver.kernels.contour_pixels import sector_centres

Array = NDArray[np.float64]

_POINTS = 64


def edge_displacement_px(inside: float, outside: float, blur_px: float) -> float:
    """Distance, toward the outside, from the edge to where a level of an sRGB image is halfway between both sides.

    Parameters
    ----------
    inside, outside : float
        Levels on both sides, as fractions of the range.
    blur_px : float
        Gaussian sigma of the blur, excluding the pixel's aperture.
    """
    low, high = SRGB.light(np.clip([inside, outside], 0.0, 1.0))
    if math.isclose(low, high):
        return 0.0
    middle = float(SRGB.light((inside + outside) / 2))
    share = min(max((middle - low) / (high - low), 1e-3), 1 - 1e-3)
    return float(math.sqrt(blur_px**2 + PIXEL_VARIANCE) * NormalDist().inv_cdf(share))


def displaced(fit: EllipseFit, distance_px: float, sigma_px: float) -> EllipseFit:
    """The ellipse after its contour was moved along its normal, and with the uncertainty of that move.

    Parameters
    ----------
    fit : EllipseFit
    distance_px : float
        Toward the outside, the same all around.
    sigma_px : float
        Its standard deviation, included in the covariance.
    """
    _, normals, u = sector_centres(fit.ellipse, _POINTS)
    # The change of shape that displaces each point of the contour by 1 px along its normal, as nearly as possible.
    nx, ny = normals.T
    along = np.column_stack([nx, ny, nx * u[:, 0], nx * u[:, 1] + ny * u[:, 0], ny * u[:, 1]])
    outward = np.linalg.solve(along.T @ along, along.sum(axis=0))
    shape_cov = fit.shape_cov + sigma_px**2 * np.outer(outward, outward)
    theta = shape_of_ellipse(fit.ellipse) + distance_px * outward
    moved = finished_fit(theta, fit.residual_px, fit.sigma_px**2, shape_cov)
    return replace(fit, ellipse=moved.ellipse, cov=moved.cov, shape_cov=moved.shape_cov)
