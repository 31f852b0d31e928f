"""Gauss-Newton for the ellipse, blur and grey levels of a contour, until the distances have to be computed again."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import CURVATURE, X, Y
from roundel.solver.kernels.contour_scene import plateau_squares
from roundel.solver.kernels.pixel_equations import (
    CLIPPED,
    DISC,
    DISC_VARIANCE,
    GRADIENT,
    INK,
    RATES,
    RESIDUAL,
    SHARE,
    SLOPE,
    SMEAR,
    VARIANCE,
    WEIGHT,
    pixel_equations,
)
from roundel.solver.kernels.sector_offsets import MIN_VARIANCE
from roundel.solver.kernels.small_matrices import inverse_of

Array = NDArray[np.float64]

CONVERGED, MOVED, UNDETERMINED, DIVERGED, UNSETTLED = range(5)

MAX_STEPS = 20
_SETTLED_PX, _SETTLED = 5e-4, 1e-3  # a last step of 5e-4 px, or of 3 % of its standard deviation
_CLOSE_PX, _CLOSE = 0.02, 1.0  # within such a step the residuals are those of the noise
_NEAR_PX = 0.1  # beyond, residuals are large, and a step is small against them whatever it does
# Distances are linear in the ellipse's step up to an error of (this)^2 / 2 rho: of the result, and on the way to it.
_RELINEARISE_PX, _ROUGHLY_PX = 0.04, 0.2
_TRUST_PX = 2.0  # largest step: beyond it the linear model is invalid
_NEARLY_FLAT = 0.1  # fraction of the step
_SAME_NOISE = 0.05  # relative change of a variance; chance is as large
# Share of a disc in the blur, from Gaussian (0) to circle of confusion (1); motion blur and soft ink's ramp are beyond.
_DISC_SIGMA, _DISC_LOWEST, _DISC_HIGHEST = 1.0, -1.0, 1.7
# A tilted plane is more defocused on one side: the radius changes linearly across it, usually by a few per cent. The
# radius at the edge, not at the pixel, decides on which side of the edge a ray meets the print.
_GRADIENT = 0.15
_SMEAR = 2.0


@compiled
def noise_variances(
    grams: Array,
    moments: Array,
    squares: Array,
    counts: Array,
    levels: Array,
    record: Array,
    floor: Array,
    noise: Array,
) -> None:
    """Write the variances of the pixels inside and outside, dn^2, from the model's residuals in the flat parts.

    Shot noise makes the brighter side noisier. If both sides have too few pixels, they share one variance.

    Parameters
    ----------
    grams, moments, squares, counts : (2, K, K), (2, K), (2,), (2,) arrays
        Sums over the pixels of both plateaus.
    levels : (2, k) array
    record : (N, 5) array
        See `pixel_equations`; the nearly flat pixels of the edge are included.
    floor : (2,) array
        Least variance on each side: rounding.
    noise : (2,) array
        Written.
    """
    k = levels.shape[1]
    unknowns = 2 * k
    total, number, edge, pixels = np.zeros(2), np.zeros(2), 0.0, 0
    for i in range(2):
        total[i] = plateau_squares(grams[i, :k, :k], moments[i, :k], squares[i], levels[i])
        number[i] = counts[i]
    both, every = total[0] + total[1], number[0] + number[1]
    for i in range(len(record)):
        if record[i, WEIGHT] == 0.0 or record[i, CLIPPED] == 1.0:
            continue
        square = record[i, RESIDUAL] ** 2
        edge, pixels = edge + square, pixels + 1
        side = 0 if record[i, SHARE] < _NEARLY_FLAT else 1 if record[i, SHARE] > 1.0 - _NEARLY_FLAT else -1
        if side >= 0:
            total[side] += square
            number[side] += 1
    fewest = 12 + unknowns
    if min(number[0], number[1]) >= fewest:
        noise[0], noise[1] = total[0] / (number[0] - k), total[1] / (number[1] - k)
    elif max(number[0], number[1]) >= fewest:
        # The other side is clipped, or out of sight: its noise is extrapolated from that of the shades between.
        known = 0 if number[0] >= fewest else 1
        noise[known] = total[known] / (number[known] - k)
        shares, excess = 0.0, 0.0
        for i in range(len(record)):
            if record[i, WEIGHT] > 0.0 and record[i, CLIPPED] == 0.0:
                share = record[i, SHARE] if known == 0 else 1.0 - record[i, SHARE]
                shares += share * share
                excess += share * (record[i, RESIDUAL] ** 2 - noise[known])
        noise[1 - known] = max(noise[known] + excess / max(shares, 1.0), noise[known] / 4.0)
    else:
        noise[0] = noise[1] = (both + edge) / max(every + pixels - unknowns - 6, 1.0)
    # A plateau without noise (clipped or synthetic) gets its rounding's, and at most 64 times the other's weight.
    noise[0], noise[1] = max(noise[0], floor[0]), max(noise[1], floor[1])
    noise[0], noise[1] = max(noise[0], noise[1] / 64.0), max(noise[1], noise[0] / 64.0)


@compiled
def robust_scale_of(record: Array) -> float:
    """Median of the edge's residuals over their sigmas, as a standard deviation; at least 1."""
    bins, width = 600, 0.02
    steepest = 0.0
    for i in range(len(record)):
        steepest = max(steepest, abs(record[i, SLOPE]))
    counts, total = np.zeros(bins + 1), 0
    for i in range(len(record)):
        if abs(record[i, SLOPE]) > 0.2 * steepest and record[i, WEIGHT] > 0.0 and record[i, CLIPPED] == 0.0:
            ratio = abs(record[i, RESIDUAL]) * math.sqrt(record[i, WEIGHT])
            counts[min(int(ratio / width), bins)] += 1
            total += 1
    below, at = 0, 0
    while at < bins and below + counts[at] < total / 2.0:
        below += counts[at]
        at += 1
    inside = (total / 2.0 - below) / counts[at] if counts[at] > 0 else 0.5
    return max(1.0, 1.4826 * (at + inside) * width)


