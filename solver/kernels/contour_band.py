"""The grey levels in a wide band along a contour: how far they stay flat beside the edge, and whether they clip."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import (
    COLUMNS,
    NORMAL_X,
    NORMAL_Y,
    U_X,
    U_Y,
    arc_lengths,
    contour_pixels,
    foot_point,
    pixel_rows,
    turn_of,
)
from roundel.solver.kernels.trace_contour import shape_row

Array = NDArray[np.float64]

# Columns of a band.
BAND_X, BAND_Y, LEVEL, OFFSET, SECTOR, BAND = 0, 1, 2, 3, 4, 5

_LAST_PX = 1.5  # outermost part of a plateau of `edge_points`, with which pixels beyond it are compared
_FLAT = 0.01  # fraction of the contrast
_GROUPS = 12  # directions in which a plateau's flatness is tested
_SATURATED = 254.5 / 255.0  # fraction of the full scale
_CLIPPED = 0.002  # fraction of a plateau: more than a few hot pixels
_SHADES = 0.4  # pixels with a shade between the levels, per sector: an edge has about two, a binary mask none


@compiled
def contour_band(
    image: NDArray[np.float32], ellipse: Array, low: float, high: float, exact_px: float, trusted: NDArray[np.bool_]
) -> Array:
    """Pixels of the trusted sectors whose distance to an ellipse is within limits, and within 0.9 b on the inner side.

    Parameters
    ----------
    image : (H, W) float32 array
    ellipse : (5,) array
        x_px, y_px, a_px, b_px, angle_deg.
    low, high : float
        Limits of the distance, px.
    exact_px : float
        Distances up to this are exact, others are those along the gradient of the radius.
    trusted : (S,) array of bool

    Returns
    -------
    (N, 5) array
        x, y, level, distance, sector.
    """
    x, y, a, b = ellipse[0], ellipse[1], ellipse[2], ellipse[3]
    angle = math.radians(ellipse[4])
    c, s = math.cos(angle), math.sin(angle)
    inner, count = max(low, -0.9 * b), len(trusted)
    rows = pixel_rows(image.shape, ellipse, inner, high)
    most = 0
    for r in range(len(rows)):
        most += rows[r, 2] - rows[r, 1] + 1
    band, n = np.empty((most, BAND)), 0
    lengths = arc_lengths(a, b)
    knots = len(lengths) - 1
    for r in range(len(rows)):
        dy = rows[r, 0] - y
        for column in range(rows[r, 1], rows[r, 2] + 1):
            dx = column - x
            p, q = c * dx + s * dy, c * dy - s * dx
            ux, uy = p / a, q / b
            radius = math.sqrt(ux * ux + uy * uy)
            distance = (radius - 1.0) * radius / math.sqrt((ux / a) ** 2 + (uy / b) ** 2 + 1e-300)
            if abs(distance) < 1.5 * exact_px:
                distance, _nx, _ny, ux, uy = foot_point(a, b, p, q)
            if not inner <= distance <= high:
                continue
            at = turn_of(ux, uy) * knots
            knot = min(int(at), knots - 1)
            arc = lengths[knot] + (lengths[knot + 1] - lengths[knot]) * (at - knot)
            sector = min(int(arc * count / lengths[knots]), count - 1)
            if trusted[sector]:
                band[n, BAND_X], band[n, BAND_Y], band[n, LEVEL] = column, rows[r, 0], image[rows[r, 0], column]
                band[n, OFFSET], band[n, SECTOR] = distance, sector
                n += 1
    return band[:n]


@compiled
def flat_reach(band: Array, sectors: int, reach: Array, contrast_dn: float, noise_dn: float, wider: int) -> Array:
    """Extent (2,) of the plateaus beyond `reach` (2,): until some directions deviate from their level."""
    ends = np.empty(2)
    for side in range(2):
        sign = 2.0 * side - 1.0
        # Bin 0 is the last one of `reach`, the others are 1 px each.
        number, total = np.zeros((wider + 1, _GROUPS)), np.zeros((wider + 1, _GROUPS))
        for i in range(len(band)):
            beyond = sign * (band[i, OFFSET] - reach[side])
            if beyond > -_LAST_PX:
                k = max(math.ceil(beyond), 0)
                if k <= wider:
                    group = int(band[i, SECTOR]) * _GROUPS // sectors
                    number[k, group] += 1
                    total[k, group] += band[i, LEVEL]
        extent = 0
        for k in range(1, wider + 1):
            both, squares, inverse = 0, 0.0, 0.0
            for g in range(_GROUPS):
                if number[0, g] > 0 and number[k, g] > 0:
                    both += 1
                    squares += (total[k, g] / number[k, g] - total[0, g] / number[0, g]) ** 2
                    inverse += 1.0 / number[0, g] + 1.0 / number[k, g]
            if both < 3:
                break
            if squares / both > (_FLAT * contrast_dn) ** 2 + 2.0 * noise_dn**2 * inverse / both:
                break
            extent = k
        ends[side] = reach[side] + sign * extent
    return ends


@compiled
def clipping(band: Array, ends: Array, full_scale_dn: float, sectors: int) -> tuple[float, bool, bool, float]:
    """The clipping level of a contour, whether the plateaus inside and outside clip, and the share of clipped pixels.

    Parameters
    ----------
    band : (N, 5) array
    ends : (2,) array
        The distances that count.
    full_scale_dn : float
    sectors : int
        Number of trusted sectors.

    Returns
    -------
    clip_dn : float
        Infinite without clipped pixels; in a binary mask, too, as nothing tells whether it is clipped.
    inside, outside : bool
    share : float
    """
    clip_dn = full_scale_dn * _SATURATED
    number, over, low, high = np.zeros(2), np.zeros(2), math.inf, -math.inf
    total, clipped = 0, 0
    for i in range(len(band)):
        if not ends[0] <= band[i, OFFSET] <= ends[1]:
            continue
        level, side = band[i, LEVEL], int(band[i, OFFSET] > 0.0)
        total += 1
        number[side] += 1.0
        if level >= clip_dn:
            over[side], clipped = over[side] + 1.0, clipped + 1
        low, high = min(low, level), max(high, level)
    if clipped == 0:
        return math.inf, False, False, 0.0
    shades, margin = 0, 0.05 * (high - low)
    for i in range(len(band)):
        if ends[0] <= band[i, OFFSET] <= ends[1]:
            shades += low + margin < band[i, LEVEL] < high - margin
    if shades <= _SHADES * sectors:
        return math.inf, False, False, 0.0
    inside, outside = over[0] > _CLIPPED * number[0], over[1] > _CLIPPED * number[1]
    return clip_dn, bool(inside), bool(outside), clipped / total


@compiled
def plateau_pixels(band: Array, first: float, last: float) -> Array:
    """x, y and level (n, 3) of the pixels of a band whose distance is within these limits."""
    out, n = np.empty((len(band), 3)), 0
    for i in range(len(band)):
        if first <= band[i, OFFSET] <= last:
            out[n, 0], out[n, 1], out[n, 2] = band[i, BAND_X], band[i, BAND_Y], band[i, LEVEL]
            n += 1
    return out[:n]


@compiled
def edge_pixels(
    image: NDArray[np.float32], ellipse: Array, low: float, high: float, trusted: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.int64], Array]:
    """The pixels of the trusted sectors, their starts (see `contour_pixels`), and the jacobian (N, 5)."""
    count = len(trusted)
    table, starts = contour_pixels(image, ellipse, low, high, count)
    jacobian, kept, n = np.empty((len(table), 5)), np.zeros(count + 1, np.int64), 0
    for s in range(count):
        if trusted[s]:
            for i in range(starts[s], starts[s + 1]):
                for j in range(COLUMNS):
                    table[n, j] = table[i, j]
                shape_row(table[n, NORMAL_X], table[n, NORMAL_Y], table[n, U_X], table[n, U_Y], jacobian[n])
                n += 1
        kept[s + 1] = n
    return table[:n].copy(), kept, jacobian[:n].copy()
