"""Both poses of a single circle in plain Python floats, without the overhead of vectorised calls.

The steps are those of `circle_pose_batch`, in the same order, so both give the same numbers, except for a last sweep
that a batch may need for its worst member. Degenerate and invalid input returns None; the batch version then handles it
and raises the errors.
"""

from __future__ import annotations

from math import copysign, cos, fabs, radians, sin, sqrt

Triple = tuple[float, float, float]
Pair = tuple[tuple[Triple, Triple], tuple[Triple, Triple]]
Rows = list[list[float]]

# Vectors with squared cosines below this need no further rotation: a first-order step makes them orthogonal.
CLOSE = 2.0**-53
# Most cones need two sweeps, almost none needs only one, and none needs 40.
FULL_SWEEPS, MAX_SWEEPS = 2, 40
# Added to a denominator that is zero only if its numerator is.
NOTHING = 1e-300
# Two normals whose z differ by less than this are tied, because rounding must not decide their order.
TIE = 1e-12
# Range of a conic's elements in which products of four neither overflow nor underflow.
LEAST, MOST = 2.0**-60, 2.0**60
# Range of ordinary squared sizes, in focal lengths: their fourth powers are far from float64's limits, and the rounding
# of their sums is far below one.
_SMALL, _LARGE = 2.0**-120, 2.0**40
SPLITTER = 134217729.0  # 2^27 + 1


def pose_of_ellipse(ellipse: list[float], k: Rows, radius: float) -> Pair | None:
    """Normals and centres of both candidates from x, y, a, b (px), angle_deg; None if the input is not ordinary."""
    x, y, a, b, angle_deg = ellipse
    if not (a > 0.0 and b > 0.0 and angle_deg - angle_deg == 0.0):
        return None
    angle = radians(angle_deg)
    c, s = cos(angle), sin(angle)
    return _poses(x, y, c * a, -s * b, s * a, c * b, k, radius)


def pose_of_conic(conic: Rows, k: Rows, radius: float) -> Pair | None:
    """Normals and centres of both candidates from a conic in pixels; None if the input is not ordinary."""
    (q11, c01, c02), (c10, q22, c12), (c20, c21, corner) = conic
    q12, l1, l2 = (c01 + c10) / 2.0, (c02 + c20) / 2.0, (c12 + c21) / 2.0
    if not (LEAST < fabs(q11) + fabs(q12) + fabs(q22) + fabs(l1) + fabs(l2) + fabs(corner) < MOST):
        return None
    if q11 < 0.0:
        q11, q12, q22, l1, l2, corner = -q11, -q12, -q22, -l1, -l2, -corner
    # `_two_product` written out: see `circle_pose_batch.centre_and_shape_of_conic`, step by step.
    t = SPLITTER * q11
    h11 = t - (t - q11)
    t = SPLITTER * q12
    h12 = t - (t - q12)
    t = SPLITTER * q22
    h22 = t - (t - q22)
    r11, r12, r22 = q11 - h11, q12 - h12, q22 - h22
    p1, p2 = q11 * q22, q12 * q12
    e1 = ((h11 * h22 - p1) + h11 * r22 + r11 * h22) + r11 * r22
    e2 = ((h12 * h12 - p2) + h12 * r12 + r12 * h12) + r12 * r12
    determinant = (p1 - p2) + (e1 - e2)
    if not (determinant > 0.0 and q11 > 0.0):
        return None
    x, y = (q12 * l2 - q22 * l1) / determinant, (q12 * l1 - q11 * l2) / determinant
    t = SPLITTER * x
    hx = t - (t - x)
    t = SPLITTER * y
    hy = t - (t - y)
    rx, ry = x - hx, y - hy

    p1, p2 = q11 * x, q12 * y
    e1 = ((h11 * hx - p1) + h11 * rx + r11 * hx) + r11 * rx
    e2 = ((h12 * hy - p2) + h12 * ry + r12 * hy) + r12 * ry
    total = p1 + p2
    t = total - p1
    g1 = (total + l1) + (((p1 - (total - t)) + (p2 - t)) + (e1 + e2))
    p1, p2 = q12 * x, q22 * y
    e1 = ((h12 * hx - p1) + h12 * rx + r12 * hx) + r12 * rx
    e2 = ((h22 * hy - p2) + h22 * ry + r22 * hy) + r22 * ry
    total = p1 + p2
    t = total - p1
    g2 = (total + l2) + (((p1 - (total - t)) + (p2 - t)) + (e1 + e2))
    t = SPLITTER * l1
    h1 = t - (t - l1)
    t = SPLITTER * l2
    h2 = t - (t - l2)
    r1, r2 = l1 - h1, l2 - h2
    p1, p2 = l1 * x, l2 * y
    e1 = ((h1 * hx - p1) + h1 * rx + r1 * hx) + r1 * rx
    e2 = ((h2 * hy - p2) + h2 * ry + r2 * hy) + r2 * ry
    total = p1 + p2
    t = total - p1
    value = (total + corner) + (((p1 - (total - t)) + (p2 - t)) + (e1 + e2))

    dx, dy = (q12 * g2 - q22 * g1) / determinant, (q12 * g1 - q11 * g2) / determinant
    level = -(value + (x * g1 + y * g2) + (g1 * dx + g2 * dy))
    if not level > 0.0:
        return None
    s22 = sqrt(level * q11 / determinant)
    return _poses(x + dx, y + dy, sqrt(level / q11), -q12 / q11 * s22, 0.0, s22, k, radius)


