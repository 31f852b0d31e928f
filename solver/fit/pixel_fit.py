"""Ellipse, blur and grey levels fitted to the pixels together, by weighted least squares.

Each pixel of the band around the contour is predicted as `edges` predicts it,

    I = inside + (outside - inside) T(z),

with the response T of a square pixel to a blurred edge and z the distance corrected for the edge's curvature
(`scenes.step_response`). Edge points ignore that all pixels share levels and blur; here the five shape parameters, the
blur and the levels are fitted jointly by Gauss-Newton, weighted by the noise of dark and light pixels. This is the
maximum-likelihood fit for Gaussian noise, close to the Cramer-Rao bound. A circle's pose has as many degrees of freedom
as its ellipse, so this is also the maximum-likelihood pose for any intrinsics.

The blur has a variance, a share of a circle of confusion, a change across a tilted marker, and, if the pixels show it,
a different variance along another direction (motion) or a soft edge of the ink. Only the change across the marker costs
precision, 10 % of the centre's: the flanks of the edge determine the other parameters, the middle determines the
ellipse.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, distorts
from roundel.solver.fit.band_pixels import place_pixels
from roundel.solver.fit.contour_sectors import deviating_sectors
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.fit.ellipse import FailedFit, ellipse_of_shape, shape_of_ellipse
from roundel.solver.fit.local_light import local_light, near_gaps, parameters_at, record_of
from roundel.solver.fit.pixel_covariance import FitState, PixelFit, finished, sectors_of
from roundel.solver.fit.pixel_scene import SIZES, PixelScene, lit_scene, scene_of, sums_of
from roundel.solver.fit.row_motion import RowMotion
from roundel.solver.kernels.contour_scene import side_medians
from roundel.solver.kernels.disc_blur import STEPS
from roundel.solver.kernels.model_choice import model_choice
from roundel.solver.kernels.pixel_equations import (
    DISC,
    INK,
    PARAMETERS,
    RATES,
    RECORD,
    RESIDUAL,
    SHARE,
    SMEAR,
    VARIANCE,
    pixel_equations,
)
from roundel.solver.kernels.pixel_gauss_newton import (
    CONVERGED,
    DIVERGED,
    MOVED,
    UNDETERMINED,
    UNSETTLED,
    add_priors,
    gauss_newton,
    robust_scale_of,
)

Array = NDArray[np.float64]

_WIDE_VARIANCE = 0.3  # px^2: of a blur whose shape is visible
# Share of a disc: no lens has a blur with shorter tails than a circle of confusion (1; 0.9 to 1.02 in renderings). Soft
# ink's ramp has 1.35. On a circle that is hardly tilted nothing else tells it from a blur.
_RAMP = 1.2
_WIDE_BLUR = 0.2  # fraction of the semi-minor axis
_ROUNDS = 3  # of leaving out sectors
# Chi-square of the edge that the planes of a sector have to explain: chance explains about half (6 in eleven sectors).
_WORTH = 1.5
_MOSTLY = 0.3  # of a contour
_MOVES = 6  # of the ellipse by more than 0.04 px; a fit that settles needs two or three
_FLOOR_DN2 = 1e-4  # no sensor is free of noise: a thousandth of the rounding's variance 1/12

_FAILURES = {
    UNDETERMINED: "the pixels do not determine an ellipse",
    DIVERGED: "the ellipse diverges from its edge points",
    UNSETTLED: "the fit to the pixels does not converge",
}
_UNEVEN_LIGHT = 0.3  # standard deviation of the level functions, in contrasts: for what clipped pixels hide
_INK = 1.0  # standard deviation of the variance of the ink's soft edge, in variances of the blur
_STILL = np.arange(SMEAR)  # shape, variance of the blur, its disc and its gradient
# Even a smear that is too weak to be seen displaces the contour, and it widens the edge as rows do that are read one
# after another.
_MOVING = np.arange(INK)
_ROLLING = np.array([*_MOVING, *range(RATES, PARAMETERS)])
_OUTLIER = 6.0  # sigmas
_CLEARLY = 20.0  # of chi-square; where the ink is soft, one parameter more gains up to twelve
# Beyond these, what the pixels show: parameters, and the sets of them to choose from.
_BEYOND_STILL = np.array([SMEAR, SMEAR + 1, INK]), np.array([[0, 0, 0], [1, 1, 0], [0, 0, 1]])
_BEYOND_MOVING = np.array([INK]), np.array([[0], [1]])


@dataclass(frozen=True, eq=False)
class _Fit:
    """The data of a fit that stay the same while it runs."""

    scene: PixelScene
    edges: EdgePoints
    rows: Array
    floor: Array
    priors: Array
    base: NDArray[np.int64]
    rates_information: Array
    constants: tuple[float, float]
    discs: Array


def fit_pixels(
    image: NDArray[Any],
    edges: EdgePoints,
    camera: Camera | None = None,
    full_scale_dn: float = 255.0,
    noise_floor: Callable[[float], float] | None = None,
    motion: RowMotion | None = None,
) -> PixelFit | FailedFit:
    """Fit an ellipse, blur and grey levels to the pixels along a contour.

    Parameters
    ----------
    image : (H, W) array
        Grey levels; float32 ones are used as they are, others are converted at each call.
    edges : EdgePoints
        The contour: the starting value, and which of its sectors to trust.
    camera : Camera, optional
        With lens distortion, the ellipse is in undistorted pixel coordinates.
    full_scale_dn : float
        The level at which pixels saturate.
    noise_floor : callable, optional
        Least variance of a pixel at a grey level, dn^2: what rounding alone causes.
    motion : RowMotion, optional
        Of a rolling shutter.

    Returns
    -------
    PixelFit or FailedFit
    """
    lens = camera if camera is not None and distorts(camera) else None
    pixels = np.ascontiguousarray(image, dtype=np.float32)
    whole = scene_of(pixels, edges, lens, full_scale_dn, near_gaps(edges.trusted))
    if isinstance(whole, FailedFit):
        return whole
    trusted = edges.trusted
    for rounds in range(1, _ROUNDS + 1):
        fit = _fit_of(lit_scene(whole, trusted), edges, noise_floor, motion)
        settled = _settled(fit)
        state = _first_state(fit) if isinstance(settled, FailedFit) else settled
        if isinstance(settled, FailedFit):
            # Smooth levels may be so wrong that nothing settles; the light beside the contour as found may not be.
            state, fit, trusted = _with_light(state, fit, whole, trusted, False)
        if not len(state.inverse):
            plain = _fitted(fit, state)
            if isinstance(plain, FailedFit):
                return plain
            state = _with_shape(fit, plain)
        state, fit, trusted = _with_light(state, fit, whole, trusted, rounds == 1)
        sectors = sectors_of(state, fit.scene)
        width = math.ceil(math.sqrt(state.parameters[VARIANCE] + max(float(state.parameters[INK]), 0.0)))
        bad = deviating_sectors(sectors.offset, sectors.sigma, sectors.square, sectors.pixels, sectors.used, width)
        if rounds == _ROUNDS or not np.any(bad):
            break
        trusted = trusted & ~bad
    rejected = 1.0 - np.count_nonzero(trusted) / max(int(np.count_nonzero(edges.trusted)), 1)
    return finished(state, fit.scene, max(rejected, 0.0), motion)


def _with_light(
    state: FitState, fit: _Fit, whole: PixelScene, trusted: NDArray[np.bool_], grow: bool
) -> tuple[FitState, _Fit, NDArray[np.bool_]]:
    """The fit with local light where its pixels show some, then with sectors regained at the ends of gaps."""
    if any(whole.clipped):
        return state, fit, trusted
    for growing in (False, True) if grow and not trusted.all() else (False,):
        known = whole is fit.scene and len(state.record)
        record = state.record if known else record_of(state, whole, fit.rows, fit.discs)
        light = local_light(state, whole, record, trusted, growing)
        if light is not None and state.levels.shape[1] > SIZES[0] and light.part > _MOSTLY:
            # Squares that follow a shadow bend too much for planes on top of them.
            state = replace(state, levels=state.levels[:, : SIZES[0]].copy())
            light = local_light(state, whole, record_of(state, whole, fit.rows, fit.discs), trusted, growing)
        if light is None:
            continue
        lit = replace(fit, scene=lit_scene(whole, light.trusted, light.planes, light.share))
        start = replace(
            state,
            ellipse=whole.ellipse,
            table=lit.scene.table,
            jacobian=lit.scene.jacobian,
            parameters=parameters_at(state, whole),
            rows=fit.rows,
        )
        again = _fitted(lit, start)
        if isinstance(again, FailedFit):
            continue
        if len(state.inverse) and np.array_equal(light.trusted, trusted):
            # Light beside the edge that does not reach it only costs precision.
            gain = _chi_square(record, state.noise) - _chi_square(again.record, state.noise)
            if gain < _WORTH * light.part * np.count_nonzero(trusted):
                continue
        state, fit, trusted = again, lit, light.trusted
    return state, fit, trusted


def _fit_of(
    scene: PixelScene,
    edges: EdgePoints,
    noise_floor: Callable[[float], float] | None,
    motion: RowMotion | None,
) -> _Fit:
    contrast_dn, blur2 = abs(edges.contrast_dn), max(edges.blur_px, 0.3) ** 2
    priors = np.array([_INK * blur2, _UNEVEN_LIGHT * contrast_dn])
    rows, base, rates = np.zeros(3), _STILL, np.zeros((5, 5))
    if motion is not None and motion.fitted:
        base = _MOVING
        if motion.row_s > 0:
            rows[:] = motion.row_s, edges.ellipse[0 if motion.along_x else 1], float(motion.along_x)
            base, rates = _ROLLING, motion.wide_information()
    constants = _constants(scene, edges)
    least = [_FLOOR_DN2 if noise_floor is None else max(noise_floor(level), _FLOOR_DN2) for level in constants]
    return _Fit(scene, edges, rows, np.array(least), priors, base, rates, constants, np.zeros((STEPS + 1, 5)))


def _settled(fit: _Fit) -> FitState | FailedFit:
    """The converged fit, with what its model needs."""
    # The contour is known to a small part of its blur: the residuals at the start already tell what the model needs,
    # but for the shape of a wide blur.
    first = _first_state(fit)
    chosen = _chosen(fit, first)
    state = _fitted(fit, chosen)
    if fit.base is _STILL and chosen.used[-1] == INK and chosen.parameters[VARIANCE] < _WIDE_VARIANCE:
        smeared = _fitted(fit, replace(chosen, used=_MOVING))
        if not isinstance(smeared, FailedFit) and _is_preferred(smeared, state):
            state = smeared
    if isinstance(state, FailedFit):
        return state
    return _with_shape(fit, state)


def _with_shape(fit: _Fit, state: FitState) -> FitState:
    """The fit with what the shape of a wide blur shows."""
    if len(state.used) > len(fit.base) or state.parameters[VARIANCE] <= _WIDE_VARIANCE:
        return state
    chosen = _chosen(fit, state)
    if len(chosen.used) == len(fit.base) and state.parameters[DISC] > _RAMP:
        chosen = replace(chosen, used=np.array([*chosen.used, INK]))
    if len(chosen.used) == len(fit.base):
        return state
    again = _fitted(fit, chosen)
    return state if isinstance(again, FailedFit) else again


def _is_preferred(smeared: FitState, inked: FitState | FailedFit) -> bool:
    """Whether the pixels show a smear rather than a soft edge of the ink: to first order a weak one looks like both."""
    if isinstance(inked, FailedFit):
        return True
    return _chi_square(inked.record, inked.noise) - _chi_square(smeared.record, inked.noise) > _CLEARLY


def _chi_square(record: Array, noise: Array) -> float:
    """Of the edge's pixels, with limited outliers."""
    variance = noise[0] + (noise[1] - noise[0]) * record[:, SHARE]
    return float(np.sum(np.minimum(record[:, RESIDUAL] ** 2 / variance, _OUTLIER**2)))


