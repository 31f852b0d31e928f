"""The pixels of a fit: a band along a contour, how far its levels stay flat, whether they clip, level functions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import (
    COLUMNS,
    DISTANCE,
    NORMAL_X,
    NORMAL_Y,
    U_X,
    U_Y,
    X,
    Y,
    arc_lengths,
    foot_point,
    pixel_rows,
    turn_of,
    write_pixel,
)
from roundel.solver.kernels.trace_contour import shape_row

Array = NDArray[np.float64]

# Columns of a band.
BAND_X, BAND_Y, LEVEL, OFFSET, SECTOR, BAND = 0, 1, 2, 3, 4, 5

_LAST_PX = 1.5  # outermost part of a plateau of `edge_points`, with which pixels beyond it are compared
_FLAT, _CHANGE = 0.01, 3.0  # fraction of the contrast, and sigmas of the noise
_GROUPS = 12  # directions in which a plateau's flatness is tested
_SATURATED = 254.5 / 255.0  # fraction of the full scale
_CLIPPED = 0.002  # fraction of a plateau: more than a few hot pixels
_SHADES = 0.4  # pixels with a shade between the levels, per sector: an edge has about two, a binary mask none


@compiled
def contour_band(
    image: NDArray[np.float32],
    ellipse: Array,
    low: float,
    high: float,
    edge_px: float,
    trusted: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Pixels of the trusted sectors whose distance to an ellipse is within limits, and within 0.9 b on the inner side.

    Parameters
    ----------
    image : (H, W) float32 array
    ellipse : (5,) array
        x_px, y_px, a_px, b_px, angle_deg.
    low, high : float
        Limits of the distance, px.
    edge_px : float
        Pixels up to this distance are those of the edge; farther ones have the distance along the gradient of the
        radius.
    trusted : (S,) array of bool

    Returns
    -------
    band : (N, 5) array
        x, y, level, distance, sector.
    edge : (N, 12) array
        See `contour_pixels`: of those pixels of the band that are the edge's, in the same rows.
    """
    x, y, a, b = ellipse[0], ellipse[1], ellipse[2], ellipse[3]
    angle = math.radians(ellipse[4])
    c, s = math.cos(angle), math.sin(angle)
    inner, count = max(low, -0.9 * b), len(trusted)
    rows = pixel_rows(image.shape, ellipse, inner, high)
    most = 0
    for r in range(len(rows)):
        most += rows[r, 2] - rows[r, 1] + 1
    band, edge, n = np.empty((most, BAND)), np.empty((most, COLUMNS)), 0
    lengths = arc_lengths(a, b)
    knots = len(lengths) - 1
    per_a, per_b, per_length = 1.0 / a, 1.0 / b, count / lengths[knots]
    for r in range(len(rows)):
        dy = rows[r, 0] - y
        for column in range(rows[r, 1], rows[r, 2] + 1):
            dx = column - x
            p, q = c * dx + s * dy, c * dy - s * dx
            ux, uy = p * per_a, q * per_b
            radius = math.sqrt(ux * ux + uy * uy)
            steep = math.sqrt((ux * per_a) ** 2 + (uy * per_b) ** 2 + 1e-300)
            distance, nx, ny = (radius - 1.0) * radius / steep, 0.0, 0.0
            near = abs(distance) < edge_px + 1.0
            if near:
                distance, nx, ny, ux, uy = foot_point(a, b, p, q)
            if not inner <= distance <= high:
                continue
            at = turn_of(ux, uy) * knots
            knot = min(int(at), knots - 1)
            arc = lengths[knot] + (lengths[knot + 1] - lengths[knot]) * (at - knot)
            sector = min(int(arc * per_length), count - 1)
            if not trusted[sector]:
                continue
            value = np.float64(image[rows[r, 0], column])
            band[n, BAND_X], band[n, BAND_Y], band[n, LEVEL] = column, rows[r, 0], value
            band[n, OFFSET], band[n, SECTOR] = distance, sector
            if near:
                write_pixel(edge[n], float(column), float(rows[r, 0]), value, distance, nx, ny, ux, uy, c, s, a, b)
            n += 1
    return band[:n], edge


@compiled
def group_of(sector: float, sectors: int) -> int:
    """The direction to which a sector belongs."""
    return int(sector) * _GROUPS // sectors


@compiled
def flat_reach(
    band: Array, sectors: int, reach: Array, contrast_dn: float, noise_dn: float, edge_px: float, wider: int
) -> Array:
    """Extent (2, directions) of the plateaus beyond `reach` (2,): until the level of a direction changes.

    Within `edge_px` of the contour it may still rise: the edge of a contour that is partly hidden seems to end where
    the mean level of all directions falls again.
    """
    ends = np.empty((2, _GROUPS))
    for side in range(2):
        sign = 2.0 * side - 1.0
        upward = sign if contrast_dn > 0.0 else -sign
        # Bin 0 is the last one of `reach`, the others are 1 px each.
        number, total = np.zeros((wider + 1, _GROUPS)), np.zeros((wider + 1, _GROUPS))
        for i in range(len(band)):
            beyond = sign * (band[i, OFFSET] - reach[side])
            if beyond > -_LAST_PX:
                k = max(math.ceil(beyond), 0)
                if k <= wider:
                    group = group_of(band[i, SECTOR], sectors)
                    number[k, group] += 1
                    total[k, group] += band[i, LEVEL]
        for g in range(_GROUPS):
            extent, base = 0, 0
            for k in range(1, wider + 1):
                if number[base, g] == 0 or number[k, g] == 0:
                    break
                change = total[k, g] / number[k, g] - total[base, g] / number[base, g]
                chance = noise_dn * noise_dn * (1.0 / number[base, g] + 1.0 / number[k, g])
                limit = math.sqrt((_FLAT * contrast_dn) ** 2 + _CHANGE**2 * chance)
                rising = sign * reach[side] + k - 1 < edge_px
                if change * upward < -limit or (abs(change) > limit and not rising):
                    break
                extent = k
                if rising:
                    base = k
            ends[side, g] = reach[side] + sign * extent
    return ends