def _poses(x: float, y: float, s11: float, s12: float, s21: float, s22: float, k: Rows, radius: float) -> Pair | None:
    (fx, skew, cx), (k10, fy, cy), (k20, k21, k22) = k
    if k22 != 1.0:
        if k22 == 0.0:
            return None
        fx, skew, cx, fy, cy = fx / k22, skew / k22, cx / k22, fy / k22, cy / k22
    if k10 != 0.0 or k20 != 0.0 or k21 != 0.0 or fx == 0.0 or fy == 0.0 or not 0.0 < radius < MOST:
        return None
    # p = K^-1 [x; y; 1] and the columns u, v of W = K^-1 [S; 0].
    py, u2, v2 = (y - cy) / fy, s21 / fy, s22 / fy
    px, u1, v1 = (x - cx - skew * py) / fx, (s11 - skew * u2) / fx, (s12 - skew * v2) / fx
    u3, v3, pz = 0.0, 0.0, 1.0
    uu, vv, pp = u1 * u1 + u2 * u2 + u3 * u3, v1 * v1 + v2 * v2 + v3 * v3, px * px + py * py + pz * pz
    if not (_SMALL < uu < _LARGE and _SMALL < vv < _LARGE and pp < _LARGE):
        return None
    for sweep in range(MAX_SWEEPS):
        if sweep >= FULL_SWEEPS:
            up, vp = u1 * px + u2 * py + u3 * pz, v1 * px + v2 * py + v3 * pz
            if max(up * up, vp * vp) <= CLOSE * (pp * min(uu, vv)):
                t, s = -up / (uu + pp), -vp / (vv + pp)
                u1, u2, u3, v1, v2, v3, px, py, pz = (
                    u1 + t * px,
                    u2 + t * py,
                    u3 + t * pz,
                    v1 + s * px,
                    v2 + s * py,
                    v3 + s * pz,
                    px + t * u1 + s * v1,
                    py + t * u2 + s * v2,
                    pz + t * u3 + s * v3,
                )
                break
        xy, total = u1 * px + u2 * py + u3 * pz, uu + pp
        twice = 2.0 * xy
        t = -twice / (total + sqrt((total - twice) * (total + twice)))
        c = 1.0 / sqrt((1.0 - t) * (1.0 + t))
        s, change = t * c, t * xy
        uu, pp = uu + change, pp + change
        u1, px, u2, py = c * u1 + s * px, s * u1 + c * px, c * u2 + s * py, s * u2 + c * py
        u3, pz = c * u3 + s * pz, s * u3 + c * pz
        xy, total = v1 * px + v2 * py + v3 * pz, vv + pp
        twice = 2.0 * xy
        t = -twice / (total + sqrt((total - twice) * (total + twice)))
        c = 1.0 / sqrt((1.0 - t) * (1.0 + t))
        s, change = t * c, t * xy
        vv, pp = vv + change, pp + change
        v1, px, v2, py = c * v1 + s * px, s * v1 + c * px, c * v2 + s * py, s * v2 + c * py
        v3, pz = c * v3 + s * pz, s * v3 + c * pz
        uu, vv, xy = u1 * u1 + u2 * u2 + u3 * u3, v1 * v1 + v2 * v2 + v3 * v3, u1 * v1 + u2 * v2 + u3 * v3
        gap, twice = vv - uu, 2.0 * xy
        t = copysign(1.0, gap) * twice / (fabs(gap) + sqrt(gap * gap + twice * twice) + NOTHING)
        c = 1.0 / sqrt(1.0 + t * t)
        s, change = t * c, t * xy
        uu, vv = uu - change, vv + change
        u1, v1, u2, v2 = c * u1 - s * v1, s * u1 + c * v1, c * u2 - s * v2, s * u2 + c * v2
        u3, v3 = c * u3 - s * v3, s * u3 + c * v3
    else:
        return None
    if not (uu > 0.0 and vv > 0.0):
        return None
    if uu < vv:
        uu, vv, v1, v2, v3 = vv, uu, u1, u2, u3
    return _candidates(sqrt(px * px + py * py + pz * pz), sqrt(uu), sqrt(vv), (px, py, pz), (v1, v2, v3), radius)


def _candidates(s1: float, s2: float, s3: float, p: Triple, v: Triple, radius: float) -> Pair:
    axis, side = copysign(1.0 / s1, p[2]), copysign(1.0 / s3, v[2])
    e1x, e1y, e1z = p[0] * axis, p[1] * axis, p[2] * axis
    e3x, e3y, e3z = v[0] * side, v[1] * side, v[2] * side
    below = s2 * sqrt(s1 * s1 + s3 * s3)
    c = s3 * sqrt(s1 * s1 + s2 * s2) / below
    s = s1 * sqrt((s2 - s3) * (s2 + s3)) / below
    if s * e3z <= TIE / 2.0 and (s * e3x > 0.0 if fabs(s * e3x) > TIE / 2.0 else s * e3y > TIE / 2.0):
        s = -s
    along, across = radius * (c * s1 / s3), radius * (s * s3 / s1)
    ax, ay, az, bx, by, bz = c * e1x, c * e1y, c * e1z, s * e3x, s * e3y, s * e3z
    normals = (-ax - bx, -ay - by, -az - bz), (-ax + bx, -ay + by, -az + bz)
    ax, ay, az, bx, by, bz = along * e1x, along * e1y, along * e1z, across * e3x, across * e3y, across * e3z
    return normals, ((ax - bx, ay - by, az - bz), (ax + bx, ay + by, az + bz))
