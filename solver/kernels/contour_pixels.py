"""The pixels around an ellipse: a table with a row a pixel, sorted by the sectors of the contour."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]

# Columns: position, grey level, signed distance (positive outside), outer normal at the foot point, unit vector u with
# foot point = centre + S u, (|nx| + |ny|) / 2 and (|nx| - |ny|) / 2, curvature and its second derivative by arc length.
X, Y, VALUE, DISTANCE, NORMAL_X, NORMAL_Y, U_X, U_Y, HALF_SUM, HALF_DIFFERENCE, CURVATURE, CURVATURE_SS = range(12)
COLUMNS = 12

_KNOTS = 360


@compiled
def arc_lengths(a: float, b: float) -> Array:
    """Arc length of an ellipse (361,) from the eccentric angle 0 to each whole degree, px."""
    lengths = np.zeros(_KNOTS + 1)
    step = 2.0 * math.pi / _KNOTS
    for i in range(_KNOTS):
        t = (i + 0.5) * step
        lengths[i + 1] = lengths[i] + math.hypot(a * math.sin(t), b * math.cos(t)) * step
    return lengths


@compiled
def foot_point(a: float, b: float, x: float, y: float) -> tuple[float, float, float, float, float]:
    """Signed distance of a point in an ellipse's own frame, outer normal, and (cos, sin) of its eccentric angle.

    The equation is that of `roundel.solver.fit.ellipse_distance`, which has the source; the start is exact for circles,
    and Halley's method triples the digits.
    """
    per_a, per_b = 1.0 / a, 1.0 / b
    ax, by = max(abs(x), 1e-12 * a) * a, max(abs(y), 1e-12 * b) * b
    gap, square_b = (a - b) * (a + b), b * b
    u, v = x * per_a, y * per_b
    square = u * u + v * v
    u, v = u * per_a, v * per_b
    least = max(by, ax - gap)  # the root lies right of both poles
    root = max(square_b + (math.sqrt(square) - 1.0) * square / (u * u + v * v + 1e-300), least)
    for _ in range(100):
        far = root + gap
        both = 1.0 / (far * root)
        far_inverse, root_inverse = root * both, far * both
        p, q = (ax * far_inverse) ** 2, (by * root_inverse) ** 2
        p_slope, q_slope = p * far_inverse, q * root_inverse
        slope, value = p_slope + q_slope, 0.5 * (p + q - 1.0)
        bend = 1.5 * value * (p_slope * far_inverse + q_slope * root_inverse)
        step = value * slope / max(slope * slope - bend, 0.5 * slope * slope)
        root = max(root + step, least)
        if abs(step) < 1e-4 * root:
            break
    far = root + gap
    both = 1.0 / (far * root)
    ux, uy = math.copysign(ax * root * both, x), math.copysign(by * far * both, y)
    nx, ny = ux * per_a, uy * per_b
    steep = math.sqrt(nx * nx + ny * ny)
    return (root - square_b) * steep, nx / steep, ny / steep, ux, uy


@compiled
def curvatures(a: float, b: float, cos_t: float, sin_t: float) -> tuple[float, float]:
    """Curvature of an ellipse at an eccentric angle, and its second derivative by arc length."""
    gap = (a - b) * (a + b)
    g = (a * sin_t) ** 2 + (b * cos_t) ** 2
    root = math.sqrt(g)
    double_sin, double_cos = 2.0 * sin_t * cos_t, cos_t * cos_t - sin_t * sin_t
    second = -1.5 * a * b * gap * (2.0 * double_cos - 3.0 * gap * double_sin * double_sin / g) / (g * g * g * root)
    return a * b / (g * root), second


@compiled
def _interval(quadratic: float, linear: float, constant: float) -> tuple[float, float]:
    """The x between the roots of a parabola, empty (1, 0) if there are none."""
    discriminant = linear * linear - 4.0 * quadratic * constant
    if discriminant < 0.0:
        return 1.0, 0.0
    root = math.sqrt(discriminant)
    return (-linear - root) / (2.0 * quadratic), (-linear + root) / (2.0 * quadratic)


@compiled
def pixel_rows(shape: tuple[int, int], ellipse: Array, low: float, high: float) -> NDArray[np.int64]:
    """Rows of pixels (n, 3), row and first and last column, that cover the band within limits of the distance.

    The distance is at least b |radius - 1|: the pixels between two ellipses are a cheap superset of the band.
    """
    height, width = shape
    x, y, a, b = ellipse[0], ellipse[1], ellipse[2], ellipse[3]
    angle = math.radians(ellipse[4])
    c, s = math.cos(angle), math.sin(angle)
    quadratic = (c / a) ** 2 + (s / b) ** 2
    cross, across = 2.0 * c * s * (1.0 / a**2 - 1.0 / b**2), (s / a) ** 2 + (c / b) ** 2
    wide, narrow = (1.0 + high / b) ** 2, max(1.0 + low / b, 0.0) ** 2
    half_h = math.hypot(a * s, b * c) * (1.0 + high / b)
    top, bottom = max(0, math.ceil(y - half_h)), min(height - 1, math.floor(y + half_h))
    rows = np.empty((2 * max(bottom - top + 1, 0), 3), np.int64)
    n = 0
    for row in range(top, bottom + 1):
        dy = row - y
        left, right = _interval(quadratic, cross * dy, across * dy * dy - wide)
        hole_left, hole_right = _interval(quadratic, cross * dy, across * dy * dy - narrow)
        first, last = max(0, math.ceil(x + left)), min(width - 1, math.floor(x + right))
        gap_first, gap_last = math.floor(x + hole_left) + 1, math.ceil(x + hole_right) - 1
        if hole_left >= hole_right or gap_last < first or gap_first > last:
            gap_first, gap_last = last + 1, last
        if gap_first > first:
            rows[n, 0], rows[n, 1], rows[n, 2] = row, first, min(gap_first - 1, last)
            n += 1
        if gap_last < last:
            rows[n, 0], rows[n, 1], rows[n, 2] = row, max(gap_last + 1, first), last
            n += 1
    return rows[:n]


@compiled
def contour_profile(
    image: NDArray[np.float32], ellipse: Array, low: float, high: float, step_px: float
) -> tuple[NDArray[np.int64], Array]:
    """Number of pixels and sum of their levels in bins of the distance to an ellipse, from `low` on.

    The distance is that along the gradient of the radius: exact for circles, and to first order at the contour.
    """
    x, y, per_a, per_b = ellipse[0], ellipse[1], 1.0 / ellipse[2], 1.0 / ellipse[3]
    angle = math.radians(ellipse[4])
    c, s = math.cos(angle), math.sin(angle)
    bins = int((high - low) / step_px) + 1
    number, total = np.zeros(bins, np.int64), np.zeros(bins)
    rows = pixel_rows(image.shape, ellipse, low, high)
    for r in range(len(rows)):
        dy = rows[r, 0] - y
        for column in range(rows[r, 1], rows[r, 2] + 1):
            dx = column - x
            u, v = (c * dx + s * dy) * per_a, (c * dy - s * dx) * per_b
            radius = math.sqrt(u * u + v * v)
            u, v = u * per_a, v * per_b
            distance = (radius - 1.0) * radius / math.sqrt(u * u + v * v + 1e-300)
            if low <= distance <= high:
                k = int((distance - low) / step_px)
                number[k] += 1
                total[k] += image[rows[r, 0], column]
    return number, total


@compiled
def turn_of(ux: float, uy: float) -> float:
    """Direction of a vector in turns, 0 to 1, to 2e-6.

    Source: M. Abramowitz, I. Stegun, Handbook of Mathematical Functions, 4.4.47.
    """
    x, y = abs(ux), abs(uy)
    ratio = min(x, y) / max(x, y)
    square = ratio * ratio
    angle = 0.0208351 * square - 0.0851330
    angle = ((angle * square + 0.1801410) * square - 0.3302995) * square + 0.9998660
    turn = angle * ratio / (2.0 * math.pi)
    turn = 0.25 - turn if y > x else turn
    turn = 0.5 - turn if ux < 0.0 else turn
    return 1.0 - turn if uy < 0.0 else turn


@compiled
def write_pixel(
    pixel: Array,
    x: float,
    y: float,
    value: float,
    distance: float,
    nx: float,
    ny: float,
    ux: float,
    uy: float,
    c: float,
    s: float,
    a: float,
    b: float,
) -> None:
    """Write a row of a table; normal and direction are in the ellipse's frame, of cosine c and sine s."""
    pixel[X], pixel[Y], pixel[VALUE], pixel[DISTANCE] = x, y, value, distance
    pixel[NORMAL_X], pixel[NORMAL_Y] = c * nx - s * ny, s * nx + c * ny
    pixel[U_X], pixel[U_Y] = c * ux - s * uy, s * ux + c * uy
    across_x, across_y = abs(pixel[NORMAL_X]), abs(pixel[NORMAL_Y])
    pixel[HALF_SUM], pixel[HALF_DIFFERENCE] = (across_x + across_y) / 2.0, (across_x - across_y) / 2.0
    pixel[CURVATURE], pixel[CURVATURE_SS] = curvatures(a, b, ux, uy)


