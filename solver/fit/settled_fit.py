"""One fit to the pixels of given sectors: what its model needs, and Gauss-Newton until it settles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.band_pixels import place_pixels
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.fit.ellipse import FailedFit, ellipse_of_shape, shape_of_ellipse
from roundel.solver.fit.pixel_covariance import FitState
from roundel.solver.fit.pixel_scene import SIZES, PixelScene, sums_of
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
class FitData:
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


def fit_data(
    scene: PixelScene,
    edges: EdgePoints,
    noise_floor: Callable[[float], float] | None,
    motion: RowMotion | None,
) -> FitData:
    """The data of a fit to a scene, with the priors of its parameters."""
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
    return FitData(scene, edges, rows, np.array(least), priors, base, rates, constants, np.zeros((STEPS + 1, 5)))


def settled(fit: FitData) -> FitState | FailedFit:
    """The converged fit, with what its model needs."""
    # The contour is known to a small part of its blur: the residuals at the start already tell what the model needs,
    # but for the shape of a wide blur.
    first = first_state(fit)
    chosen = _chosen(fit, first)
    state = fitted(fit, chosen)
    if fit.base is _STILL and chosen.used[-1] == INK and chosen.parameters[VARIANCE] < _WIDE_VARIANCE:
        smeared = fitted(fit, replace(chosen, used=_MOVING))
        if not isinstance(smeared, FailedFit) and _is_preferred(smeared, state):
            state = smeared
    if isinstance(state, FailedFit):
        return state
    return with_shape(fit, state)


def with_shape(fit: FitData, state: FitState) -> FitState:
    """The fit with what the shape of a wide blur shows."""
    if len(state.used) > len(fit.base) or state.parameters[VARIANCE] <= _WIDE_VARIANCE:
        return state
    chosen = _chosen(fit, state)
    if len(chosen.used) == len(fit.base) and state.parameters[DISC] > _RAMP:
        chosen = replace(chosen, used=np.array([*chosen.used, INK]))
    if len(chosen.used) == len(fit.base):
        return state
    again = fitted(fit, chosen)
    return state if isinstance(again, FailedFit) else again


def _is_preferred(smeared: FitState, inked: FitState | FailedFit) -> bool:
    """Whether the pixels show a smear rather than a soft edge of the ink: to first order a weak one looks like both."""
    if isinstance(inked, FailedFit):
        return True
    return chi_square(inked.record, inked.noise) - chi_square(smeared.record, inked.noise) > _CLEARLY


def chi_square(record: Array, noise: Array) -> float:
    """Of the edge's pixels, with limited outliers."""
    variance = noise[0] + (noise[1] - noise[0]) * record[:, SHARE]
    return float(np.sum(np.minimum(record[:, RESIDUAL] ** 2 / variance, _OUTLIER**2)))


def first_state(fit: FitData) -> FitState:
    """The state at the edge points of the contour, before any fit; without an inverse."""
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


def _chosen(fit: FitData, state: FitState) -> FitState:
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


def _equations(fit: FitData, state: FitState, used: NDArray[np.int64], k: int) -> tuple[Array, Array]:
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


def fitted(fit: FitData, state: FitState) -> FitState | FailedFit:
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
