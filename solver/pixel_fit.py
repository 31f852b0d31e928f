"""The ellipse fitted to the pixels themselves: shape, blur and grey levels together, by weighted least squares.

Each pixel of the band around the contour is predicted as `edges` predicts it,

    I = inside + (outside - inside) T(z),

with the response T of a square pixel to a blurred edge and z the distance corrected for the edge's curvature
(`scenes.step_response`). Edge points ignore that all pixels share levels and blur; here the five shape
parameters, one blur and the levels are fitted at once by Gauss-Newton, weighted by the noise of dark and light pixels:
the maximum-likelihood fit of Gaussian noise, hence at the Cramer-Rao bound. A circle's pose has as many degrees of
freedom as its ellipse, so this also is the maximum-likelihood pose, whatever the intrinsics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera import Camera, distorts, undistort_px
from roundel.scenes.conic import ellipse_perimeter_px
from roundel.scenes.step_response import PIXEL_VARIANCE
from roundel.solver.band_pixels import BandPixels, band_pixels, shape_jacobian
from roundel.solver.edge_band import Band, band_around, kept
from roundel.solver.edges import EdgePoints
from roundel.solver.ellipse import EllipseFit, FailedFit, ellipse_of_shape, finished_fit, fit_ellipse, shape_of_ellipse
from roundel.solver.grey_levels import Plateau, best_order, first_levels, level_basis, noise_variances
from roundel.solver.pixel_model import Scene, State, Step, gauss_newton, predict, response_of

Array = NDArray[np.float64]

_WIDER_PX = 6  # plateaus are taken this much farther than `edges` takes them, where they stay flat
_LAST_PX = 1.5  # of a plateau as `edges` took it: what lies beyond is compared with this
_FLAT = 0.01  # of the contrast
_GROUPS = 12  # directions in which a plateau's flatness is judged
_MAX_STEPS = 12
_SETTLED_PX = 5e-4
_CLOSE_PX = 0.02  # the residuals then are those of the noise
_RELINEARISE_PX = 0.04  # distances move with the ellipse linearly, to (this)^2 / 2 rho
_OUTLIER = 6.0  # sigmas at which Tukey's weight reaches zero: 98 % efficient
_SATURATED = 254.5 / 255.0
_MOST_SATURATED = 0.1
_EDGE_SIGMAS = 5.0  # of the blur with the pixel, and a pixel's half diagonal: the step is over there
_TRUST_PX = 2.0  # of a step: farther away the linear model means nothing


@dataclass(frozen=True, eq=False)
class PixelFit(EllipseFit):
    """An ellipse fitted to pixels.

    As `EllipseFit`, with n the length of contour used in px, sigma_px the standard deviation of an edge point a px that
    would determine the ellipse as well, and residual_px one for each trusted sector of the contour.

    Attributes
    ----------
    blur_px : float
        Gaussian sigma of the blur, the pixel's aperture not included.
    contrast_dn : float
        Median of outside minus inside: positive for dark on light.
    noise_dn : (float, float)
        Standard deviation of a pixel inside and outside.
    misfit : float
        Chi-square of the edge's pixels over its degrees of freedom: 1 where noise is all that the model leaves. Beyond
        what chance allows the covariance is raised by it, or by that of the sectors' offsets.
    pixels : int
        Number of pixels used.
    """

    blur_px: float
    contrast_dn: float
    noise_dn: tuple[float, float]
    misfit: float
    pixels: int


def fit_pixels(
    image: NDArray[Any], edges: EdgePoints, camera: Camera | None = None, full_scale_dn: float = 255.0
) -> PixelFit | FailedFit:
    """Fit an ellipse, blur and grey levels to the pixels along a contour.

    Parameters
    ----------
    image : (H, W) array
        Grey levels.
    edges : EdgePoints
        The contour: where to start, and which sectors of it to trust.
    camera : Camera, optional
        With lens distortion, the ellipse is that of undistorted pixel coordinates.
    full_scale_dn : float
        The level at which pixels saturate.

    Returns
    -------
    PixelFit or FailedFit
    """
    lens = camera if camera is not None and distorts(camera) else None
    low, high = edges.reach_px
    band = band_around(image, edges.ellipse, (low - _WIDER_PX, high + _WIDER_PX), len(edges.trusted))
    used = edges.trusted[band.sector]
    if not np.any(used):
        return FailedFit("the contour lies outside the image")
    low, high = _flat_reach(band, used, edges)
    used &= (band.distance >= low) & (band.distance <= high)
    saturated = band.value >= full_scale_dn * _SATURATED
    if np.count_nonzero(saturated & used) > _MOST_SATURATED * np.count_nonzero(used):
        return FailedFit("too many pixels are saturated to know the grey levels")
    used &= ~saturated
    # Beyond the edge's reach a pixel knows of its own grey level only.
    variance = max(edges.blur_px, 0.1) ** 2
    reach = _EDGE_SIGMAS * math.sqrt(variance + PIXEL_VARIANCE) + 0.8
    order = best_order(int(np.count_nonzero(used)))
    place = (edges.ellipse[:2], max(float(edges.ellipse[2]), 2.0), order)
    plateaus = tuple(
        Plateau(level_basis(band.pixel_px[side], *place), band.value[side])
        for side in (used & (band.distance < -reach), used & (band.distance > reach))
    )
    started = _start(kept(band, used & (np.abs(band.distance) <= reach)), edges, lens)
    if isinstance(started, FailedFit):
        return started
    theta, pixels = started
    basis = level_basis(pixels.band.pixel_px, *place)
    if len(basis) < 12 or len(basis) + sum(len(p.value) for p in plateaus) < 40:
        return FailedFit("too few pixels along the contour")
    response = response_of(pixels.band, pixels.band.distance, variance, 0.0)
    steps = pixels.band.pixel_px + pixels.band.normal, pixels.band.pixel_px - pixels.band.normal
    basis_slope = (level_basis(steps[0], *place) - level_basis(steps[1], *place)) / 2
    across = (pixels.band.pixel_px - place[0]) / place[1]
    nuisance = np.column_stack(
        [
            pixels.jacobian * response.slope[:, None],
            response.widening,
            response.change,
            across * response.widening[:, None],
        ]
    )
    outer = basis * response.value[:, None] + basis_slope * response.moment[:, None]
    coefficients, residual = first_levels(basis, outer, pixels.band.value, nuisance, (plateaus[0], plateaus[1]))
    size = coefficients.shape[1]
    inside, outside = (p.without_stains(c, size) for p, c in zip(plateaus, coefficients, strict=True))
    scene = Scene(basis[:, :size], basis_slope[:, :size], across, inside, outside, lens)
    left = (inside.residual(coefficients[0]), outside.residual(coefficients[1]))
    noise = noise_variances(left, residual, response.value, 2 * size)
    return _iterated(State(theta, np.zeros(5), variance, 0.0, np.zeros(2), coefficients), pixels, scene, noise)


def _iterated(state: State, pixels: BandPixels, scene: Scene, noise: tuple[float, float]) -> PixelFit | FailedFit:
    measured = False
    for turn in range(_MAX_STEPS):
        step = predict(pixels, state, scene)
        weight = 1.0 / (noise[0] + (noise[1] - noise[0]) * step.response)
        if turn > 0:
            weight *= _tukey(step, weight)
        inverse, change = gauss_newton(step, weight, scene, state, noise)
        if not np.all(np.isfinite(change)):
            return FailedFit("the pixels do not determine an ellipse")
        largest = float(np.max(np.abs(pixels.jacobian @ change[:5])))
        part = min(1.0, 0.5 / max(largest, 1e-12))
        state = state.moved(part * change)
        import os
        if os.environ.get("DBG"):
            print(turn, "largest %.4f" % largest, state.variance, state.disc, state.gradient, "rms", np.sqrt(np.mean(step.residual**2)), noise)
        total = float(np.max(np.abs(pixels.jacobian @ state.change)))
        if not total < _TRUST_PX:
            return FailedFit("the ellipse runs away from its edge points")
        # The blur settles last: it is counted by what it moves the edge's flanks.
        largest = max(largest, abs(float(change[5])) / (2 * math.sqrt(state.variance)), abs(float(change[6])) / 20)
        if measured and largest < _SETTLED_PX:
            return _finished(state, pixels, step, weight, inverse, noise)
        if largest < _CLOSE_PX and not measured:
            left = scene.inside.residual(state.levels[0]), scene.outside.residual(state.levels[1])
            noise = noise_variances(left, step.residual, step.response, state.levels.size)
            measured = True
        if total > _RELINEARISE_PX:
            state = replace(state, theta=state.theta + state.change, change=np.zeros(5))
            theta = state.theta
            if not (theta[2] > 0 and theta[2] * theta[4] - theta[3] ** 2 > 0):
                return FailedFit("the pixels do not bound an ellipse")
            again = band_pixels(pixels.band, theta, scene.lens)
            if len(again.band.value) != len(pixels.band.value):
                return FailedFit("the contour leaves the field of the camera's lens model")
            pixels = again
    return FailedFit("the fit to the pixels does not settle")


def _start(band: Band, edges: EdgePoints, lens: Camera | None) -> tuple[Array, BandPixels] | FailedFit:
    """Starting shape, in undistorted pixel coordinates, and the band's pixels about it."""
    if lens is None:
        return shape_of_ellipse(edges.ellipse), BandPixels(band, shape_jacobian(band.normal, band.u))
    points = undistort_px(lens, edges.points_px)
    good = np.isfinite(points).all(axis=1)
    fit = fit_ellipse(points[good], edges.sigma_px[good])
    if isinstance(fit, FailedFit):
        return fit
    theta = shape_of_ellipse(fit.ellipse)
    return theta, band_pixels(band, theta, lens)


