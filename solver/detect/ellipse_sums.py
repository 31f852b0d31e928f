"""An ellipse from sums over points: Halir and Flusser's direct fit in closed form, for thousands of arcs.

With centred points the 6x6 problem separates (Halir and Flusser 1998): the quadratic part a = (A, B, C) of the conic is
an eigenvector of the 3x3 matrix N = C1^-1 (S1 - S2 S3^-1 S2^T), with 4 A C - B^2 > 0. Exactly one eigenvalue of N is
not negative, and it belongs to the ellipse: the largest root of the characteristic cubic.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]


@compiled
def direct_fit(x: Array, y: Array, count: int, out: Array) -> bool:
    """Write the ellipse (5,) through the first `count` points to `out`; False if they determine none."""
    if count < 6:
        return False
    mx, my = 0.0, 0.0
    for i in range(count):
        mx += x[i]
        my += y[i]
    mx, my = mx / count, my / count
    size = 0.0
    for i in range(count):
        size += (x[i] - mx) ** 2 + (y[i] - my) ** 2
    size = math.sqrt(size / count)
    if not size > 0.0:
        return False
    # Moments of the centred points, scaled to unit size.
    xx, xy, yy, xxx, xxy, xyy, yyy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    xxxx, xxxy, xxyy, xyyy, yyyy = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        u, v = (x[i] - mx) / size, (y[i] - my) / size
        a, b, c = u * u, u * v, v * v
        xx += a
        xy += b
        yy += c
        xxx += a * u
        xxy += a * v
        xyy += c * u
        yyy += c * v
        xxxx += a * a
        xxxy += a * b
        xxyy += a * c
        xyyy += b * c
        yyyy += c * c
    determinant = xx * yy - xy * xy
    if not determinant > 1e-9 * (xx + yy) ** 2:  # on a line
        return False
    # Linear part (D, E, F) = T a: S3 is [[xx, xy, 0], [xy, yy, 0], [0, 0, n]].
    t = np.empty((3, 3))
    s2, m = np.empty((3, 3)), np.empty((3, 3))
    s2[0, 0], s2[0, 1], s2[0, 2] = xxx, xxy, xx
    s2[1, 0], s2[1, 1], s2[1, 2] = xxy, xyy, xy
    s2[2, 0], s2[2, 1], s2[2, 2] = xyy, yyy, yy
    for k in range(3):
        t[0, k] = -(yy * s2[k, 0] - xy * s2[k, 1]) / determinant
        t[1, k] = -(xx * s2[k, 1] - xy * s2[k, 0]) / determinant
        t[2, k] = -s2[k, 2] / count
    m[0, 0], m[0, 1], m[0, 2] = xxxx, xxxy, xxyy
    m[1, 0], m[1, 1], m[1, 2] = xxxy, xxyy, xyyy
    m[2, 0], m[2, 1], m[2, 2] = xxyy, xyyy, yyyy
    for i in range(3):
        for k in range(3):
            for j in range(3):
                m[i, k] += s2[i, j] * t[j, k]
    n = np.empty((3, 3))
    for k in range(3):
        n[0, k], n[1, k], n[2, k] = m[2, k] / 2.0, -m[1, k], m[0, k] / 2.0
    root = largest_root(n)
    for i in range(3):
        n[i, i] -= root
    # The null vector is orthogonal to all rows: the longest of the three cross products is the most accurate.
    best, qa, qb, qc = 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        j = (i + 1) % 3
        p = n[i, 1] * n[j, 2] - n[i, 2] * n[j, 1]
        q = n[i, 2] * n[j, 0] - n[i, 0] * n[j, 2]
        r = n[i, 0] * n[j, 1] - n[i, 1] * n[j, 0]
        length = p * p + q * q + r * r
        if length > best:
            best, qa, qb, qc = length, p, q, r
    return _ellipse_of_conic(
        qa, qb, qc,
        t[0, 0] * qa + t[0, 1] * qb + t[0, 2] * qc,
        t[1, 0] * qa + t[1, 1] * qb + t[1, 2] * qc,
        t[2, 0] * qa + t[2, 1] * qb + t[2, 2] * qc,
        mx, my, size, out,
    )  # fmt: skip


@compiled
def largest_root(matrix: Array) -> float:
    """The largest eigenvalue of a 3x3 matrix whose eigenvalues are real, by the trigonometric formula."""
    mean = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / 3.0
    a, b, c = matrix[0, 0] - mean, matrix[1, 1] - mean, matrix[2, 2] - mean
    d, e, f = matrix[0, 1] * matrix[1, 0], matrix[0, 2] * matrix[2, 0], matrix[1, 2] * matrix[2, 1]
    p = -(a * b + a * c + b * c - d - e - f) / 3.0  # x^3 - 3 p x - 2 q = 0
    q = (
        a * b * c - a * f - b * e - c * d
        + matrix[0, 1] * matrix[1, 2] * matrix[2, 0] + matrix[0, 2] * matrix[1, 0] * matrix[2, 1]
    ) / 2.0  # fmt: skip
    if not p > 0.0:
        return float(mean)
    cosine = min(max(q / (p * math.sqrt(p)), -1.0), 1.0)
    return float(mean + 2.0 * math.sqrt(p) * math.cos(math.acos(cosine) / 3.0))


@compiled
def _ellipse_of_conic(
    a: float, b: float, c: float, d: float, e: float, f: float, mx: float, my: float, size: float, out: Array
) -> bool:
    """x, y, a, b, angle_deg of A x^2 + B x y + C y^2 + D x + E y + F = 0, scaled by `size` and moved to (mx, my)."""
    determinant = 4.0 * a * c - b * b
    if not determinant > 0.0:
        return False
    if a < 0.0:
        a, b, c, d, e, f = -a, -b, -c, -d, -e, -f
    cx, cy = (b * e - 2.0 * c * d) / determinant, (b * d - 2.0 * a * e) / determinant
    level = -(f + (d * cx + e * cy) / 2.0)
    mean, half = (a + c) / 2.0, math.hypot((a - c) / 2.0, b / 2.0)
    if not (level > 0.0 and mean - half > 0.0):
        return False
    # The major axis belongs to the smaller eigenvalue.
    out[0], out[1] = mx + size * cx, my + size * cy
    out[2], out[3] = size * math.sqrt(level / (mean - half)), size * math.sqrt(level / (mean + half))
    out[4] = math.degrees(math.atan2(-b / 2.0, (c - a) / 2.0) / 2.0) % 180.0
    return math.isfinite(out[0] + out[1] + out[2] + out[3] + out[4])


@compiled
def sampson(ellipse: Array, x: float, y: float) -> float:
    """First-order (Sampson) distance of a point, negative inside."""
    c, s = math.cos(math.radians(ellipse[4])), math.sin(math.radians(ellipse[4]))
    dx, dy = x - ellipse[0], y - ellipse[1]
    p, q = (c * dx + s * dy) / ellipse[2], (c * dy - s * dx) / ellipse[3]
    gradient = (p / ellipse[2]) ** 2 + (q / ellipse[3]) ** 2
    return float((p * p + q * q - 1.0) / math.sqrt(max(4.0 * gradient, 1e-12)))
