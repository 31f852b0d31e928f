"""Ellipse, blur and grey levels fitted to the pixels together, by weighted least squares.

Each pixel of the band around the contour is predicted as `edges` predicts it,

    I = inside + (outside - inside) T(z),

with the response T of a square pixel to a blurred edge and z the distance corrected for the edge's curvature
(`scenes.step_response`). Edge points ignore that all pixels share levels and blur; here the five shape parameters, the
blur and the levels are fitted jointly by Gauss-Newton, weighted by the noise of dark and light pixels. This is the
maximum-likelihood fit for Gaussian noise, close to the Cramer-Rao bound. A circle's pose has as many degrees of freedom
as its ellipse, so this is also the maximum-likelihood pose for any intrinsics.

The blur has a variance, a share of a circle of confusion, a change across a tilted marker, and, if the pixels show it,
a different variance along another direction (motion). Only the change across the marker costs precision, 10 % of the
centre's: the flanks of the edge determine the other parameters, the middle determines the ellipse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, distorts
from roundel.scenes.geometry.conic import ellipse_perimeter_px
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.fit.band_pixels import BandPixels, band_pixels
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.fit.ellipse import EllipseFit, FailedFit, ellipse_of_shape, finished_fit
from roundel.solver.fit.grey_levels import SIZES, first_levels, noise_variances
from roundel.solver.fit.pixel_model import Light, Response, State, Step, gauss_newton, predict, response_of
from roundel.solver.fit.pixel_scene import Scene, scene_of

Array = NDArray[np.float64]

_WIDE_BLUR = 0.2  # fraction of the semi-minor axis
# The local levels of `edges` follow shadows and highlights that smooth functions cannot. At this ratio of both
# residuals (1 to 1.2 in smooth light) its edge points are more accurate.
_UNEVEN = 1.35
_ROUNDING_DN = 0.3
_MAX_STEPS = 20
_SETTLED_PX = 5e-4
_CLOSE_PX = 0.02  # within this step the residuals are those of the noise
_RELINEARISE_PX = 0.04  # distances are linear in the ellipse's step up to an error of (this)^2 / 2 rho
_OUTLIER = 6.0  # sigmas at which Tukey's weight reaches zero: 98 % efficient
_TRUST_PX = 2.0  # largest step: beyond it the linear model is invalid


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
    """

    blur_px: float
    contrast_dn: float
    noise_dn: tuple[float, float]
    misfit: float
    pixels: int


@dataclass(frozen=True, eq=False)
class _Found:
    """The result of Gauss-Newton."""

    state: State
    pixels: BandPixels
    step: Step
    weight: Array
    inverse: Array
    noise: tuple[float, float]


def fit_pixels(
    image: NDArray[Any], edges: EdgePoints, camera: Camera | None = None, full_scale_dn: float = 255.0
) -> PixelFit | FailedFit:
    """Fit an ellipse, blur and grey levels to the pixels along a contour.

    Parameters
    ----------
    image : (H, W) array
        Grey levels.
    edges : EdgePoints
        The contour: the starting value, and which of its sectors to trust.
    camera : Camera, optional
        With lens distortion, the ellipse is in undistorted pixel coordinates.
    full_scale_dn : float
        The level at which pixels saturate.

    Returns
    -------
    PixelFit or FailedFit
    """
    lens = camera if camera is not None and distorts(camera) else None
    scene = scene_of(image, edges, lens, full_scale_dn)
    if isinstance(scene, FailedFit):
        return scene
    variance = max(edges.blur_px, 0.1) ** 2
    state = State(scene.theta, np.zeros(5), variance, 0.0, np.zeros(2), np.zeros(2), np.zeros((2, 1)))
    response = response_of(scene.pixels.band, scene.pixels.band.distance, state)
    # Far from the solution, errors of blur and shape resemble level functions, so the order is chosen again.
    found = _fit(state, scene.pixels, scene, response, SIZES[1], False)
    if isinstance(found, FailedFit):
        return found
    smeared = _smear_shows(found)
    if smeared:
        again = _fit(found.state, found.pixels, scene, found.step.response, SIZES[1], True)
        found, smeared = (found, False) if isinstance(again, FailedFit) else (again, True)
    size = found.state.levels.shape[1]
    # With such a wide blur the level functions resemble the edge itself.
    wide = found.state.variance > (_WIDE_BLUR * float(edges.ellipse[3])) ** 2
    for most in SIZES[2:] if not wide else ():
        wanted = _levels(found.pixels, scene, found.step.response, most, smeared)[0].shape[1]
        if wanted < most:
            break
        size = wanted
    if size != found.state.levels.shape[1]:
        again = _fit(found.state, found.pixels, scene, found.step.response, size, smeared)
        found = found if isinstance(again, FailedFit) else again
    spread_dn = math.sqrt((found.noise[0] + found.noise[1]) / 2)
    if spread_dn > _UNEVEN * max(edges.noise_dn, _ROUNDING_DN):
        return FailedFit("the light on the marker is too uneven for smooth grey levels")
    return _finished(found)


