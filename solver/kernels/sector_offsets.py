"""The offset of the edge in each sector of a contour, by Gauss-Newton with grey levels of the neighbourhood."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import (
    CURVATURE,
    CURVATURE_SS,
    DISTANCE,
    HALF_DIFFERENCE,
    HALF_SUM,
    VALUE,
)
from roundel.solver.kernels.edge_response import curved_distance, gaussian_step, step_response
from roundel.solver.kernels.order_statistics import median, quantile

Array = NDArray[np.float64]

SECTOR_PX = 2.0
MIN_VARIANCE = 0.05**2  # a smaller blur is indistinguishable from none
_LEVEL_WINDOW_PX = 10.0  # grey levels come from this distance along the contour, on either side
_SATURATED = 254.5 / 255.0  # fraction of the full scale
_FIRST_STEPS, _STEPS, _SATURATED_STEPS = 4, 3, 12


@compiled
def _around(values: Array, window: int, sums: Array) -> None:
    """Sums (count, k) over the `window` neighbours on either side, around the closed contour."""
    count, k = values.shape
    for j in range(k):
        total = 0.0
        for i in range(-window, window + 1):
            total += values[i % count, j]
        for i in range(count):
            sums[i, j] = total
            total += values[(i + window + 1) % count, j] - values[(i - window) % count, j]


@compiled
def _saturated_pixels(table: Array, count: int, full_scale_dn: float, first: bool) -> tuple[NDArray[np.bool_], float]:
    """Which pixels are saturated, and their share.

    In the first iteration the contour is too rough to identify them; in binary pixels (an edge should have about one
    shade per px) they cannot be identified at all.
    """
    n = len(table)
    saturated = np.zeros(n, np.bool_)
    low, high = table[0, VALUE], table[0, VALUE]
    for i in range(n):
        low, high = min(low, table[i, VALUE]), max(high, table[i, VALUE])
    shades, clipped, margin = 0, 0, 0.05 * (high - low)
    for i in range(n):
        shades += low + margin < table[i, VALUE] < high - margin
        saturated[i] = table[i, VALUE] >= full_scale_dn * _SATURATED
        clipped += saturated[i]
    if first or shades <= 0.2 * count * SECTOR_PX:
        for i in range(n):
            saturated[i] = False
        clipped = 0
    return saturated, clipped / max(n, 1)


@compiled
def sector_offsets(
    table: Array,
    starts: NDArray[np.int64],
    expected: float,
    variance: float,
    full_scale_dn: float,
    first: bool,
    delta: Array,
    sigma: Array,
    good: NDArray[np.bool_],
) -> tuple[float, float, float]:
    """Offsets of the sectors, written to `delta`, with their standard deviations and whether they show an edge.

    Parameters
    ----------
    table, starts : arrays
        See `contour_pixels`.
    expected : float
        Number of pixels of a sector if all were inside the image.
    variance : float
        Variance of the blur to start from, px^2.
    full_scale_dn : float
    first : bool
        Whether the contour is still rough.
    delta, sigma : (count,) arrays
        Written: the edge's offset outward and its standard deviation, px.
    good : (count,) array of bool
        Written.

    Returns
    -------
    variance, contrast_dn, noise_dn : float
        Of the blur; median of outside minus inside; RMS residual of the good sectors.
    """
    count, n = len(starts) - 1, len(table)
    steps = _FIRST_STEPS if first else _STEPS
    saturated, share = _saturated_pixels(table, count, full_scale_dn, first)
    window = min(max(1, round(_LEVEL_WINDOW_PX / SECTOR_PX)), (count - 1) // 4)
    if share > 0.1:
        # Levels, offsets and blur are then correlated: they converge slowly, and need the whole contour.
        steps, window = _SATURATED_STEPS, (count - 1) // 2
    seen, lean, widen, response = np.empty(n), np.zeros(n), np.empty(n), np.empty(n)
    for i in range(n):
        seen[i] = 1.0
    for s in range(count):
        delta[s] = 0.0
    residual, slopes, bends = np.empty(n), np.empty(n), np.empty(n)
    inverse, information, widened = np.zeros(count), np.empty(count), np.empty(count)
    sums, near, height = np.empty((count, 5)), np.empty((count, 5)), np.empty(count)
    for _ in range(steps):
        total = variance + PIXEL_VARIANCE
        # Grey levels: least squares in (inside, outside), the normal equations summed over the neighbouring sectors;
        # the offset of each sector is eliminated before (Schur complement).
        for s in range(count):
            lean_p, lean_q, lean_v, pp, qq, pq, pv, qv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(starts[s], starts[s + 1]):
                z, _drift = curved_distance(
                    table[i, DISTANCE] - delta[s], table[i, CURVATURE], table[i, CURVATURE_SS], total
                )
                if first:  # a Gaussian of the pixel's variance suffices: one term instead of four
                    t, slope, bend = gaussian_step(z, total)
                else:
                    t, slope, bend = step_response(z, table[i, HALF_SUM], table[i, HALF_DIFFERENCE], variance)
                response[i], slopes[i], bends[i] = t, slope, bend
                p, q, v = seen[i] * (1.0 - t), seen[i] * t, seen[i] * table[i, VALUE]
                lean_p, lean_q, lean_v = lean_p + lean[i] * p, lean_q + lean[i] * q, lean_v + lean[i] * v
                pp, qq, pq, pv, qv = pp + p * p, qq + q * q, pq + p * q, pv + p * v, qv + q * v
            sums[s, 0], sums[s, 1] = pp - inverse[s] * lean_p * lean_p, qq - inverse[s] * lean_q * lean_q
            sums[s, 2] = pq - inverse[s] * lean_p * lean_q
            sums[s, 3], sums[s, 4] = pv - inverse[s] * lean_p * lean_v, qv - inverse[s] * lean_q * lean_v
        _around(sums, window, near)
        most = 0.0
        for s in range(count):
            a11, a22, a12, b1, b2 = near[s]
            determinant = max(a11 * a22 - a12 * a12, 1e-9 * (a11 + a22) ** 2 + 1e-12)
            inside, outside = (a22 * b1 - a12 * b2) / determinant, (a11 * b2 - a12 * b1) / determinant
            height[s] = outside - inside
            known, pushed, wide = 0.0, 0.0, 0.0
            for i in range(starts[s], starts[s + 1]):
                predicted = inside + height[s] * response[i]
                # A saturated pixel is only a lower bound.
                seen[i] = 0.0 if saturated[i] and predicted >= full_scale_dn else 1.0
                residual[i] = seen[i] * (table[i, VALUE] - predicted)
                lean[i] = seen[i] * height[s] * slopes[i]
                # The blur's variance: dT / d(b^2) = T'' / 2, the heat equation.
                widen[i] = seen[i] * height[s] * bends[i] / 2.0
                known, pushed = known + lean[i] * lean[i], pushed + lean[i] * residual[i]
                wide += lean[i] * widen[i]
            information[s], widened[s] = known, wide
            most = max(most, known)
            inverse[s] = 1.0 / known if known > 0.0 else 0.0
            delta[s] -= min(max(pushed * inverse[s], -1.0), 1.0)
        power, change = 0.0, 0.0
        for s in range(count):
            for i in range(starts[s], starts[s + 1]):
                own = widen[i] - lean[i] * widened[s] * inverse[s]  # without what the offsets explain
                power, change = power + own * own, change + own * residual[i]
        change = change / power if power > 0.0 else 0.0
        variance = min(max(variance + change, variance / 4.0, MIN_VARIANCE), variance * 4.0)
    ordered = height.copy()
    lower, contrast, upper = quantile(ordered, 0.25), quantile(ordered, 0.5), quantile(ordered, 0.75)
    strong = upper if upper >= -lower else lower
    # Half of a contour or more may be hidden, without a step, or in a shadow, with a small step.
    uneven = abs(contrast) < 0.3 * abs(strong)
    least = 0.1 * abs(strong) if uneven else 0.35 * abs(contrast)
    if uneven:
        contrast = strong
    sign = 1.0 if contrast > 0.0 else -1.0 if contrast < 0.0 else 0.0
    spread = np.empty(count)
    for s in range(count):
        squares = 0.0
        for i in range(starts[s], starts[s + 1]):
            squares += residual[i] * residual[i]
        spread[s] = math.sqrt(squares / max(starts[s + 1] - starts[s], 1))
    widest = max(4.0 * median(spread.copy()), 0.05 * abs(contrast))
    squares, pixels = 0.0, 0
    for s in range(count):
        usable = information[s] > 1e-12 * most
        good[s] = (
            usable
            and height[s] * sign > least
            and starts[s + 1] - starts[s] > 0.6 * expected
            and abs(delta[s]) < 2.5
            and spread[s] <= widest
        )
        sigma[s] = math.sqrt(1.0 / information[s]) if usable else math.inf
        if good[s]:
            squares, pixels = squares + spread[s] ** 2 * (starts[s + 1] - starts[s]), pixels + starts[s + 1] - starts[s]
    noise = math.sqrt(squares / pixels) if pixels > 0 else 0.0
    for s in range(count):
        sigma[s] *= max(noise, 1e-6)
    return variance, contrast, noise
