"""The ellipse of edge points along a contour: sectors off it are left out, and shared errors widen its covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.contour_sectors import deviating_sectors, direction_of, shared_excess
from roundel.solver.fit.ellipse import (
    MIN_POINTS,
    EllipseFit,
    FailedFit,
    finished_fit,
    fit_ellipse,
    inverse_sigmas,
    shape_of_ellipse,
)
from roundel.solver.fit.row_motion import RowMotion, widened
from roundel.solver.kernels.ellipse_distances import settled_shape, shape_rows

Array = NDArray[np.float64]

_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class EdgeFit(EllipseFit):
    """An ellipse fitted to edge points in the order of the contour.

    Attributes
    ----------
    rejected_fraction : float
        Share of the points that were left out.
    """

    rejected_fraction: float


def fit_edges(
    points_px: Array,
    sigma_px: Array,
    motion: RowMotion | None = None,
    image_px: Array | None = None,
    start: Array | None = None,
) -> EdgeFit | FailedFit:
    """Orthogonal-distance fit to the points of a contour.

    Parameters
    ----------
    points_px : (N, 2) array
        In the order of the contour.
    sigma_px : (N,) array
        Standard deviations along the normal.
    motion : RowMotion, optional
        Of a rolling shutter; it widens the covariance.
    image_px : (N, 2) array, optional
        The points in the image, if lens distortion was removed from `points_px`.
    start : (5,) array, optional
        An ellipse close to the points.

    Returns
    -------
    EdgeFit or FailedFit
    """
    keep, ones = np.ones(len(points_px), bool), np.ones(len(points_px))
    fit = _fitted(points_px, sigma_px, start)
    if isinstance(fit, FailedFit):
        return fit
    for _ in range(_ROUNDS):
        bad = deviating_sectors(_rows(fit, points_px)[5], sigma_px, ones, ones, keep, 1)  # no pixels: offsets alone
        if not np.any(bad):
            break
        keep &= ~bad
        again = _fitted(points_px[keep], sigma_px[keep], fit.ellipse)
        if isinstance(again, FailedFit):
            return again
        fit = again
    rows = _rows(fit, points_px[keep])
    shape, distance = rows[:5].T, rows[5]
    # The fit's variance is that of its residuals; what they share comes on top.
    scale = float(np.sqrt(np.mean((distance / sigma_px[keep]) ** 2)))
    direction = direction_of(fit.ellipse, points_px[keep])
    excess = shared_excess(distance, scale * sigma_px[keep], direction, shape) if scale > 0 else 1.0
    shape_cov = fit.shape_cov * excess
    if motion is not None:
        at = (points_px if image_px is None else image_px)[keep]
        shape_cov = widened(shape_cov, shape, sigma_px[keep], motion.time_s(at, at.mean(axis=0)), motion)
    done = finished_fit(shape_of_ellipse(fit.ellipse), fit.residual_px, fit.sigma_px**2, shape_cov)
    return EdgeFit(**vars(done), rejected_fraction=1.0 - float(np.mean(keep)))


def _fitted(points_px: Array, sigma_px: Array, start: Array | None) -> EllipseFit | FailedFit:
    """As `fit_ellipse`, which takes over where the start is not close."""
    inverse_sigma = inverse_sigmas(sigma_px, len(points_px))
    if start is not None and len(points_px) > MIN_POINTS and not isinstance(inverse_sigma, FailedFit):
        theta, rows, inverse = shape_of_ellipse(start), np.empty((6, len(points_px))), np.empty((5, 5))
        if settled_shape(theta, points_px, inverse_sigma, rows, inverse):
            variance = float(rows[5] @ rows[5]) / (len(points_px) - 5)
            return finished_fit(theta, rows[5] / inverse_sigma, variance, inverse * variance)
    return fit_ellipse(points_px, sigma_px, start=start)


def _rows(fit: EllipseFit, points_px: Array) -> Array:
    """Derivatives of the points' distances by the shape, and the distances: (6, N)."""
    rows = np.empty((6, len(points_px)))
    shape_rows(shape_of_ellipse(fit.ellipse), points_px, np.ones(len(points_px)), rows)
    return rows