@compiled
def clipping(
    band: Array, ends: Array, full_scale_dn: float, count: int, sectors: int
) -> tuple[float, bool, bool, float]:
    """The clipping level of a contour, whether the plateaus inside and outside clip, and the share of clipped pixels.

    Parameters
    ----------
    band : (N, 5) array
    ends : (2, directions) array
        The distances that count.
    full_scale_dn : float
    count, sectors : int
        Numbers of all and of the trusted sectors.

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
        group = group_of(band[i, SECTOR], count)
        if not ends[0, group] <= band[i, OFFSET] <= ends[1, group]:
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
        group = group_of(band[i, SECTOR], count)
        if ends[0, group] <= band[i, OFFSET] <= ends[1, group]:
            shades += low + margin < band[i, LEVEL] < high - margin
    if shades <= _SHADES * sectors:
        return math.inf, False, False, 0.0
    inside, outside = over[0] > _CLIPPED * number[0], over[1] > _CLIPPED * number[1]
    return clip_dn, bool(inside), bool(outside), clipped / total


@compiled
def plateau_pixels(band: Array, first: float, last: float, ends: Array, count: int) -> Array:
    """Rows (n, 5) of the pixels of a band whose distance is within these limits, and within those of its direction."""
    out, n = np.empty((len(band), BAND)), 0
    for i in range(len(band)):
        group = group_of(band[i, SECTOR], count)
        if max(first, ends[0, group]) <= band[i, OFFSET] <= min(last, ends[1, group]):
            for j in range(BAND):
                out[n, j] = band[i, j]
            n += 1
    return out[:n]


@compiled
def edge_pixels(
    band: Array, edge: Array, first: float, last: float, ends: Array, sectors: int
) -> tuple[Array, NDArray[np.int64], Array]:
    """The edge's pixels between two distances, sorted by sector, the starts of the sectors, and the jacobian (N, 5)."""
    starts, inside = np.zeros(sectors + 1, np.int64), np.empty(len(band), np.bool_)
    for i in range(len(band)):
        group = group_of(band[i, SECTOR], sectors)
        inside[i] = max(first, ends[0, group]) <= band[i, OFFSET] <= min(last, ends[1, group])
        if inside[i]:
            starts[int(band[i, SECTOR]) + 1] += 1
    for s in range(sectors):
        starts[s + 1] += starts[s]
    following = starts[:sectors].copy()
    table, jacobian = np.empty((starts[sectors], COLUMNS)), np.empty((starts[sectors], 5))
    for i in range(len(band)):
        if inside[i]:
            n = following[int(band[i, SECTOR])]
            following[int(band[i, SECTOR])] += 1
            for j in range(COLUMNS):
                table[n, j] = edge[i, j]
            shape_row(table[n, NORMAL_X], table[n, NORMAL_Y], table[n, U_X], table[n, U_Y], jacobian[n])
    return table, starts, jacobian


@compiled
def level_functions(x: float, y: float, k: int, out: Array) -> None:
    """Write level functions (k,) at a place relative to the centre: 1; x, y; squares."""
    out[0] = 1.0
    if k > 1:
        out[1], out[2] = x, y
    if k > 3:
        out[3], out[4], out[5] = x * x - y * y, 2.0 * x * y, x * x + y * y - 1.0


@compiled
def side_functions(side: Array, centre: Array, size_px: float, k: int) -> tuple[Array, Array, NDArray[np.int64], Array]:
    """Level functions (n, k), levels (n,), sectors (n,) and distances (n,) of the pixels of a plateau."""
    basis, value = np.empty((len(side), k)), np.empty(len(side))
    sector, distance = np.empty(len(side), np.int64), np.empty(len(side))
    for i in range(len(side)):
        level_functions((side[i, BAND_X] - centre[0]) / size_px, (side[i, BAND_Y] - centre[1]) / size_px, k, basis[i])
        value[i], sector[i], distance[i] = side[i, LEVEL], int(side[i, SECTOR]), side[i, OFFSET]
    return basis, value, sector, distance


@compiled
def edge_functions(table: Array, centre: Array, size_px: float, k: int) -> tuple[Array, Array, Array]:
    """Level functions (N, k) at the edge's pixels, their change along the normal, 1/px, and the foot points (N, 2).

    Foot points are relative to the centre, in units of `size_px`.
    """
    count = len(table)
    basis, slope, place = np.empty((count, k)), np.empty((count, k)), np.empty((count, 2))
    for i in range(count):
        pixel = table[i]
        x, y = (pixel[X] - centre[0]) / size_px, (pixel[Y] - centre[1]) / size_px
        nx, ny = pixel[NORMAL_X] / size_px, pixel[NORMAL_Y] / size_px
        level_functions(x, y, k, basis[i])
        level_functions(x + nx, y + ny, k, slope[i])
        for j in range(k):
            slope[i, j] -= basis[i, j]
        place[i, 0], place[i, 1] = x - pixel[DISTANCE] * nx, y - pixel[DISTANCE] * ny
    return basis, slope, place
