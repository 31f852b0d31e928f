"""The two poses of a circle of known radius from its image, in closed form.

All solutions are returned and none is chosen: choosing is `solver.choose`'s business.

The cone over the image ellipse {c + S u, |u| = 1} has the dual A^-1 = p p^T - W W^T with p = K^-1 [c; 1] and
W = K^-1 [S; 0] (errata, section 2). The 3x3 matrix M = [W p] is made orthogonal column by column with rotations that
keep J = diag(-1, -1, 1): a one-sided Jacobi method (hyperbolic singular values). A^-1 = M J M^T never has to be
formed, so the small eigenvalues of an ellipse of 1e-5 px keep all their digits, which the eigenvalues of
K^T C K lose (the errata measured 14 % there).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Jacobi's method doubles its digits a sweep once it is close: well-shaped cones take 3 to 5 sweeps, none takes 40.
_MAX_SWEEPS = 40

# Two normals whose z differ by less than this are tied: it is rounding, and must not decide an order.
_TIE = 1e-12


@dataclass(frozen=True)
class CirclePoses:
    """Both poses that explain one image of a circle.

    Attributes
    ----------
    normal : (..., 2, 3) array
        Unit normals out of the printed face, in the camera frame. Index 0 has the smaller normal_z (closer to
        fronto-parallel; the errata's candidate `+`); at a tie, the larger normal_x.
    centre_m : (..., 2, 3) array
        Centres of the circle in the camera frame, metres.
    """

    normal: Array
    centre_m: Array


def poses_from_conic(conic: ArrayLike, K: ArrayLike, radius_m: ArrayLike) -> CirclePoses:
    """Both poses of a circle from the conic of its image.

    A conic in float64 pixels holds an ellipse of semi-axis a px at d px from the origin only to about
    1e-16 (d / a)^2: for very small ellipses call `poses_from_ellipse`, which has no such loss.

    Parameters
    ----------
    conic : (..., 3, 3) array_like
        In undistorted pixel coordinates, of any scale and sign.
    K : (3, 3) array_like
        Calibration matrix, pixels; skew and unequal focal lengths are welcome.
    radius_m : (...) array_like

    Returns
    -------
    CirclePoses

    Raises
    ------
    ValueError
        If a conic is not an ellipse, K is singular, a radius is not positive, or a number is not finite.
    """
    centre, shape = _ellipse_of_conic(np.asarray(conic, dtype=np.float64))
    return _poses(centre, shape, _calibration(K), _radius(radius_m))


def poses_from_ellipse(ellipse: ArrayLike, K: ArrayLike, radius_m: ArrayLike) -> CirclePoses:
    """Both poses of a circle from the parameters of its image, to full accuracy at any size.

    Parameters
    ----------
    ellipse : (..., 5) array_like
        x_px, y_px, a_px, b_px (semi-axes, in any order), angle_deg from +x toward +y; undistorted pixel coordinates.
    K : (3, 3) array_like
    radius_m : (...) array_like

    Returns
    -------
    CirclePoses

    Raises
    ------
    ValueError
        As `poses_from_conic`.
    """
    e = np.asarray(ellipse, dtype=np.float64)
    if e.ndim == 0 or e.shape[-1] != 5:
        raise ValueError(f"an ellipse has five parameters in its last axis; this array has shape {e.shape}")
    if not np.all(np.isfinite(e)):
        raise ValueError("the ellipse holds a number that is not finite")
    if not np.all(e[..., 2:4] > 0):
        raise ValueError("not an ellipse: both semi-axes must be positive")
    angle = np.radians(e[..., 4])
    cos, sin = np.cos(angle), np.sin(angle)
    shape = np.stack([np.stack([cos, sin], -1) * e[..., 2:3], np.stack([-sin, cos], -1) * e[..., 3:4]], axis=-1)
    return _poses(e[..., :2], shape, _calibration(K), _radius(radius_m))


def _radius(radius_m: ArrayLike) -> Array:
    radius = np.asarray(radius_m, dtype=np.float64)
    if not np.all(np.isfinite(radius) & (radius > 0)):
        raise ValueError("the radius must be a positive, finite number of metres")
    return radius


def _calibration(K: ArrayLike) -> Array:
    k = np.asarray(K, dtype=np.float64)
    if k.shape != (3, 3):
        raise ValueError(f"K must be one 3x3 matrix; this one has shape {k.shape}")
    if not np.all(np.isfinite(k)):
        raise ValueError("K holds a number that is not finite")
    if np.any(k[2, :2] != 0.0) or k[1, 0] != 0.0:
        raise ValueError("K must be upper triangular, as [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]")
    if np.any(np.diag(k) == 0.0):
        raise ValueError("K is singular: its focal lengths and its last element must not be zero")
    return np.asarray(k / k[2, 2])


def _ellipse_of_conic(conic: Array) -> tuple[Array, Array]:
    """Centre (..., 2) and a factor S (..., 2, 2) of the shape: the ellipse is {centre + S u, |u| = 1}."""
    if conic.ndim < 2 or conic.shape[-2:] != (3, 3):
        raise ValueError(f"a conic is a 3x3 matrix; this array has shape {conic.shape}")
    if not np.all(np.isfinite(conic)):
        raise ValueError("the conic holds a number that is not finite")
    norm = np.linalg.norm(conic, axis=(-2, -1), keepdims=True)
    if np.any(norm == 0.0):
        raise ValueError("not an ellipse: the conic is the zero matrix")
    # The elements of a conic hold the pose to 1e-15, but centre and determinant are differences that lose up to seven
    # digits for a thin, far ellipse: the wider float of x86 (64 bits of mantissa) takes three of them back.
    c = conic.astype(np.longdouble)
    c = (c + np.swapaxes(c, -2, -1)) / (2.0 * norm)
    q11, q12, q22 = c[..., 0, 0], c[..., 0, 1], c[..., 1, 1]
    sign = np.where(q11 + q22 < 0, -1.0, 1.0)
    q11, q12, q22 = sign * q11, sign * q12, sign * q22
    linear, corner = sign[..., None] * c[..., :2, 2], sign * c[..., 2, 2]
    determinant = q11 * q22 - q12 * q12
    if not np.all((determinant > 0) & (q11 > 0)):
        raise ValueError("not an ellipse: the conic is a hyperbola, a parabola or a pair of lines")
    x = (q12 * linear[..., 1] - q22 * linear[..., 0]) / determinant
    y = (q12 * linear[..., 0] - q11 * linear[..., 1]) / determinant
    # Value at the centre, negative inside: (x - centre)^T Q (x - centre) = level.
    level = -(corner + linear[..., 0] * x + linear[..., 1] * y)
    if not np.all(level > 0):
        raise ValueError("not an ellipse: the conic has no real points, or only one")
    # S = sqrt(level) L^-T for Q = L L^T: any S with S S^T = level Q^-1 describes the same ellipse.
    l11 = np.sqrt(q11)
    l21, l22 = q12 / l11, np.sqrt(determinant / q11)
    zero = np.zeros_like(l11)
    shape = np.stack([np.stack([1.0 / l11, -l21 / (l11 * l22)], -1), np.stack([zero, 1.0 / l22], -1)], axis=-2)
    centre, factor = np.stack([x, y], axis=-1), shape * np.sqrt(level)[..., None, None]
    return centre.astype(np.float64), factor.astype(np.float64)


def _orthogonalise(columns: list[Array]) -> list[Array]:
    """Make w1, w2, p orthogonal without changing p p^T - w1 w1^T - w2 w2^T (one-sided J-Jacobi).

    Source: K. Veselic, A Jacobi eigenreduction algorithm for definite matrix pairs, Numer. Math. 64 (1993).
    """
    for _ in range(_MAX_SWEEPS):
        largest = 0.0
        for i, j, hyperbolic in ((0, 1, False), (0, 2, True), (1, 2, True)):
            x, y = columns[i], columns[j]
            xx, yy, xy = np.sum(x * x, -1), np.sum(y * y, -1), np.sum(x * y, -1)
            largest = max(largest, float(np.max(np.abs(xy) / np.sqrt(xx * yy), initial=0.0)))
            if hyperbolic:
                # x' = c x + s y, y' = s x + c y; tanh(2 theta) = -2 xy / (xx + yy), s / c = tanh theta.
                apart = np.sqrt(np.sum((x - y) ** 2, -1) * np.sum((x + y) ** 2, -1))
                t = -2.0 * xy / (xx + yy + apart)
                c = 1.0 / np.sqrt((1.0 - t) * (1.0 + t))
                s = back = t * c
            else:
                # x' = c x - s y, y' = s x + c y; tan(2 theta) = 2 xy / (yy - xx), the smaller angle.
                gap = yy - xx
                below = np.abs(gap) + np.hypot(gap, 2.0 * xy)
                t = np.where(gap < 0, -2.0, 2.0) * xy / np.where(below == 0.0, 1.0, below)
                c = 1.0 / np.sqrt(1.0 + t * t)
                s, back = -t * c, t * c
            columns[i] = c[..., None] * x + s[..., None] * y
            columns[j] = back[..., None] * x + c[..., None] * y
        if largest < 1e-15:
            break
    return columns


def _poses(centre: Array, shape: Array, k: Array, radius: Array) -> CirclePoses:
    """Errata, section 2, "Closed-form pose", with l1 = 1/s1^2, l2 = -1/s2^2, l3 = -1/s3^2 (up to one common scale)."""
    y, w_y = (centre[..., 1] - k[1, 2]) / k[1, 1], shape[..., 1, :] / k[1, 1]
    x = (centre[..., 0] - k[0, 2] - k[0, 1] * y) / k[0, 0]
    w_x = (shape[..., 0, :] - k[0, 1] * w_y) / k[0, 0]
    w = np.stack([w_x, w_y, np.zeros_like(w_x)], axis=-2)
    p = np.stack([x, y, np.ones_like(x)], axis=-1)
    u1, u2, u3 = _orthogonalise([w[..., 0], w[..., 1], p])
    first, second = np.linalg.norm(u1, axis=-1), np.linalg.norm(u2, axis=-1)
    larger_first = first >= second
    s2, s3 = np.where(larger_first, first, second), np.where(larger_first, second, first)
    s1 = np.linalg.norm(u3, axis=-1)
    e1 = u3 / s1[..., None]
    e1 = np.where(e1[..., 2:] < 0, -e1, e1)  # the axis of the cone runs through the ellipse: in front
    e3 = np.where(larger_first[..., None], u2, u1) / s3[..., None]
    e3 = np.where(e3[..., 2:] < 0, -e3, e3)

    along = np.sqrt(s1**2 + s3**2)
    cos = s3 * np.sqrt(s1**2 + s2**2) / (s2 * along)
    sin = s1 * np.sqrt((s2 - s3) * (s2 + s3)) / (s2 * along)
    # The errata's n points away from the camera; ours out of the print, to the camera.
    normal_axis, normal_side = -cos[..., None] * e1, sin[..., None] * e3
    centre_axis = (radius * cos * s1 / s3)[..., None] * e1
    centre_side = (radius * sin * s3 / s1)[..., None] * e3
    normal = np.stack(np.broadcast_arrays(normal_axis - normal_side, normal_axis + normal_side), axis=-2)
    centre_m = np.stack(np.broadcast_arrays(centre_axis - centre_side, centre_axis + centre_side), axis=-2)
    swap = _out_of_order(normal)[..., None, None]
    return CirclePoses(
        normal=np.where(swap, normal[..., ::-1, :], normal), centre_m=np.where(swap, centre_m[..., ::-1, :], centre_m)
    )


def _out_of_order(normal: Array) -> NDArray[np.bool_]:
    """Whether candidate 1 belongs first: smaller normal_z; at a tie larger normal_x, then larger normal_y."""
    dx, dy, dz = np.moveaxis(normal[..., 1, :] - normal[..., 0, :], -1, 0)
    tie_z, tie_x = np.abs(dz) <= _TIE, np.abs(dx) <= _TIE
    return np.asarray(np.where(tie_z, np.where(tie_x, dy > _TIE, dx > 0), dz < 0), dtype=np.bool_)
