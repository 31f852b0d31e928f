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

    Newton's method of `roundel.solver.fit.ellipse_distance`, which has the source.
    """
    ax, by = max(abs(x), 1e-12 * a) * a, max(abs(y), 1e-12 * b) * b
    gap = (a - b) * (a + b)
    # The first-order distance, then Newton's steps; the root lies right of both poles.
    u, v = x / a, y / b
    first = 0.5 * (u * u + v * v - 1.0) / ((u / a) ** 2 + (v / b) ** 2 + 1e-300)
    root = max(b * b + first, by, ax - gap)
    for _ in range(100):
        far_inverse, root_inverse = 1.0 / (root + gap), 1.0 / root
        p, q = (ax * far_inverse) ** 2, (by * root_inverse) ** 2
        step = 0.5 * (p + q - 1.0) / (p * far_inverse + q * root_inverse)
        root = max(root + step, by, ax - gap)
        if abs(step) < 1e-8 * root:
            break
    ux, uy = ax / (root + gap), by / root
    steep = math.sqrt((ux / a) ** 2 + (uy / b) ** 2)
    ux, uy = math.copysign(ux, x), math.copysign(uy, y)
    return (root - b * b) * steep, ux / a / steep, uy / b / steep, ux, uy


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
    height, width = image.shape
    x, y, a, b = ellipse[0], ellipse[1], ellipse[2], ellipse[3]
    angle = math.radians(ellipse[4])
    c, s = math.cos(angle), math.sin(angle)
    inner = max(low, -0.9 * b)
    # The distance is at least b |radius - 1|: rows of pixels between two ellipses are a cheap superset of the band.
    quadratic = (c / a) ** 2 + (s / b) ** 2
    cross, across = 2.0 * c * s * (1.0 / a**2 - 1.0 / b**2), (s / a) ** 2 + (c / b) ** 2
    wide, narrow = (1.0 + high / b) ** 2, max(1.0 + inner / b, 0.0) ** 2
    half_h = math.hypot(a * s, b * c) * (1.0 + high / b)
    top, bottom = max(0, math.ceil(y - half_h)), min(height - 1, math.floor(y + half_h))
    most = 0
    for row in range(top, bottom + 1):
        dy = row - y
        left, right = _interval(quadratic, cross * dy, across * dy * dy - wide)
        from_x, to_x = max(0, math.ceil(x + left)), min(width - 1, math.floor(x + right))
        most += max(0, to_x - from_x + 1)
    found = np.empty((most, COLUMNS))
    sector = np.empty(most, np.int64)
    starts = np.zeros(count + 1, np.int64)
    lengths = arc_lengths(a, b)
    per_length = count / lengths[_KNOTS]
    n = 0
    for row in range(top, bottom + 1):
        dy = row - y
        left, right = _interval(quadratic, cross * dy, across * dy * dy - wide)
        hole_left, hole_right = _interval(quadratic, cross * dy, across * dy * dy - narrow)
        from_x, to_x = max(0, math.ceil(x + left)), min(width - 1, math.floor(x + right))
        column = from_x
        while column <= to_x:
            dx = column - x
            if hole_left < dx < hole_right:
                column = max(column + 1, math.ceil(x + hole_right))
                continue
            distance, nx, ny, ux, uy = foot_point(a, b, c * dx + s * dy, c * dy - s * dx)
            if inner <= distance <= high:
                t = math.atan2(uy, ux)
                at = (t if t >= 0.0 else t + 2.0 * math.pi) * (_KNOTS / (2.0 * math.pi))
                knot = min(int(at), _KNOTS - 1)
                arc = lengths[knot] + (lengths[knot + 1] - lengths[knot]) * (at - knot)
                sector[n] = min(int(arc * per_length), count - 1)
                starts[sector[n] + 1] += 1
                pixel = found[n]
                pixel[X], pixel[Y], pixel[VALUE], pixel[DISTANCE] = column, row, image[row, column], distance
                pixel[NORMAL_X], pixel[NORMAL_Y] = c * nx - s * ny, s * nx + c * ny
                pixel[U_X], pixel[U_Y] = c * ux - s * uy, s * ux + c * uy
                across_x, across_y = abs(pixel[NORMAL_X]), abs(pixel[NORMAL_Y])
                pixel[HALF_SUM], pixel[HALF_DIFFERENCE] = (across_x + across_y) / 2.0, (across_x - across_y) / 2.0
                pixel[CURVATURE], pixel[CURVATURE_SS] = curvatures(a, b, ux, uy)
                n += 1
            column += 1
    for i in range(count):
        starts[i + 1] += starts[i]
    following = starts[:count].copy()
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
