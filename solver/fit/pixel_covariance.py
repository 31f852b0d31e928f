"""The covariance of a fit to the pixels: that of the noise, raised by what the residuals show of the model's errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.contour_sectors import shared_excess
from roundel.solver.fit.ellipse import EllipseFit, FailedFit, ellipse_of_shape, finished_fit, shape_of_ellipse
from roundel.solver.fit.pixel_scene import PixelScene
from roundel.solver.fit.row_motion import RowMotion, widened
from roundel.solver.kernels.contour_pixels import X, Y, arc_lengths
from roundel.solver.kernels.contour_scene import sector_sums
from roundel.solver.kernels.pixel_equations import CLIPPED, RATES, RESIDUAL, SHARE, SLOPE, VARIANCE, WEIGHT

Array = NDArray[np.float64]

_OUTLIER = 6.0  # sigmas at which Tukey's weight reaches zero


@dataclass(frozen=True, eq=False)
class FitState:
    """The state of a fit to the pixels.

    Attributes
    ----------
    ellipse : (5,) array
        At which distances were computed, in undistorted pixel coordinates.
    table, jacobian : (N, 12), (N, 5) arrays
        The edge's pixels at that ellipse.
    parameters : (17,) array
        See `pixel_equations`.
    levels : (2, k) array
    used : (m,) array of int
        The parameters that are fitted.
    inverse : (m + 2 k, m + 2 k) array
        Of the normal matrix.
    noise : (2,) array
        Variance of a pixel inside and outside, dn^2.
    record : (N, 5) array
        Of the edge's pixels, see `pixel_equations`.
    rows : (3,) array
        Their times, see `pixel_equations`.
    """

    ellipse: Array
    table: Array
    jacobian: Array
    parameters: Array
    levels: Array
    used: NDArray[np.int64]
    inverse: Array
    noise: Array
    record: Array
    rows: Array


@dataclass(frozen=True, eq=False)
class PixelFit(EllipseFit):
    """An ellipse fitted to pixels.

    As `EllipseFit`, where n is the length of the used contour in px, sigma_px the standard deviation of one edge point
    per px that would determine the ellipse equally well, and residual_px has one value per trusted sector.

    Attributes
    ----------
    blur_px : float
        Gaussian sigma of the blur, excluding the pixel's aperture.
    contrast_dn : float
        Median of outside minus inside: positive for dark on light.
    noise_dn : (float, float)
        Standard deviation of a pixel inside and outside.
    misfit : float
        Chi-square of the edge's pixels over its degrees of freedom: 1 if the residuals are pure noise. If it exceeds
        chance, the covariance is increased by it, or by that of the sectors' offsets.
    pixels : int
        Number of pixels used.
    clipped_fraction : float
        Share of clipped pixels along the contour.
    rejected_fraction : float
        Share of the contour that shows an edge, but not the ellipse's (an occluder, a shadow's edge), and was left out.
    rates : (5,) array
        Rates of (x, y, S11, S12, S22), px/s, if a rolling shutter was fitted, by the pixels alone; else zero. The
        ellipse is then that of the contour in the image, sheared by the first two rates.
    rates_cov : (5, 10) array
        Covariance of the rates with (x, y, S11, S12, S22) and with themselves.
    row_zero_px : float
        The row, or column, for whose time S stands.
    motion_cov : (5, 5) array
        Covariance of the ellipse at one time about that of the contour in the image, by the prior of the rates; zero
        if nothing was fitted of the motion, for it is then part of `shape_cov`.
    """

    blur_px: float
    contrast_dn: float
    noise_dn: tuple[float, float]
    misfit: float
    pixels: int
    clipped_fraction: float
    rejected_fraction: float
    rates: Array
    rates_cov: Array
    row_zero_px: float
    motion_cov: Array


def _under_noise() -> tuple[float, float]:
    """Effect of Tukey's weights w on Gaussian noise r: mean of (w r)^2, variance of the estimate against 1 / mean w.

    With q = 1 / _OUTLIER^2 and the moments 1, 3, 15, 105, 945 of r^2, r^4, ...; the cut at _OUTLIER sigmas is far out.
    """
    q = _OUTLIER**-2
    power = 1 - 4 * q * 3 + 6 * q**2 * 15 - 4 * q**3 * 105 + q**4 * 945
    mean = 1 - 2 * q + q * q * 3
    slope = mean - 4 * q * (1 - 3 * q)
    return power, power / slope**2 * mean


@dataclass(frozen=True, eq=False)
class Sectors:
    """What a fit knows of each sector of the contour.

    Attributes
    ----------
    offset, sigma : (S,) arrays
        Offset of the edge outward from the ellipse and its standard deviation, px; infinite without pixels.
    square, pixels : (S,) arrays
        Sum of the edge's squared residuals over their noise, and the number of its pixels.
    used : (S,) array of bool
        Sectors with enough of the edge.
    shape : (S, 5) array
        Derivative of the distances by the ellipse.
    """

    offset: Array
    sigma: Array
    square: Array
    pixels: Array
    used: NDArray[np.bool_]
    shape: Array


def sectors_of(state: FitState, scene: PixelScene) -> Sectors:
    """Offsets and residuals by sector."""
    return Sectors(*sector_sums(state.record, state.jacobian, scene.starts, state.noise, scene.light))


def _rates_cov(state: FitState, scale: float) -> Array:
    """Covariance (5, 10) of the rates with the shape and themselves; zero if they were not fitted."""
    rates = np.flatnonzero(state.used >= RATES)
    if not len(rates):
        return np.zeros((5, 10))
    return np.asarray(state.inverse[np.ix_(rates, np.array([*range(5), *rates]))] * scale)


def _sector_means(state: FitState, scene: PixelScene) -> Array:
    """Mean position (S, 2) of the edge's pixels in each sector, image px."""
    count = len(scene.starts) - 1
    sector, number = np.repeat(np.arange(count), np.diff(scene.starts)), np.maximum(np.diff(scene.starts), 1)
    places = [np.bincount(sector, state.table[:, i], minlength=count) for i in (X, Y)]
    return np.stack(places, axis=1) / number[:, None]


