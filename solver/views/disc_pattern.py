"""A print of discs under a homography, predicted and fitted at the pixels.

The print is a sum of discs with weights (+1 where ink begins, -1 where paper begins again inside it). Every pixel is

    I = b0 + b1 x + b2 y - (c0 + c1 x + c2 y) sum_j w_j D_j,

with the coverage D_j of disc j (`disc_coverage`). The levels b, c follow linearly; the homography's coordinates (see
`homography_pose`) and the variance of the blur by Gauss-Newton.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.views.disc_coverage import coverage_of
from roundel.solver.views.homography_pose import MeasuredHomography, moved

Array = NDArray[np.float64]

_LEAST_VARIANCE, _MOST_VARIANCE = 0.01, 100.0
_ROUNDS = 30
_SETTLED_PX, _ROUNDING = 3e-4, 1e-9
# A crown that is a twentieth of the radius too wide leaves 0.13 of the contrast, right fits 0.01 or less.
_LEFT, _NOISES = 0.06, 2.0


@dataclass(frozen=True, eq=False)
class Pixels:
    """Pixels of an image: undistorted positions (N, 2), grey levels (N,) linear in light."""

    places: Array
    values: Array


@dataclass(frozen=True, eq=False)
class PatternFit:
    """A print fitted to pixels.

    Attributes
    ----------
    homography : MeasuredHomography
    variance : float
        Of the blur, px^2, without the pixel's own.
    contrast_dn : float
        Paper minus ink at the centre.
    spread_dn : float
        The range that the pixels' levels span, without their outermost hundredths.
    explained : float
        Share of the pixels' variance that the print explains.
    noise_dn : float
        RMS of the residual.
    """

    homography: MeasuredHomography
    variance: float
    contrast_dn: float
    spread_dn: float
    explained: float
    noise_dn: float

    def describes(self, noise_dn: float) -> bool:
        """Whether the residual is that of a print of this kind: little of the levels' range, beside the image's noise.

        Of the range and not of the fitted contrast, which a wrong print under a large blur makes as large as it likes.
        """
        return self.noise_dn < _LEFT * self.spread_dn + _NOISES * noise_dn


def levels_columns(places: Array, pattern: Array) -> Array:
    """The six columns whose linear combination is the image of a pattern (N,): paper and ink, each with a slope."""
    middle = places - places.mean(axis=0)
    ground = np.column_stack([np.ones(len(middle)), middle / max(float(np.abs(middle).max()), 1e-9)])
    return np.concatenate([ground, -ground * pattern[:, None]], axis=1)


def _levels(columns: Array, values: Array) -> Array:
    """Least squares by the normal equations: the columns are centred and scaled, and there are six of them."""
    normal = columns.T @ columns
    return np.asarray(np.linalg.solve(normal + 1e-9 * np.trace(normal) * np.eye(len(normal)), columns.T @ values))


def unexplained(pixels: Pixels, patterns: Array) -> tuple[Array, Array]:
    """For each pattern (N, P): the share of variance that it leaves, and paper minus ink."""
    total = float(np.sum((pixels.values - pixels.values.mean()) ** 2))
    left, contrast = np.empty(patterns.shape[1]), np.empty(patterns.shape[1])
    for i, pattern in enumerate(patterns.T):
        columns = levels_columns(pixels.places, pattern)
        levels = _levels(columns, pixels.values)
        left[i] = float(np.sum((pixels.values - columns @ levels) ** 2))
        contrast[i] = levels[3]
    return left / max(total, 1e-12), contrast


def fit_pattern(
    pixels: Pixels, matrix: Array, discs: Array, weights: Array, variance: float, turns: bool
) -> PatternFit | None:
    """Fit the homography, the blur and the levels of a print to pixels.

    Parameters
    ----------
    pixels : Pixels
    matrix : (3, 3) array
        Start.
    discs : (J, 3) array
    weights : (J,) array
    variance : float
        Start.
    turns : bool
        Whether the print shows its rotation in the plane.

    Returns
    -------
    PatternFit or None
        None if it does not settle. The covariance is that of independent residuals of whatever variance each has
        (White 1980), as noise differs between ink and paper.
    """
    count = 8 if turns else 7
    previous = np.inf
    damping = 1e-6
    state: tuple[Array, float] = (matrix, variance)
    trial = state
    for _ in range(_ROUNDS):
        made = _equations(pixels, *trial, discs, weights, count)
        if made is None:
            return None
        columns, residual, levels = made
        cost = float(residual @ residual)
        if cost <= previous * (1 + _ROUNDING):
            state, kept, previous, damping = trial, made, cost, max(damping / 5, 1e-9)
        else:
            damping *= 8
            if damping > 1e3:
                break
        columns, residual, levels = kept
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
        scaled = columns / size
        step = _step(scaled, residual, damping) / size
        if step[count] < 0 and state[1] <= _LEAST_VARIANCE:
            # No blur at all: the others' best step is that without it.
            others = np.delete(np.arange(len(size)), count)
            step[others], step[count] = _step(scaled[:, others], residual, damping) / size[others], 0.0
        delta = step[:count]
        change = float(np.clip(step[count], -0.8 * state[1], 0.5 + state[1]))
        trial = moved(state[0], delta), float(np.clip(state[1] + change, _LEAST_VARIANCE, _MOST_VARIANCE))
        trial = trial[0] / trial[0][2, 2], trial[1]
        radius = float(np.sqrt(abs(np.linalg.det(state[0][:2, :2]))))
        if np.abs(delta).max() * radius < _SETTLED_PX and made is kept:
            break
    columns, residual, levels = kept
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    scaled = columns / size
    try:
        inverse = np.linalg.inv(scaled.T @ scaled)
    except np.linalg.LinAlgError:
        return None
    spread = (scaled * residual[:, None]).T @ (scaled * residual[:, None])
    free = len(residual) - columns.shape[1]
    cov = (inverse @ spread @ inverse / np.outer(size, size))[:count, :count] * len(residual) / max(free, 1)
    total = float(np.sum((pixels.values - pixels.values.mean()) ** 2))
    rms = math.sqrt(previous / max(free, 1))
    explained = 1.0 - previous / max(total, 1e-12)
    low, high = np.percentile(pixels.values, (1, 99))
    homography = MeasuredHomography(state[0], cov)
    return PatternFit(homography, state[1], float(levels[3]), float(high - low), explained, rms)


def _step(columns: Array, residual: Array, damping: float) -> Array:
    normal = columns.T @ columns
    return np.asarray(np.linalg.solve(normal + damping * np.eye(len(normal)), columns.T @ residual))


def _equations(
    pixels: Pixels, matrix: Array, variance: float, discs: Array, weights: Array, count: int
) -> tuple[Array, Array, Array] | None:
    """Columns by every parameter (homography, blur, levels), residual and levels at a state."""
    seen = coverage_of(pixels.places, matrix, discs, variance)
    if not np.all(np.isfinite(seen.covered)):
        return None
    ground = levels_columns(pixels.places, seen.covered @ weights)
    levels = _levels(ground, pixels.values)
    contrast = -(ground[:, :3] @ levels[3:])
    moves = np.einsum("njg,j->ng", seen.by_generator[..., :count], weights) * contrast[:, None]
    blur = (seen.by_variance @ weights) * contrast
    return np.column_stack([moves, blur, ground]), pixels.values - ground @ levels, levels