@compiled
def add_priors(
    used: NDArray[np.int64],
    parameters: Array,
    levels: Array,
    priors: Array,
    rates_information: Array,
    normal: Array,
    gradient: Array,
) -> None:
    """Add the prior knowledge of the parameters to the normal equations.

    All have mean zero. `priors` (2,) has the standard deviation of the ink's soft edge, px^2, and that of the level
    functions (but for the constants), dn; `rates_information` (5, 5) is the inverse covariance of the rates.
    """
    width = max(parameters[VARIANCE], DISC_VARIANCE)
    for j in range(len(used)):
        p = used[j]
        sigma = math.inf
        if p == DISC:  # if the blur is small, the pixels do not determine its shape: it is then a Gaussian
            sigma = _DISC_SIGMA
        elif GRADIENT <= p < SMEAR:
            sigma = _GRADIENT * width
        elif SMEAR <= p < INK:
            sigma = _SMEAR * width
        elif p == INK:
            sigma = priors[0]
        if sigma < math.inf:
            normal[j, j] += 1.0 / sigma**2
            gradient[j] -= parameters[p] / sigma**2
        if p >= RATES:
            for i in range(len(used)):
                if used[i] >= RATES:
                    information = rates_information[p - RATES, used[i] - RATES]
                    normal[j, i] += information
                    gradient[j] -= information * parameters[used[i]]
    k = levels.shape[1]
    for i in range(2):
        for j in range(1, k):
            at = len(used) + i * k + j
            normal[at, at] += 1.0 / priors[1] ** 2
            gradient[at] -= levels[i, j] / priors[1] ** 2


@compiled
def _steepest(parameters: Array) -> float:
    """Largest change of the variance from the centre of the marker to its contour: half that of lens and ink."""
    return float((parameters[VARIANCE] + max(parameters[INK], 0.0)) / 2.0)


@compiled
def moved(parameters: Array, levels: Array, used: NDArray[np.int64], step: Array, part: float) -> tuple[Array, Array]:
    """Parameters and levels after a part of a step, with the blur kept within bounds."""
    out, after = parameters.copy(), levels.copy()
    m, k = len(used), levels.shape[1]
    for j in range(m):
        out[used[j]] += part * step[j]
    for j in range(k):
        after[0, j] += part * step[m + j]
        after[1, j] += part * step[m + k + j]
    variance = parameters[VARIANCE]
    variance = min(max(out[VARIANCE], variance / 4.0, MIN_VARIANCE), variance * 4.0)
    out[VARIANCE] = variance
    out[DISC] = min(max(out[DISC], _DISC_LOWEST), _DISC_HIGHEST)
    for j in range(GRADIENT, SMEAR):
        most = _steepest(out)
        out[j] = min(max(out[j], -most), most)
    smear = math.hypot(out[SMEAR], out[SMEAR + 1])
    if smear > variance:
        out[SMEAR], out[SMEAR + 1] = out[SMEAR] * variance / smear, out[SMEAR + 1] * variance / smear
    out[INK] = max(out[INK], -variance / 2.0)
    return out, after