@compiled
def contour_pixels(
    image: NDArray[np.float32], ellipse: Array, low: float, high: float, count: int
) -> tuple[Array, NDArray[np.int64]]:
    """Pixels whose distance to an ellipse is within limits, and within 0.9 b on the inner side.

    Parameters
    ----------
    image : (H, W) float32 array
    ellipse : (5,) array
        x_px, y_px, a_px, b_px, angle_deg.
    low, high : float
        Limits of the distance, px.
    count : int
        Number of sectors of equal length, from the eccentric angle 0.

    Returns
    -------
    table : (N, 12) array
        See the constants of this module.
    starts : (count + 1,) array
        Rows `starts[i]` to `starts[i + 1]` are sector i.
    """
    x, y, a, b = ellipse[0], ellipse[1], ellipse[2], ellipse[3]
    angle = math.radians(ellipse[4])
    c, s = math.cos(angle), math.sin(angle)
    inner = max(low, -0.9 * b)
    rows = pixel_rows(image.shape, ellipse, inner, high)
    most = 0
    for r in range(len(rows)):
        most += rows[r, 2] - rows[r, 1] + 1
    found = np.empty((most, COLUMNS))
    sector = np.empty(most, np.int64)
    starts = np.zeros(count + 1, np.int64)
    lengths = arc_lengths(a, b)
    per_length = count / lengths[_KNOTS]
    n = 0
    for r in range(len(rows)):
        row = rows[r, 0]
        dy = row - y
        for column in range(rows[r, 1], rows[r, 2] + 1):
            dx = column - x
            distance, nx, ny, ux, uy = foot_point(a, b, c * dx + s * dy, c * dy - s * dx)
            if not inner <= distance <= high:
                continue
            at = turn_of(ux, uy) * _KNOTS
            knot = min(int(at), _KNOTS - 1)
            arc = lengths[knot] + (lengths[knot + 1] - lengths[knot]) * (at - knot)
            sector[n] = min(int(arc * per_length), count - 1)
            starts[sector[n] + 1] += 1
            value = np.float64(image[row, column])
            write_pixel(found[n], float(column), float(row), value, distance, nx, ny, ux, uy, c, s, a, b)
            n += 1
    following = np.empty(count, np.int64)
    for i in range(count):
        following[i] = starts[i]
        starts[i + 1] += starts[i]
    table = np.empty((n, COLUMNS))
    for i in range(n):
        for j in range(COLUMNS):
            table[following[sector[i]], j] = found[i, j]
        following[sector[i]] += 1
    return table, starts