def _smear_shows(found: _Found) -> bool:
    """Whether a blur that differs between directions explains more of the pixels than chance."""
    others = np.delete(np.arange(found.step.design.shape[1]), [9, 10])
    known, asked = found.step.design[:, others], found.step.design[:, 9:11]
    weighted = asked * found.weight[:, None]
    cross = known.T @ weighted
    information = asked.T @ weighted - cross.T @ found.inverse[np.ix_(others, others)] @ cross
    pull = weighted.T @ found.step.residual
    try:
        gain = float(pull @ np.linalg.solve(information, pull))
    except np.linalg.LinAlgError:
        return False
    return gain > 2 * 2 * math.log(len(known))


def _levels(pixels: BandPixels, scene: Scene, response: Response, most: int, smeared: bool) -> tuple[Array, Array]:
    """Levels (2, n) of at most `most` functions, and their residuals."""
    shape, blur = pixels.jacobian * response.slope[:, None], np.stack([response.widening, response.change], axis=1)
    turns = [response.smearing] if smeared else []
    nuisance = np.hstack([shape, blur, scene.place * response.widening[:, None], *turns])
    basis = scene.basis[:, :most]
    outer = basis * response.value[:, None] + scene.basis_slope[:, :most] * response.moment[:, None]
    inside, outside = (replace(p, basis=p.basis[:, :most]) for p in scene.plateaus)
    return first_levels(basis, outer, pixels.band.value, nuisance, (inside, outside))


def _fit(
    state: State, pixels: BandPixels, scene: Scene, response: Response, most: int, smeared: bool
) -> _Found | FailedFit:
    """Gauss-Newton from a state and its pixels, with at most `most` level functions per side."""
    levels, residual = _levels(pixels, scene, response, most, smeared)
    state = replace(state, levels=levels)
    size = levels.shape[1]
    inside, outside = (p.without_stains(c, size) for p, c in zip(scene.plateaus, levels, strict=True))
    light = Light(scene.basis[:, :size], scene.basis_slope[:, :size], scene.place, inside, outside, smeared)
    noise = noise_variances(light.residuals(levels), residual, response.value, levels.size)
    measured = False
    for turn in range(_MAX_STEPS):
        step = predict(pixels, state, light, response if turn == 0 else None)
        weight = 1.0 / (noise[0] + (noise[1] - noise[0]) * step.share)
        if turn > 0:
            weight *= _tukey(step, weight)
        inverse, change = gauss_newton(step, weight, light, state, noise)
        if not np.all(np.isfinite(change)):
            return FailedFit("the pixels do not determine an ellipse")
        moved_px = float(np.max(np.abs(pixels.jacobian @ change[:5])))
        # The blur converges last: its step is measured by the shift of the edge's flanks, and limited to a third.
        flank_px = math.sqrt(state.variance + PIXEL_VARIANCE)
        wanted = state.moved(change)
        blurred_px = (
            float(np.max(np.abs(wanted.smear - state.smear))) / (4 * flank_px)
            + abs(wanted.variance - state.variance) / (2 * flank_px)
            + abs(wanted.disc - state.disc) * flank_px / 20
        )
        part = min(1.0, 0.5 / max(moved_px, 1e-12), flank_px / max(3 * blurred_px, 1e-12))
        state = wanted if part == 1.0 else state.moved(part * change)
        total = float(np.max(np.abs(pixels.jacobian @ state.change)))
        if not total < _TRUST_PX:
            return FailedFit("the ellipse diverges from its edge points")
        largest = max(moved_px, blurred_px)
        if measured and largest < _SETTLED_PX:
            return _Found(state, pixels, step, weight, inverse, noise)
        if largest < _CLOSE_PX and not measured:
            noise = noise_variances(light.residuals(state.levels), step.residual, step.share, levels.size)
            measured = True
        if total > _RELINEARISE_PX:
            again = _relinearised(state, pixels, scene.lens)
            if isinstance(again, FailedFit):
                return again
            state, pixels = again
    return FailedFit("the fit to the pixels does not converge")


