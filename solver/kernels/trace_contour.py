"""From an approximate ellipse to the contour in the image: sectors of pixels, offsets, a better ellipse, again."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import (
    DISTANCE,
    NORMAL_X,
    NORMAL_Y,
    U_X,
    U_Y,
    arc_lengths,
    contour_pixels,
    contour_profile,
    sector_centres,
)
from roundel.solver.kernels.order_statistics import median
from roundel.solver.kernels.sector_offsets import SECTOR_PX, sector_offsets
from roundel.solver.kernels.small_matrices import inverse_of

Array = NDArray[np.float64]

MIN_SECTORS = 12
PLATEAU_PX = 1.5  # width of the flat parts beside the edge that determine the grey levels
_FIRST_REACH_PX = 8.0  # search distance from a candidate for its edge and its plateaus
_MAX_ROUNDS = 6
_SETTLED_PX = 0.005  # the error after an iteration is about a thirtieth of its step
_CLOSE_PX, _CLOSE = 1.0, 0.07  # limits of a small step: in px, and as a fraction of the semi-minor axis
_PROFILE_STEP_PX = 0.5

# Why there is no contour; the first is none.
FAILURES = (
    "",
    "the contour is outside the image",
    "the contour is too small to have an interior",
    "no edge along the contour",
    "no edge with flat sides along the contour",
    "too few sectors of the contour show an edge",
    "the edge along the contour is not an ellipse",
    "the contour shrinks below one pixel",
)
OK, OUTSIDE, NO_INTERIOR, NO_EDGE, NOT_FLAT, FEW_SECTORS, NO_ELLIPSE, SHRINKS = range(8)


@compiled
def reach_of(number: NDArray[np.int64], total: Array, low: float) -> tuple[int, float, float]:
    """How far the edge and a little plateau extend inward and outward, from the mean profile along the normal.

    It ends where the profile reverses, because another edge begins there (the inner circle of a ring, a nearby border).

    Parameters
    ----------
    number, total : (bins,) arrays
        See `contour_profile`.
    low : float
        Where its first bin begins, px.

    Returns
    -------
    failure : int
    inner, outer : float
    """
    first, end, pixels = -1, 0, 0
    for k in range(len(number)):
        pixels += number[k]
        if number[k] > 0:
            first, end = k if first < 0 else first, k + 1
    if pixels < 4 * MIN_SECTORS:
        return OUTSIDE, 0.0, 0.0
    low, bins = low + first * _PROFILE_STEP_PX, end - first
    number, profile = number[first:end], total[first:end].copy()
    last = -1  # empty bins are interpolated; the first and the last bin are never empty
    for k in range(bins):
        if number[k] > 0:
            profile[k] /= number[k]
            for j in range(last + 1, k):
                profile[j] = profile[last] + (profile[k] - profile[last]) * (j - last) / (k - last)
            last = k
    smooth = np.empty(bins)
    for k in range(bins):
        smooth[k] = (profile[max(k - 1, 0)] + 2.0 * profile[k] + profile[min(k + 1, bins - 1)]) / 4.0
    # Bin k of the slope lies between bins k and k + 1.
    polarity, any_close = 0.0, False
    for k in range(bins - 1):
        if abs(low + (k + 1) * _PROFILE_STEP_PX) <= 2.5:
            any_close = True
            polarity += smooth[k + 1] - smooth[k]
    if not any_close:
        return NO_INTERIOR, 0.0, 0.0
    sign = 1.0 if polarity >= 0.0 else -1.0
    rise = np.empty(bins - 1)
    top = -1
    for k in range(bins - 1):
        rise[k] = sign * (smooth[k + 1] - smooth[k])
        if abs(low + (k + 1) * _PROFILE_STEP_PX) <= 2.5 and (top < 0 or rise[k] > rise[top]):
            top = k
    if not rise[top] > 0.0:
        return NO_EDGE, 0.0, 0.0
    ends = np.empty(2)
    for side in range(2):
        direction = 2 * side - 1
        i = top
        while 0 <= i + direction < bins - 1 and rise[i + direction] > 0.05 * rise[top]:
            i += direction
        edge = i
        while (
            0 <= i + direction < bins - 1
            and abs(i - edge) * _PROFILE_STEP_PX < PLATEAU_PX
            and rise[i + direction] > -0.05 * rise[top]
        ):
            i += direction
        ends[side] = low + (i + 1) * _PROFILE_STEP_PX
    return OK, ends[0], ends[1]


@compiled
def shape_row(nx: float, ny: float, ux: float, uy: float, row: Array) -> None:
    """Derivative of a signed distance by x, y, S11, S12, S22 of the ellipse."""
    row[0], row[1], row[2], row[3], row[4] = -nx, -ny, -nx * ux, -nx * uy - ny * ux, -ny * uy


@compiled
def _shape_step(jacobian: Array, delta: Array, sigma: Array, good: NDArray[np.bool_], b_px: float, step: Array) -> int:
    """First-order step of the shape that explains the offsets; sectors off the ellipse are no longer good.

    `b_px` is the semi-minor axis that scales the allowed residual; a contour that is not an ellipse fails here.
    """
    count = len(delta)
    normal, inverse, gradient = np.empty((5, 5)), np.empty((5, 5)), np.empty(5)
    for again in range(2):
        number = 0
        for j in range(5):
            gradient[j] = 0.0
            for k in range(5):
                normal[j, k] = 0.0
        for s in range(count):
            if not good[s]:
                continue
            number += 1
            weight = 1.0 / sigma[s] ** 2
            for j in range(5):
                gradient[j] -= weight * jacobian[s, j] * delta[s]
                for k in range(5):
                    normal[j, k] += weight * jacobian[s, j] * jacobian[s, k]
        if number < max(8.0, 0.3 * count):
            return FEW_SECTORS
        if not inverse_of(normal, inverse):
            return NO_ELLIPSE
        for j in range(5):
            step[j] = 0.0
            for k in range(5):
                step[j] += inverse[j, k] * gradient[k]
        residual, widths, i = np.empty(count), np.empty(number), 0
        left = np.empty(number)
        for s in range(count):
            residual[s] = delta[s]
            for j in range(5):
                residual[s] += jacobian[s, j] * step[j]
            residual[s] = abs(residual[s])
            if good[s]:
                left[i], widths[i] = residual[s], sigma[s]
                i += 1
        middle = median(left)
        limit = max(4.0 * 1.4826 * middle, 0.05)
        outside = 0
        for s in range(count):
            outside += good[s] and residual[s] > limit
        if again == 1 or outside == 0 or number - outside < 8:
            break
        # Points of a neighbour, a shadow or a stain are off the ellipse.
        for s in range(count):
            good[s] = good[s] and residual[s] <= limit
    if middle > 0.1 + 0.03 * b_px + 2.0 * median(widths):
        return NO_ELLIPSE
    return OK


@compiled
def moved_ellipse(ellipse: Array, step: Array) -> tuple[bool, Array]:
    """The ellipse (5,) after a step of (x, y, S11, S12, S22); False if it is none, or smaller than a pixel."""
    half, mean = (ellipse[2] - ellipse[3]) / 2.0, (ellipse[2] + ellipse[3]) / 2.0
    turn = math.radians(2.0 * ellipse[4])
    s11, s12, s22 = mean + half * math.cos(turn), half * math.sin(turn), mean - half * math.cos(turn)
    s11, s12, s22 = s11 + step[2], s12 + step[3], s22 + step[4]
    mean, half = (s11 + s22) / 2.0, math.hypot((s11 - s22) / 2.0, s12)
    angle = math.degrees(math.atan2(s12, (s11 - s22) / 2.0)) / 2.0
    out = np.empty(5)
    out[0], out[1], out[2], out[3] = ellipse[0] + step[0], ellipse[1] + step[1], mean + half, mean - half
    out[4] = angle % 180.0
    if out[4] >= 180.0:
        out[4] = 0.0
    return bool(mean - half > 1.0 and mean + half < 1e6 and math.isfinite(out[0] + out[1])), out


@compiled
def _largest_move(jacobian: Array, step: Array) -> float:
    """Largest displacement of a sector by a step of the shape, px."""
    largest = 0.0
    for s in range(len(jacobian)):
        moved = 0.0
        for j in range(5):
            moved += jacobian[s, j] * step[j]
        largest = max(largest, abs(moved))
    return largest


@compiled
def trace_contour(
    image: NDArray[np.float32], start: Array, full_scale_dn: float, polish: bool, known: Array
) -> tuple[int, Array, Array, Array, NDArray[np.bool_], Array, Array]:
    """Points of the contour near an approximate ellipse, and the ellipse through them; see `edge_points`.

    `known` (3,): variance of the blur, inner and outer reach of the contour if it was measured before; else zeros.

    Returns
    -------
    failure : int
        0, or which of `FAILURES`; the rest is then meaningless.
    ellipse : (5,) array
    points, sigma, good : (count, 2), (count,), (count,) arrays
        The edge in each sector, its standard deviation, px, and whether it is trusted.
    feet : (count, 2) array
        Where the sectors were.
    about : (5,) array
        Variance of the blur, contrast, noise; inner and outer reach.
    """
    current, settled = start.copy(), known[0] > 0.0
    low, high, variance = -_FIRST_REACH_PX, _FIRST_REACH_PX, known[0] if settled else 1.0
    step, before, about = np.zeros(5), np.zeros(5), np.zeros(5)
    none = np.empty((0, 2)), np.empty(0), np.empty(0, np.bool_)
    feet, normals, units = np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 2))
    points, sigma, good = none
    for turn in range(_MAX_ROUNDS):
        first = turn == 0 and not settled
        count = max(MIN_SECTORS, round(arc_lengths(current[2], current[3])[-1] / SECTOR_PX))
        if turn == 0 and settled:
            inner, outer = known[1], known[2]
        else:
            inside = max(low, _PROFILE_STEP_PX * math.ceil(-0.9 * current[3] / _PROFILE_STEP_PX))
            number, total = contour_profile(image, current, inside, high, _PROFILE_STEP_PX)
            failure, inner, outer = reach_of(number, total, inside)
            if failure != OK:
                return failure, current, none[0], none[1], none[2], feet, about
        table, starts = contour_pixels(image, current, inner, outer, count)
        if len(table) < 2 * count:
            return NOT_FLAT, current, none[0], none[1], none[2], feet, about
        low, high = inner - PLATEAU_PX, outer + PLATEAU_PX
        about[3], about[4] = inner, outer
        expected = arc_lengths(current[2], current[3])[-1] / count * (outer - max(inner, -0.9 * current[3]))
        delta, sigma, good = np.zeros(count), np.empty(count), np.empty(count, np.bool_)
        variance, about[1], about[2] = sector_offsets(
            table, starts, expected, variance, full_scale_dn, first, delta, sigma, good
        )
        feet, normals, units = sector_centres(current, count)
        jacobian = np.empty((count, 5))
        for s in range(count):
            shape_row(normals[s, 0], normals[s, 1], units[s, 0], units[s, 1], jacobian[s])
        failure = _shape_step(jacobian, delta, sigma, good, current[3] if first else math.inf, step)
        if failure != OK:
            return failure, current, none[0], none[1], none[2], feet, about
        largest = _largest_move(jacobian, step)
        close = largest < min(_CLOSE_PX, _CLOSE * current[3])
        if close:
            # A small step changes distances linearly, up to its square over twice the radius of curvature.
            row = np.empty(5)
            for i in range(len(table)):
                shape_row(table[i, NORMAL_X], table[i, NORMAL_Y], table[i, U_X], table[i, U_Y], row)
                for j in range(5):
                    table[i, DISTANCE] += row[j] * step[j]
            for j in range(5):
                before[j] = step[j]
            variance, about[1], about[2] = sector_offsets(
                table, starts, expected, variance, full_scale_dn, turn < 0, delta, sigma, good
            )
            failure = _shape_step(jacobian, delta, sigma, good, math.inf, step)
            if failure != OK:
                return failure, current, none[0], none[1], none[2], feet, about
            bent = largest * largest / (2.0 * current[3])
            largest = max(_largest_move(jacobian, step), bent)
            for s in range(count):
                for j in range(5):
                    delta[s] -= jacobian[s, j] * before[j]
            for j in range(5):
                step[j] += before[j]
        sound, after = moved_ellipse(current, step)
        if not sound:
            return SHRINKS, current, none[0], none[1], none[2], feet, about
        points = np.empty((count, 2))
        for s in range(count):
            for j in range(2):
                points[s, j] = feet[s, j] + delta[s] * normals[s, j]
        about[0] = variance
        current = after
        if close and (not polish or largest < _SETTLED_PX):
            break
    return OK, current, points, sigma, good, feet, about