def _first_state(fit: _Fit) -> FitState:
    scene = fit.scene
    parameters = np.zeros(PARAMETERS)
    parameters[VARIANCE] = max(fit.edges.blur_px, 0.1) ** 2
    noise = np.maximum(np.full(2, fit.edges.noise_dn**2), fit.floor)
    levels = np.zeros((2, min(SIZES[0], scene.basis.shape[1])))
    levels[:, 0] = fit.constants
    none = np.empty((0, RECORD))
    return FitState(
        scene.ellipse, scene.table, scene.jacobian, parameters, levels, fit.base, none, noise, none, fit.rows
    )


def _constants(scene: PixelScene, edges: EdgePoints) -> tuple[float, float]:
    """Levels inside and outside: medians of the plateaus; beside a clipped one, by the step of the edge points."""
    plateaus = scene.plateaus
    inside, outside = side_medians(scene.table, plateaus[0].value, plateaus[1].value)
    step = edges.contrast_dn
    if scene.clipped[1]:
        return inside, inside + step
    return (outside - step, outside) if scene.clipped[0] else (inside, outside)


def _chosen(fit: _Fit, state: FitState) -> FitState:
    """The state with as many level functions as the pixels show, and with a wider edge if they show one.

    A wider edge is a blur that differs between directions, or a soft edge of the ink.
    """
    # With such a wide blur the level functions resemble the edge itself, and a soft edge of the ink the blur.
    wide = state.parameters[VARIANCE] > (_WIDE_BLUR * float(fit.edges.ellipse[3])) ** 2
    more, extras = _BEYOND_STILL if fit.base is _STILL else _BEYOND_MOVING
    extras = extras[:-1] if wide else extras
    most = min(SIZES[0] if wide else SIZES[-1], fit.scene.basis.shape[1])
    sizes = np.array([s for s in SIZES if s <= most])
    normal, gradient = _equations(fit, state, np.array([*state.used, *more]), int(sizes[-1]))
    scale = robust_scale_of(state.record)
    which, size = model_choice(normal, gradient, len(state.used), extras, sizes, len(state.table), scale)
    added = more[extras[which] == 1]
    levels = np.zeros((2, size))
    kept = min(size, state.levels.shape[1])
    levels[:, :kept] = state.levels[:, :kept]
    return replace(state, used=np.array([*state.used, *added]), levels=levels)