def _by_pixel(state: FitState, scene: PixelScene) -> tuple[Array, Array]:
    """Information of each pixel on the position of the edge, and its pull on it; none of clipped pixels."""
    residual, slope_dn, share, weight = (state.record[:, i] for i in (RESIDUAL, SLOPE, SHARE, WEIGHT))
    variance = state.noise[0] + (state.noise[1] - state.noise[0]) * share
    measured = state.record[:, CLIPPED] == 0.0
    if len(scene.light):
        variance = variance / scene.light[:, 4]
    return np.where(measured, slope_dn**2 / variance, 0.0), np.where(measured, weight * slope_dn * residual, 0.0)


def finished(
    state: FitState, scene: PixelScene, sectors: Sectors, rejected_fraction: float, motion: RowMotion | None = None
) -> PixelFit | FailedFit:
    """The result of a converged fit; a motion that was not fitted widens its covariance."""
    theta = shape_of_ellipse(state.ellipse) + state.parameters[:5]
    ellipse = ellipse_of_shape(theta)
    power, spread = _under_noise()
    information, pull = _by_pixel(state, scene)
    total = float(np.sum(information))
    if not total > 0:
        return FailedFit("the pixels do not determine an ellipse")
    shares = scene.light[:, 4] if len(scene.light) else 1.0  # pulls are weighted by them, too
    misfit = float(np.sum(pull**2)) / float(np.sum(information * shares)) / power
    used = sectors.used
    offset, sigma = sectors.offset[used], sectors.sigma[used]
    # Errors shared by pixels of a sector, and by neighbouring sectors, do not average out like noise.
    degrees = max(float(np.count_nonzero(used)) - 6.0, 1.0)
    near = float(np.sum((offset / sigma) ** 2)) / degrees / power
    count = len(scene.starts) - 1
    direction = np.asarray((np.flatnonzero(used) + 0.5) * (2 * math.pi / count), dtype=np.float64)
    # Chi-square has a standard deviation of sqrt(2 / n): only more than three of them count as an error of the model.
    effective = total**2 / float(np.sum(information**2))
    raised = 1.0
    for excess, freedom in ((misfit, effective), (near, degrees)):
        if excess > 1.0 + 3.0 * math.sqrt(2.0 / freedom):
            raised = max(raised, excess)
    raised = max(raised, shared_excess(offset, sigma, direction, sectors.shape[used]))
    shape_cov = state.inverse[:5, :5] * (raised * spread)
    motion_cov = np.zeros((5, 5))
    if motion is not None:
        places = _sector_means(state, scene)[used]
        time_s = motion.time_s(places, ellipse[:2] if scene.lens is None else places.mean(axis=0))
        motion_cov = widened(motion_cov, sectors.shape[used], sigma, time_s, motion)
        if not motion.fitted:
            shape_cov, motion_cov = shape_cov + motion_cov, 0.0 * motion_cov
    if not np.all(np.diag(shape_cov) > 0):
        return FailedFit("the pixels do not determine an ellipse")
    contour_px = float(np.sum(used)) / count * float(arc_lengths(ellipse[2], ellipse[3])[-1])
    sigma_px = math.sqrt(raised * contour_px / total)
    fit = finished_fit(theta, offset, sigma_px**2, shape_cov)
    return PixelFit(
        fit.ellipse,
        fit.cov,
        sigma_px,
        max(round(contour_px), 6),
        shape_cov,
        fit.residual_px,
        blur_px=math.sqrt(state.parameters[VARIANCE]),
        contrast_dn=float(state.levels[1, 0] - state.levels[0, 0]),
        noise_dn=(math.sqrt(state.noise[0]), math.sqrt(state.noise[1])),
        misfit=misfit,
        pixels=int(np.count_nonzero(state.record[:, WEIGHT])),
        clipped_fraction=scene.clipped_fraction,
        rejected_fraction=rejected_fraction,
        rates=state.parameters[RATES:].copy(),
        rates_cov=_rates_cov(state, raised * spread),
        row_zero_px=float(state.rows[1]),
        motion_cov=motion_cov,
    )