def _flat_reach(band: Band, used: NDArray[np.bool_], edges: EdgePoints) -> tuple[float, float]:
    """How far the plateaus go on beyond the reach of `edges`: until some directions no longer have their level."""
    ends = []
    for sign, end in ((-1.0, edges.reach_px[0]), (1.0, edges.reach_px[1])):
        beyond = sign * (band.distance - end)
        outer = np.flatnonzero(used & (beyond > -_LAST_PX))
        # Bin 0 is the last that `edges` took, the others are 1 px each.
        index = np.maximum(np.ceil(beyond[outer]), 0.0).astype(np.int64) * _GROUPS
        index += band.sector[outer] * _GROUPS // band.count
        inside = index < (_WIDER_PX + 1) * _GROUPS
        index, outer = index[inside], outer[inside]
        number = np.bincount(index, minlength=(_WIDER_PX + 1) * _GROUPS).reshape(-1, _GROUPS)
        total = np.bincount(index, band.value[outer], minlength=(_WIDER_PX + 1) * _GROUPS).reshape(-1, _GROUPS)
        mean = total / np.maximum(number, 1)
        extent = 0
        for i in range(1, _WIDER_PX + 1):
            both = (number[0] > 0) & (number[i] > 0)
            if np.count_nonzero(both) < 3:
                break
            allowed = (_FLAT * edges.contrast_dn) ** 2 + 2 * edges.noise_dn**2 * np.mean(
                1 / number[0][both] + 1 / number[i][both]
            )
            if np.mean((mean[i] - mean[0])[both] ** 2) > allowed:
                break
            extent = i
        ends.append(end + sign * extent)
    return ends[0], ends[1]