def _equations(fit: _Fit, state: FitState, used: NDArray[np.int64], k: int) -> tuple[Array, Array]:
    """Normal matrix and gradient of a larger model, in which its new parameters and all level functions are zero."""
    scene, size = fit.scene, len(used) + 2 * k
    levels = np.zeros((2, k))
    kept = min(k, state.levels.shape[1])
    levels[:, :kept] = state.levels[:, :kept]
    normal, gradient, record = np.empty((size, size)), np.empty(size), np.empty((len(state.table), RECORD))
    pixel_equations(
        state.table, state.jacobian, scene.place, scene.basis, scene.basis_slope, scene.light, scene.clip_dn,
        state.rows, used, state.parameters, levels, state.noise,
        robust_scale_of(state.record), fit.discs, normal, gradient, record,
    )  # fmt: skip
    grams, moments, _, _ = sums_of(scene, levels)
    m = len(used)
    for i in range(2):
        part = slice(m + i * k, m + (i + 1) * k)
        normal[part, part] += grams[i] / state.noise[i]
        gradient[part] += (moments[i] - grams[i] @ levels[i]) / state.noise[i]
    add_priors(used, state.parameters, levels, fit.priors, fit.rates_information, normal, gradient)
    # The levels enter linearly: back to zero from the coefficients that the state has.
    at = np.concatenate([np.zeros(m), np.where(np.arange(k) > 0, levels, 0.0).ravel()])
    return normal, gradient + normal @ at