@compiled
def _allowed(parameter: int, parameters: Array, step: float, inked: bool) -> float:
    """The part of a step of a parameter that stays within its bounds, see `moved`."""
    value = parameters[parameter]
    if parameter == VARIANCE and inked:  # the ink is all of the blur
        return 0.0 if step < 0.0 and value <= MIN_VARIANCE else step
    if parameter == DISC:
        return float(min(max(step, _DISC_LOWEST - value), _DISC_HIGHEST - value))
    if GRADIENT <= parameter < SMEAR:
        most = _steepest(parameters)
        return float(min(max(step, -most - value), most - value))
    return step


@compiled
def largest_shift(table: Array, jacobian: Array, rows: Array, step: Array, rates: Array) -> float:
    """Largest change of a distance by a step of the shape and of the rates of S, px."""
    largest = 0.0
    for i in range(len(jacobian)):
        seconds = (table[i, X if rows[2] > 0.0 else Y] - rows[1]) * rows[0]
        shift = 0.0
        for j in range(5):
            shift += jacobian[i, j] * (step[j] + (rates[j] * seconds if j >= 2 else 0.0))
        largest = max(largest, abs(shift))
    return largest


@compiled
def newton_step(normal: Array, gradient: Array, inverse: Array, step: Array) -> float:
    """Write the inverse of a normal matrix and the step; returns the squared step in its own standard deviations.

    Not finite if the matrix is singular.
    """
    if not inverse_of(normal, inverse):
        for a in range(len(step)):
            step[a] = 0.0
        return math.nan
    decrement = 0.0
    for a in range(len(step)):
        step[a] = 0.0
        for b in range(len(step)):
            step[a] += inverse[a, b] * gradient[b]
        decrement += step[a] * gradient[a]
    return decrement


