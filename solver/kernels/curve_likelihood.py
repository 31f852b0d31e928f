"""Chi-square of an edge's pixels if light has passed a given response curve: the inner loop of `curve_evidence`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import (
    CURVATURE,
    CURVATURE_SS,
    DISTANCE,
    HALF_DIFFERENCE,
    HALF_SUM,
    NORMAL_X,
    NORMAL_Y,
    U_X,
    U_Y,
    VALUE,
)
from roundel.solver.kernels.edge_response import curved_distance, step_response
from roundel.solver.kernels.small_matrices import add_products, inverse_of

Array = NDArray[np.float64]

LINEAR_KIND, SRGB_KIND, GAMMA_KIND = range(3)
# Shape (x, y, S11, S12, S22), log of the variance of the blur, excess of its fourth moment, light inside and outside:
# constant, and slopes along x and y.
UNKNOWNS = 13

_PIXEL_VARIANCE = 1.0 / 12.0
_OUTLIER = 6.0  # sigmas beyond which a pixel counts no more
_FOURTH_SIGMA = 0.05  # a disc of confusion has 1/24, a Gaussian 0
_DARKEST = 1e-5  # light below which a power's slope is not computed
_STEPS = 20
_BLOCK = 64  # pixels
_SETTLED = 0.1  # of chi-square; differences of 16 decide
_LARGEST_LOG = 0.7


@compiled
def encode(light: float, kind: int, gamma: float) -> tuple[float, float]:
    """Level of a light, and its derivative."""
    if kind == LINEAR_KIND:
        return light, 1.0
    if kind == SRGB_KIND:  # IEC 61966-2-1
        if light <= 0.0031308:
            return 12.92 * light, 12.92
        level = 1.055 * light ** (1.0 / 2.4) - 0.055
        return level, (level + 0.055) / (2.4 * light)
    if light <= _DARKEST:
        slope = _DARKEST ** (1.0 / gamma - 1.0)
        return light * slope, slope
    power = light ** (1.0 / gamma)
    return power, power / (gamma * light)


@compiled
def outer_shares(table: Array, variance: float) -> Array:
    """Share of the outer level in each pixel (N,) of a table, see `contour_pixels`, for a straight edge."""
    out = np.empty(len(table))
    for i in range(len(table)):
        out[i] = step_response(table[i, DISTANCE], table[i, HALF_SUM], table[i, HALF_DIFFERENCE], variance)[0]
    return out


@compiled
def _accumulate(
    table: Array,
    weight: Array,
    place: Array,
    unknown: Array,
    kind: int,
    gamma: float,
    normal: Array,
    pull: Array,
    squares: Array,
) -> float:
    """Chi-square; the normal matrix (13, 13), the gradient (13,) and the pixels' squares (N,) are written."""
    # The derivatives of a block of pixels, and their residuals, stay in the fastest cache.
    design, weights, sums = np.empty((UNKNOWNS + 1, _BLOCK)), np.empty(_BLOCK), np.zeros((UNKNOWNS + 1, UNKNOWNS + 1))
    variance = math.exp(unknown[5])
    total_sigma = math.sqrt(variance + _PIXEL_VARIANCE)
    chi2 = 0.0
    row = np.empty(UNKNOWNS)
    for i in range(len(table)):
        pixel = table[i]
        nx, ny, ux, uy = pixel[NORMAL_X], pixel[NORMAL_Y], pixel[U_X], pixel[U_Y]
        row[0], row[1], row[2], row[3], row[4] = -nx, -ny, -nx * ux, -nx * uy - ny * ux, -ny * uy
        distance = pixel[DISTANCE]
        for j in range(5):
            distance += row[j] * unknown[j]
        z, _ = curved_distance(distance, pixel[CURVATURE], pixel[CURVATURE_SS], variance + _PIXEL_VARIANCE)
        share, slope, bend = step_response(z, pixel[HALF_SUM], pixel[HALF_DIFFERENCE], variance)
        u = z / total_sigma
        fourth = (u * u * u - 3.0 * u) * math.exp(-0.5 * u * u) if abs(u) < 8.0 else 0.0
        share += unknown[6] * fourth
        x, y = place[i, 0], place[i, 1]
        inside = unknown[7] + unknown[8] * x + unknown[9] * y
        height = unknown[10] + unknown[11] * x + unknown[12] * y - inside
        level, gain = encode(inside + height * share, kind, gamma)
        for j in range(5):
            row[j] *= height * slope * gain
        row[5] = height * gain * bend / 2.0 * variance
        row[6] = height * gain * fourth
        row[7] = gain * (1.0 - share)
        row[8], row[9] = row[7] * x, row[7] * y
        row[10] = gain * share
        row[11], row[12] = row[10] * x, row[10] * y
        residual = pixel[VALUE] - level
        square = weight[i] * residual * residual
        w = weight[i]
        if square > _OUTLIER**2:
            square, w = _OUTLIER**2, w * _OUTLIER**2 / square
        chi2 += square
        squares[i] = square
        at = i % _BLOCK
        for j in range(UNKNOWNS):
            design[j, at] = row[j]
        design[UNKNOWNS, at], weights[at] = residual, w
        if at == _BLOCK - 1 or i == len(table) - 1:
            add_products(design, weights, at + 1, sums)
    for j in range(UNKNOWNS):
        pull[j] = sums[UNKNOWNS, j]
        for k in range(j + 1):
            normal[j, k] = normal[k, j] = sums[j, k]
    normal[6, 6] += 1.0 / _FOURTH_SIGMA**2
    pull[6] -= unknown[6] / _FOURTH_SIGMA**2
    return float(chi2 + (unknown[6] / _FOURTH_SIGMA) ** 2)