def _relinearised(state: State, pixels: BandPixels, lens: Camera | None) -> tuple[State, BandPixels] | FailedFit:
    theta = state.theta + state.change
    if not (theta[2] > 0 and theta[2] * theta[4] - theta[3] ** 2 > 0):
        return FailedFit("the pixels do not bound an ellipse")
    again = band_pixels(pixels.band, theta, lens)
    if len(again.band.value) != len(pixels.band.value):
        return FailedFit("the contour leaves the field of the camera's lens model")
    return replace(state, theta=theta, change=np.zeros(5)), again


def _tukey(step: Step, weight: Array) -> Array:
    """Tukey's robust weights, in units of the noise or of the residual of the edge's pixels, whichever is larger."""
    ratio = np.abs(step.residual) * np.sqrt(weight)
    steep = np.abs(step.slope_dn)
    edge = (steep > 0.2 * float(np.max(steep))) & (weight > 0)
    scale = max(1.0, 1.4826 * float(np.median(ratio[edge]))) if np.any(edge) else 1.0
    return np.asarray(np.maximum(1.0 - (ratio / (_OUTLIER * scale)) ** 2, 0.0) ** 2)


def _under_noise() -> tuple[float, float]:
    """Effect of Tukey's weights w on Gaussian noise r: mean of (w r)^2, variance of the estimate against 1 / mean w.

    With q = 1 / _OUTLIER^2 and the moments 1, 3, 15, 105, 945 of r^2, r^4, ...; the cut at _OUTLIER sigmas is far out.
    """
    q = _OUTLIER**-2
    power = 1 - 4 * q * 3 + 6 * q**2 * 15 - 4 * q**3 * 105 + q**4 * 945
    mean = 1 - 2 * q + q * q * 3
    slope = mean - 4 * q * (1 - 3 * q)
    return power, power / slope**2 * mean


def _finished(found: _Found) -> PixelFit | FailedFit:
    state, pixels, step, weight, noise = found.state, found.pixels, found.step, found.weight, found.noise
    theta = state.theta + state.change
    power, spread = _under_noise()
    variance = noise[0] + (noise[1] - noise[0]) * step.share
    information = step.slope_dn**2 / variance  # of each pixel on the position of the edge
    pull = weight * step.slope_dn * step.residual
    misfit = float(np.sum(pull**2) / np.sum(information)) / power
    count = pixels.band.count
    known = np.bincount(pixels.band.sector, information, minlength=count)
    offset = np.bincount(pixels.band.sector, pull, minlength=count)
    usable = known > 1e-3 * float(np.max(known))
    # Errors shared by pixels along the contour do not average out like noise; the sectors' offsets show them.
    degrees = max(float(np.count_nonzero(usable)) - 6.0, 1.0)
    shared = float(np.sum(offset[usable] ** 2 / known[usable])) / degrees / power
    # Chi-square has a standard deviation of sqrt(2 / n): only more than three of them count as an error of the model.
    effective = float(np.sum(information)) ** 2 / float(np.sum(information**2))
    raised = 1.0
    for excess, freedom in ((misfit, effective), (shared, degrees)):
        if excess > 1.0 + 3.0 * math.sqrt(2.0 / freedom):
            raised = max(raised, excess)
    shape_cov = found.inverse[:5, :5] * (raised * spread)
    if not np.all(np.diag(shape_cov) > 0):
        return FailedFit("the pixels do not determine an ellipse")
    contour_px = float(np.sum(usable)) / count * _perimeter(theta)
    sigma_px = math.sqrt(raised * contour_px / float(np.sum(known)))
    # If the contour is inside the ellipse, the prediction is too low: the residual has the opposite sign.
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