@compiled
def gauss_newton(
    table: Array,
    jacobian: Array,
    place: Array,
    basis: Array,
    basis_slope: Array,
    light: Array,
    clip_dn: float,
    rows: Array,
    used: NDArray[np.int64],
    parameters: Array,
    levels: Array,
    grams: Array,
    moments: Array,
    squares: Array,
    counts: Array,
    floor: Array,
    priors: Array,
    rates_information: Array,
    noise: Array,
    discs: Array,
    record: Array,
    progress: Array,
) -> tuple[int, Array, Array, Array]:
    """Iterate from a state; the arguments are those of `pixel_equations` and `noise_variances`.

    `progress` is (steps done, how the noise was measured, robust scale): it carries over to the next call if the
    ellipse has moved so far that the distances have to be computed again. The noise is not measured (0), measured where
    the fit is close (1), or where it settles (2).

    Returns
    -------
    status : int
        CONVERGED, MOVED (compute the distances again), UNDETERMINED, DIVERGED or UNSETTLED.
    parameters, levels, inverse : (17,), (2, k), (m + 2 k, m + 2 k) arrays
        The last is the inverse of the normal matrix.
    """
    m, k = len(used), levels.shape[1]
    size = m + 2 * k
    normal, inverse, gradient, step = np.empty((size, size)), np.empty((size, size)), np.empty(size), np.empty(size)
    turned = np.zeros(5)
    frozen, held, inked = np.empty((size, size)), np.empty(m, np.bool_), False
    for j in range(m):
        inked = inked or used[j] == INK
    while progress[0] < MAX_STEPS:
        progress[0] += 1
        pixel_equations(
            table, jacobian, place, basis, basis_slope, light, clip_dn, rows, used, parameters, levels, noise,
            progress[2], discs, normal, gradient, record,
        )  # fmt: skip
        progress[2] = robust_scale_of(record)
        add_priors(used, parameters, levels, priors, rates_information, normal, gradient)
        for i in range(2):
            for a in range(k):
                at = m + i * k + a
                gradient[at] += moments[i, a] / noise[i]
                for b in range(k):
                    normal[at, m + i * k + b] += grams[i, a, b] / noise[i]
                    gradient[at] -= grams[i, a, b] * levels[i, b] / noise[i]
        decrement = newton_step(normal, gradient, inverse, step)
        # Parameters that would leave their bounds end there, and the others take the step that suits this.
        ended = False
        for j in range(m):
            part = _allowed(used[j], parameters, step[j], inked)
            held[j] = part != step[j]
            ended = ended or held[j]
            step[j] = part
        if ended:
            for a in range(size):
                for b in range(size):
                    out = b < m and held[b]
                    if out:
                        gradient[a] -= normal[a, b] * step[b]
                    frozen[a, b] = 0.0 if out or (a < m and held[a]) else normal[a, b]
            for j in range(m):
                if held[j]:
                    frozen[j, j], gradient[j] = 1.0, step[j]
            decrement = newton_step(frozen, gradient, inverse, step)
        if not math.isfinite(decrement):
            return UNDETERMINED, parameters, levels, inverse
        for j in range(5):
            turned[j] = 0.0
        for j in range(m):
            if used[j] >= RATES:
                turned[used[j] - RATES] = step[j]
        moved_px = largest_shift(table, jacobian, rows, step[:5], turned)
        # The blur converges last: its step is measured by the shift of the edge's flanks, and limited to a third.
        flank_px = math.sqrt(parameters[VARIANCE] + PIXEL_VARIANCE)
        wanted, wanted_levels = moved(parameters, levels, used, step, 1.0)
        blurred_px = (
            max(abs(wanted[SMEAR] - parameters[SMEAR]), abs(wanted[SMEAR + 1] - parameters[SMEAR + 1])) / (4 * flank_px)
            + abs(wanted[VARIANCE] - parameters[VARIANCE] + wanted[INK] - parameters[INK]) / (2 * flank_px)
            + abs(wanted[VARIANCE] - parameters[VARIANCE]) * abs(table[0, CURVATURE])
            + abs(wanted[DISC] - parameters[DISC]) * flank_px / 20
        )
        part = min(1.0, 0.5 / max(moved_px, 1e-12), flank_px / max(3 * blurred_px, 1e-12))
        if part == 1.0:
            parameters, levels = wanted, wanted_levels
        else:
            parameters, levels = moved(parameters, levels, used, step, part)
        if not largest_shift(table, jacobian, rows, parameters[:5], parameters[RATES:]) < _TRUST_PX:
            return DIVERGED, parameters, levels, inverse
        # A change of the levels, as the shift of the edge that would change its pixels as much.
        height = max(abs(levels[1, 0] - levels[0, 0]), 1e-12)
        lifted_px = max(abs(step[m]), abs(step[m + k])) / height * 2.5 * flank_px
        tilt = 0.0
        for j in range(m, size):
            tilt = max(tilt, abs(step[j]))
        tilted_px = tilt / height * 2.5 * flank_px
        largest = max(moved_px, blurred_px, lifted_px)
        # The step in units of its own standard deviation, where the noise is what the residuals show.
        decrement /= progress[2] * progress[2]
        close = largest < _CLOSE_PX or (decrement < _CLOSE and largest < _NEAR_PX)
        if close and progress[1] == 0.0 and tilted_px < _NEAR_PX:
            noise_variances(grams, moments, squares, counts, levels, record, floor, noise)
            progress[1] = 1.0
        elif progress[1] > 0.0 and (largest < _SETTLED_PX or (decrement < _SETTLED and close)):
            if progress[1] == 1.0:
                # On a steep edge, or in the middle of a reflection, what is left of a step may be more than the noise.
                inside, outside = noise[0], noise[1]
                noise_variances(grams, moments, squares, counts, levels, record, floor, noise)
                progress[1] = 2.0
                if max(abs(noise[0] / inside - 1.0), abs(noise[1] / outside - 1.0)) > _SAME_NOISE:
                    continue
                noise[0], noise[1] = inside, outside
            if ended:
                inverse_of(normal, inverse)
            return CONVERGED, parameters, levels, inverse
        for j in range(5):  # what the rates move stays linear
            turned[j] = 0.0
        shifted = largest_shift(table, jacobian, rows, parameters[:5], turned)
        if shifted > (_RELINEARISE_PX if close else _ROUGHLY_PX):
            return MOVED, parameters, levels, inverse
    return UNSETTLED, parameters, levels, inverse