def _tukey(step: Step, weight: Array) -> Array:
    """Tukey's robust weights, in units of the noise or of what the model leaves of the edge's own pixels if more."""
    ratio = np.abs(step.residual) * np.sqrt(weight)
    steep = np.abs(step.slope_dn)
    edge = (steep > 0.2 * float(np.max(steep))) & (weight > 0)
    scale = max(1.0, 1.4826 * float(np.median(ratio[edge]))) if np.any(edge) else 1.0
    return np.asarray(np.maximum(1.0 - (ratio / (_OUTLIER * scale)) ** 2, 0.0) ** 2)


def _under_noise() -> tuple[float, float]:
    """What Tukey's weights w make of Gaussian noise r: mean of (w r)^2, variance of the estimate against 1 / mean w.

    With q = 1 / _OUTLIER^2 and the moments 1, 3, 15, 105, 945 of r^2, r^4, ...; the cut at _OUTLIER sigmas is far out.
    """
    q = _OUTLIER**-2
    power = 1 - 4 * q * 3 + 6 * q**2 * 15 - 4 * q**3 * 105 + q**4 * 945
    mean = 1 - 2 * q + q * q * 3
    slope = mean - 4 * q * (1 - 3 * q)
    return power, power / slope**2 * mean


def _finished(
    state: State, pixels: BandPixels, step: Step, weight: Array, inverse: Array, noise: tuple[float, float]
) -> PixelFit | FailedFit:
    theta = state.theta + state.change
    power, spread = _under_noise()
    variance = noise[0] + (noise[1] - noise[0]) * step.response
    information = step.slope_dn**2 / variance  # each pixel's, about the place of the edge
    pull = weight * step.slope_dn * step.residual
    misfit = float(np.sum(pull**2) / np.sum(information)) / power
    count = pixels.band.count
    known = np.bincount(pixels.band.sector, information, minlength=count)
    offset = np.bincount(pixels.band.sector, pull, minlength=count)
    usable = known > 1e-3 * float(np.max(known))
    # What pixels share along the contour does not average out as noise does: it shows in the sectors' offsets.
    degrees = max(float(np.count_nonzero(usable)) - 6.0, 1.0)
    shared = float(np.sum(offset[usable] ** 2 / known[usable])) / degrees / power
    # Chi-square scatters by sqrt(2 / n): only beyond three times that is it the model's fault.
    effective = float(np.sum(information)) ** 2 / float(np.sum(information**2))
    raised = 1.0
    for excess, freedom in ((misfit, effective), (shared, degrees)):
        if excess > 1.0 + 3.0 * math.sqrt(2.0 / freedom):
            raised = max(raised, excess)
    shape_cov = inverse[:5, :5] * (raised * spread)
    if not np.all(np.diag(shape_cov) > 0):
        return FailedFit("the pixels do not determine an ellipse")
    contour_px = float(np.sum(usable)) / count * _perimeter(theta)
    sigma_px = math.sqrt(raised * contour_px / float(np.sum(known)))
    # The prediction falls short where the contour lies farther in than the ellipse: its residual is the negative.
    fit = finished_fit(theta, -offset[usable] / known[usable], sigma_px**2, shape_cov)
    return PixelFit(
        fit.ellipse,
        fit.cov,
        sigma_px,
        max(round(contour_px), 6),
        shape_cov,
        fit.residual_px,
        blur_px=math.sqrt(state.variance),
        contrast_dn=float(state.levels[1, 0] - state.levels[0, 0]),
        noise_dn=(math.sqrt(noise[0]), math.sqrt(noise[1])),
        misfit=misfit,
        pixels=int(np.count_nonzero(weight)),
    )


def _perimeter(theta: Array) -> float:
    return float(ellipse_perimeter_px(ellipse_of_shape(theta)))