@compiled
def sector_centres(ellipse: Array, count: int) -> tuple[Array, Array, Array]:
    """Foot points, outer normals and unit vectors u, (count, 2) each, at the middle of each sector."""
    a, b = ellipse[2], ellipse[3]
    angle = math.radians(ellipse[4])
    c, s = math.cos(angle), math.sin(angle)
    lengths = arc_lengths(a, b)
    feet, normals, units = np.empty((count, 2)), np.empty((count, 2)), np.empty((count, 2))
    knot = 0
    for i in range(count):
        arc = (i + 0.5) / count * lengths[_KNOTS]
        while lengths[knot + 1] < arc:
            knot += 1
        t = (knot + (arc - lengths[knot]) / (lengths[knot + 1] - lengths[knot])) * (2.0 * math.pi / _KNOTS)
        ux, uy = math.cos(t), math.sin(t)
        steep = math.sqrt((ux / a) ** 2 + (uy / b) ** 2)
        nx, ny = ux / a / steep, uy / b / steep
        feet[i, 0], feet[i, 1] = ellipse[0] + c * a * ux - s * b * uy, ellipse[1] + s * a * ux + c * b * uy
        normals[i, 0], normals[i, 1] = c * nx - s * ny, s * nx + c * ny
        units[i, 0], units[i, 1] = c * ux - s * uy, s * ux + c * uy
    return feet, normals, units