def _fitted(fit: _Fit, state: FitState) -> FitState | FailedFit:
    """Gauss-Newton from a state."""
    scene, levels = fit.scene, state.levels
    sums = sums_of(scene, levels)
    parameters, noise = state.parameters, state.noise.copy()
    ellipse, table, jacobian = state.ellipse, state.table, state.jacobian
    record, progress = np.empty((len(table), RECORD)), np.zeros(3)
    for _ in range(_MOVES):
        status, parameters, levels, inverse = gauss_newton(
            table, jacobian, scene.place, scene.basis, scene.basis_slope, scene.light, scene.clip_dn,
            state.rows,
            state.used, parameters, levels, *sums, fit.floor, fit.priors, fit.rates_information, noise, fit.discs,
            record, progress,
        )  # fmt: skip
        if status == CONVERGED:
            return FitState(
                ellipse, table, jacobian, parameters, levels, state.used, inverse, noise, record, state.rows
            )
        if status != MOVED:
            return FailedFit(_FAILURES[status])
        theta = shape_of_ellipse(ellipse) + parameters[:5]
        if not (theta[2] > 0 and theta[2] * theta[4] - theta[3] ** 2 > 0):
            return FailedFit("the pixels do not bound an ellipse")
        ellipse, table = ellipse_of_shape(theta), table.copy()
        placed = place_pixels(table, ellipse, scene.lens)
        if isinstance(placed, FailedFit):
            return placed
        jacobian, parameters = placed, parameters.copy()
        parameters[:5] = 0.0
    return FailedFit(_FAILURES[UNSETTLED])