@compiled
def curve_likelihood(
    table: Array, weight: Array, place: Array, start: Array, kind: int, gamma: float
) -> tuple[float, Array, Array]:
    """Least chi-square of the pixels of an edge for a curve, by Levenberg and Marquardt.

    Parameters
    ----------
    table : (N, 12) array
        See `contour_pixels`; levels as fractions of the range.
    weight : (N,) array
        Inverse variances of the levels.
    place : (N, 2) array
        Positions relative to the centre, in semi-major axes.
    start : (13,) array
        See `UNKNOWNS`.
    kind : int
        `LINEAR_KIND`, `SRGB_KIND` or `GAMMA_KIND`.
    gamma : float
        Exponent of the latter.

    Returns
    -------
    chi2 : float
        Infinite if the pixels do not determine the unknowns.
    unknown : (13,) array
    squares : (N,) array
        What each pixel adds to chi-square.
    """
    unknown, trial = start.copy(), start.copy()
    normal, other, damped = (
        np.empty((UNKNOWNS, UNKNOWNS)),
        np.empty((UNKNOWNS, UNKNOWNS)),
        np.empty((UNKNOWNS, UNKNOWNS)),
    )
    inverse, pull, other_pull = np.empty((UNKNOWNS, UNKNOWNS)), np.empty(UNKNOWNS), np.empty(UNKNOWNS)
    squares, other_squares = np.zeros(len(table)), np.zeros(len(table))
    damping = 1e-3
    chi2 = _accumulate(table, weight, place, unknown, kind, gamma, normal, pull, squares)
    for _ in range(_STEPS):
        for j in range(UNKNOWNS):
            for k in range(UNKNOWNS):
                damped[j, k] = normal[j, k]
            damped[j, j] *= 1.0 + damping
        if not inverse_of(damped, inverse):
            return math.inf, unknown, squares
        for j in range(UNKNOWNS):
            step = 0.0
            for k in range(UNKNOWNS):
                step += inverse[j, k] * pull[k]
            if j == 5:
                step = min(max(step, -_LARGEST_LOG), _LARGEST_LOG)
            trial[j] = unknown[j] + step
        trial[5] = min(max(trial[5], -8.0), 8.0)
        after = _accumulate(table, weight, place, trial, kind, gamma, other, other_pull, other_squares)
        if after < chi2:
            gained = chi2 - after
            chi2, damping = after, max(damping / 10.0, 1e-9)
            normal, other, pull, other_pull = other, normal, other_pull, pull
            unknown, trial, squares, other_squares = trial, unknown, other_squares, squares
            if gained < _SETTLED:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return chi2, unknown, squares
