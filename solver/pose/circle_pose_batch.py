"""Both poses of many circles at once, vectorised; `circle_pose` explains the method.

All arrays are (N,); a vector is three of them, which avoids sums over an axis of length three.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.solver.pose.circle_pose_scalar import CLOSE, FULL_SWEEPS, LEAST, MAX_SWEEPS, MOST, NOTHING, SPLITTER, TIE

Array = NDArray[np.float64]
Vector = tuple[Array, Array, Array]

_OUT_OF_RANGE = "the ellipse, K or the radius is too large or too small for float64"


def centre_and_shape_of_ellipse(ellipse: Array) -> list[Array]:
    """Centre x, y and a factor S11, S12, S21, S22 of the shape: the ellipse is {(x, y) + S u, |u| = 1}."""
    if not np.all(np.isfinite(ellipse)):
        raise ValueError("the ellipse has a value that is not finite")
    x, y, a, b, angle_deg = ellipse
    if not np.all(ellipse[2:4] > 0):
        raise ValueError("not an ellipse: both semi-axes must be positive")
    angle = np.radians(angle_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    return [x, y, cos * a, -sin * b, sin * a, cos * b]


def centre_and_shape_of_conic(conic: Array) -> list[Array]:
    """As `centre_and_shape_of_ellipse`, for conics (9, N).

    The elements of a conic determine the pose to 1e-15, but centre and determinant are differences that lose up to
    seven digits for a thin, distant ellipse. Therefore the value and the gradient at a first centre are summed with
    the rounding errors of their products (T. J. Dekker, A floating-point technique for extending the available
    precision, Numer. Math. 18, 1971), and one Newton step gives the final centre.
    """
    if not np.all(np.isfinite(conic)):
        raise ValueError("the conic has a value that is not finite")
    size = np.max(np.abs(conic), axis=0)
    if not np.all(size > 0.0):
        raise ValueError("not an ellipse: the conic is the zero matrix")
    if np.max(size) > MOST / 9 or np.min(size) < LEAST:
        conic = np.ldexp(conic, -np.frexp(size)[1])  # scaling by powers of two is exact
    conic = np.where(conic[0] + conic[4] < 0.0, -1.0, 1.0) * conic
    q11, q22, corner = conic[0], conic[4], conic[8]
    q12, l1, l2 = (conic[1] + conic[3]) / 2, (conic[2] + conic[6]) / 2, (conic[5] + conic[7]) / 2
    s11, s12, s22 = _split(q11), _split(q12), _split(q22)
    (p1, e1), (p2, e2) = _two_product(q11, q22, s11, s22), _two_product(q12, q12, s12, s12)
    determinant = (p1 - p2) + (e1 - e2)
    if not np.all((determinant > 0.0) & (q11 > 0.0)):
        raise ValueError("not an ellipse: the conic is a hyperbola, a parabola or a pair of lines")
    x, y = (q12 * l2 - q22 * l1) / determinant, (q12 * l1 - q11 * l2) / determinant
    sx, sy = _split(x), _split(y)
    g1 = _accurate_sum(_two_product(q11, x, s11, sx), _two_product(q12, y, s12, sy), l1)
    g2 = _accurate_sum(_two_product(q12, x, s12, sx), _two_product(q22, y, s22, sy), l2)
    value = _accurate_sum(_two_product(l1, x, _split(l1), sx), _two_product(l2, y, _split(l2), sy), corner)
    dx, dy = (q12 * g2 - q22 * g1) / determinant, (q12 * g1 - q11 * g2) / determinant
    # Value at the centre, negative inside: (x - centre)^T Q (x - centre) = level.
    level = -(value + (x * g1 + y * g2) + (g1 * dx + g2 * dy))
    if not np.all(level > 0.0):
        raise ValueError("not an ellipse: the conic has no real points, or only one")
    # S = sqrt(level) L^-T for Q = L L^T: any S with S S^T = level Q^-1 describes the same ellipse.
    last = np.sqrt(level * q11 / determinant)
    return [x + dx, y + dy, np.sqrt(level / q11), -q12 / q11 * last, np.zeros_like(last), last]


def _split(a: Array) -> tuple[Array, Array]:
    """Two halves of 26 bits, whose products are exact."""
    t = SPLITTER * a
    high = t - (t - a)
    return high, a - high


def _two_product(a: Array, b: Array, a_split: tuple[Array, Array], b_split: tuple[Array, Array]) -> tuple[Array, Array]:
    """Product of a and b, and its rounding error."""
    (ah, al), (bh, bl), p = a_split, b_split, a * b
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


def _accurate_sum(one: tuple[Array, Array], other: tuple[Array, Array], third: Array) -> Array:
    (p1, e1), (p2, e2) = one, other
    total = p1 + p2
    t = total - p1
    return np.asarray((total + third) + (((p1 - (total - t)) + (p2 - t)) + (e1 + e2)))


def _dot(a: Vector, b: Vector) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _combined(c: Array, x: Vector, s: Array, y: Vector) -> Vector:
    return c * x[0] + s * y[0], c * x[1] + s * y[1], c * x[2] + s * y[2]


def _orthogonalise(u: Vector, v: Vector, p: Vector) -> tuple[Vector, Vector, Vector, Array, Array]:
    """Make u, v, p orthogonal without changing p p^T - u u^T - v v^T (one-sided J-Jacobi); also u.u and v.v.

    Two hyperbolic rotations, then the plane rotation. If p has cosines eps with orthogonal u and v, a sweep leaves
    eps^3 (|u| / |p|)^2: two sweeps suffice for most cones, and the remainder is linear.
    Source: K. Veselic, A Jacobi eigenreduction algorithm for definite matrix pairs, Numer. Math. 64 (1993).
    """
    uu, vv, pp = _dot(u, u), _dot(v, v), _dot(p, p)
    for sweep in range(MAX_SWEEPS):
        if sweep >= FULL_SWEEPS:
            up, vp = _dot(u, p), _dot(v, p)
            t_u, t_v = -up / (uu + pp), -vp / (vv + pp)
            if np.all(np.maximum(up * up, vp * vp) <= CLOSE * (pp * np.minimum(uu, vv))):
                return _moved(u, t_u, p), _moved(v, t_v, p), _moved(_moved(p, t_u, u), t_v, v), uu, vv
        u, p, uu, pp = _hyperbolic(u, p, uu, pp)
        v, p, vv, pp = _hyperbolic(v, p, vv, pp)
        u, v, uu, vv = _plane(u, v)
    raise ValueError(_OUT_OF_RANGE)


def _moved(x: Vector, t: Array, y: Vector) -> Vector:
    return x[0] + t * y[0], x[1] + t * y[1], x[2] + t * y[2]


def _hyperbolic(x: Vector, y: Vector, xx: Array, yy: Array) -> tuple[Vector, Vector, Array, Array]:
    # x' = c x + s y, y' = s x + c y; tanh(2 theta) = -2 xy / (xx + yy), s / c = tanh theta.
    # p - u is the ray to a point of the ellipse, of length 1 or more, so xx + yy stays well above 2 |xy|.
    xy, total = _dot(x, y), xx + yy
    twice = 2.0 * xy
    t = -twice / (total + np.sqrt((total - twice) * (total + twice)))
    c = 1.0 / np.sqrt((1.0 - t) * (1.0 + t))
    s, change = t * c, t * xy
    return _combined(c, x, s, y), _combined(s, x, c, y), xx + change, yy + change


def _plane(x: Vector, y: Vector) -> tuple[Vector, Vector, Array, Array]:
    # x' = c x - s y, y' = s x + c y; tan(2 theta) = 2 xy / (yy - xx), the smaller angle.
    xx, yy, xy = _dot(x, x), _dot(y, y), _dot(x, y)
    gap, twice = yy - xx, 2.0 * xy
    t = np.copysign(1.0, gap) * twice / (np.abs(gap) + np.sqrt(gap * gap + twice * twice) + NOTHING)
    c = 1.0 / np.sqrt(1.0 + t * t)
    s, change = t * c, t * xy
    return _combined(c, x, -s, y), _combined(s, x, c, y), xx - change, yy + change


def poses_of_shape(x_y_shape: list[Array], k: Array, radius: Array, out: tuple[Array, Array]) -> None:
    """Errata, section 2, "Closed-form pose", with l1 = 1/s1^2, l2 = -1/s2^2, l3 = -1/s3^2 (up to one common scale)."""
    x, y, s11, s12, s21, s22 = x_y_shape
    fx, skew, cx, fy, cy = k
    py, u2, v2 = (y - cy) / fy, s21 / fy, s22 / fy
    px, u1, v1 = (x - cx - skew * py) / fx, (s11 - skew * u2) / fx, (s12 - skew * v2) / fx
    zero = np.zeros_like(px)
    u, v, p, uu, vv = _orthogonalise((u1, u2, zero), (v1, v2, zero), (px, py, np.ones_like(px)))
    larger_first = uu >= vv
    s1, s2, s3 = np.sqrt(_dot(p, p)), np.sqrt(np.maximum(uu, vv)), np.sqrt(np.minimum(uu, vv))
    smaller = [np.where(larger_first, b, a) for a, b in zip(u, v, strict=True)]
    # The axis of the cone passes through the ellipse, so it points forward, like e3, which orders the candidates.
    along, across = np.copysign(1.0 / s1, p[2]), np.copysign(1.0 / s3, smaller[2])
    e1, e3 = [a * along for a in p], [a * across for a in smaller]
    below = s2 * np.sqrt(s1 * s1 + s3 * s3)
    cos = s3 * np.sqrt(s1 * s1 + s2 * s2) / below
    sin = s1 * np.sqrt((s2 - s3) * (s2 + s3)) / below
    tied = sin * e3[2] <= TIE / 2
    if np.any(tied):
        # Smaller normal_z first; at a tie larger normal_x, then larger normal_y.
        x_differs = np.abs(sin * e3[0]) > TIE / 2
        sin = np.where(tied & np.where(x_differs, sin * e3[0] > 0.0, sin * e3[1] > TIE / 2), -sin, sin)
    to_centre, to_side = radius * (cos * s1 / s3), radius * (sin * s3 / s1)
    normal, centre = out
    for i in range(3):
        # The errata's n points away from the camera; here the normal points out of the print, toward the camera.
        axis, side = -cos * e1[i], sin * e3[i]
        normal[:, 0, i], normal[:, 1, i] = axis - side, axis + side
        axis, side = to_centre * e1[i], to_side * e3[i]
        centre[:, 0, i], centre[:, 1, i] = axis - side, axis + side
    if not np.all(np.isfinite(np.sum(centre, axis=(1, 2)) + np.sum(normal, axis=(1, 2)))):
        raise ValueError(_OUT_OF_RANGE)
