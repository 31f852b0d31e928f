"""OpenCV's lens model on normalised coordinates: forward with its Jacobian, its field, and the exact inverse.

    u = r^2 = x^2 + y^2
    R = (1 + k1 u + k2 u^2 + k3 u^3) / (1 + k4 u + k5 u^2 + k6 u^3)
    x' = x R + 2 p1 x y + p2 (u + 2 x^2) + s1 u + s2 u^2
    y' = y R + p1 (u + 2 y^2) + 2 p2 x y + s3 u + s4 u^2
    (x'', y'', 1) ~ T (x', y', 1)

T is the homography of the sensor tilted by tx and ty (radians) about its own axes, scaled so that the axis is fixed.
Source: OpenCV, module calib3d, "Detailed description"; order k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty.

A polynomial describes a lens only as far out as it increases: where the determinant of the Jacobian first vanishes on
the way from the axis, the image folds over itself, and a point beyond would be imaged on top of another. That limit is
the edge of the *field*. Points beyond it have no image here, and the inverse never returns them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Coefficients = tuple[float, ...]

_TERMS = 14

# The field's edge is searched in this many directions, on this many radii out to 89.9 degrees, denser near the axis.
# It is interpolated between directions: decentring moves it by about 1e-2 with the cosine of the direction, so the
# error is below 1e-4 of it. `inside` also checks the determinant itself.
_DIRECTIONS = 32
_RADII = 512
_WIDEST = np.radians(89.9)
_BISECTIONS = 40

# Starting from the table, Newton's method needs three or four steps. Near the edge of the field each step only halves
# the error, and sixty halvings reduce it to rounding.
_PLAIN_STEPS = 6
_GUARDED_STEPS = 60
_SMALLEST_PART = 1e-12
# Residual due to rounding, relative to the point; 1e-12 is 1e-9 px at a focal length of 1,000 px.
_RESIDUAL = 1e-12
_ROUNDING = 4e-16


def _padded(coefficients: Coefficients) -> Coefficients:
    return tuple(coefficients) + (0.0,) * (_TERMS - len(coefficients))


def tilt_matrix(tx_rad: float, ty_rad: float) -> Array:
    """Homography of the tilted sensor, (3, 3).

    T = [[R22, 0, -R02], [0, R22, -R12], [0, 0, 1]] R with R = R_y(ty) R_x(tx): the axis keeps its image.
    """
    cx, sx, cy, sy = np.cos(tx_rad), np.sin(tx_rad), np.cos(ty_rad), np.sin(ty_rad)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]])
    about_y = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
    r = about_y @ about_x
    onto_sensor = np.array([[r[2, 2], 0.0, -r[0, 2]], [0.0, r[2, 2], -r[1, 2]], [0.0, 0.0, 1.0]])
    return np.asarray(onto_sensor @ r, dtype=np.float64)


def _bend(coefficients: Coefficients, x: Array, y: Array) -> tuple[Array, Array, tuple[Array, ...]]:
    """Everything except the tilt: x', y', and the Jacobian row by row; zero coefficients cost nothing."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, *_ = _padded(coefficients)
    u = x * x + y * y
    radial = 1 + u * (k1 + u * (k2 + u * k3))
    # d radial / d u, doubled because du = 2 (x dx + y dy).
    slope = 2 * k1 + u * (4 * k2 + u * (6 * k3))
    if k4 or k5 or k6:
        below = 1 + u * (k4 + u * (k5 + u * k6))
        radial = radial / below
        slope = (slope - radial * (2 * k4 + u * (4 * k5 + u * (6 * k6)))) / below
    # The decentring's x' and y' are x and y times this, plus a share of u.
    decentring = 2 * (p1 * y + p2 * x)
    along = radial + decentring
    out_x, out_y = x * along + p2 * u, y * along + p1 * u
    cross = x * y * slope + 2 * (p1 * x + p2 * y)
    xx = along + x * x * slope + 4 * p2 * x
    yy = along + y * y * slope + 4 * p1 * y
    if not (s1 or s2 or s3 or s4):
        return out_x, out_y, (xx, cross, cross, yy)
    prism_x, prism_y = 2 * s1 + u * (4 * s2), 2 * s3 + u * (4 * s4)
    jacobian = (xx + prism_x * x, cross + prism_x * y, cross + prism_y * x, yy + prism_y * y)
    return out_x + u * (s1 + u * s2), out_y + u * (s3 + u * s4), jacobian


def _tilted(homography: Array, xy: Array) -> tuple[Array, Array]:
    """A homography of points (..., 2), and its Jacobian (..., 2, 2); NaN at and behind its horizon."""
    h = homography
    w = h[2, 0] * xy[..., 0] + h[2, 1] * xy[..., 1] + h[2, 2]
    w = np.where(w > 0, w, np.nan)[..., None]
    out = (xy @ h[:2, :2].T + h[:2, 2]) / w
    jacobian = (h[:2, :2] - out[..., :, None] * h[2, :2]) / w[..., None]
    return out, jacobian


def _determinant(jacobian: Sequence[Array]) -> Array:
    a, b, c, d = jacobian
    return a * d - b * c


@dataclass(frozen=True)
class Field:
    """Field of a set of coefficients: how far out they describe a lens.

    Attributes
    ----------
    edge : (n,) array
        Undistorted radius of the edge in n directions evenly spaced from +x toward +y, the first repeated at the end;
        infinite if there is no edge.
    radius, image : (m,) arrays
        The radial part R alone: undistorted radii and their images, increasing; the initial guess of the inverse.
    """

    edge: Array
    radius: Array
    image: Array


@lru_cache(maxsize=64)
def field_of(coefficients: Coefficients) -> Field:
    """The field of a set of coefficients; the tilt does not limit it."""
    c = _padded(coefficients)
    symmetric = not any((c[2], c[3], *c[8:12]))
    radius = np.tan(_WIDEST * np.linspace(0.0, 1.0, _RADII) ** 2)
    direction = np.arange(1 if symmetric else _DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    unit = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    pole = _first_pole(c)

    def sound(which: NDArray[np.int64], r: Array) -> Array:
        """Positive where directions `which` (n,) at radii (n, m) are inside the field."""
        *_, jacobian = _bend(c, r * unit[which, :1], r * unit[which, 1:])
        return np.where(r < pole, _determinant(jacobian), -1.0)

    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        edge = _first_zero(radius, len(unit), sound)
        one = (c[0], c[1], 0.0, 0.0, *c[4:8])
        image, *_ = _bend(one, radius, np.zeros_like(radius))
    growing = np.concatenate([[True], (np.diff(image) > 0) & (radius[1:] < pole)])
    last = len(radius) if growing.all() else int(np.argmin(growing))
    edge = np.full(_DIRECTIONS + 1, edge[0]) if symmetric else np.append(edge, edge[0])
    return Field(edge, radius[:last], image[:last])


def _first_pole(c: Coefficients) -> float:
    """Radius at which the denominator of R first vanishes; infinite if it never does."""
    # As a polynomial in 1 / u: its leading coefficient is always 1, and the largest root is the one needed.
    roots = np.roots([1.0, c[5], c[6], c[7]])
    # The root finder returns a double root as a pair with small imaginary parts; it is still a pole.
    real = roots.real[(np.abs(roots.imag) < 1e-6 * np.abs(roots)) & (roots.real > 0)]
    return float(real.max()) ** -0.5 if len(real) else np.inf


def _first_zero(radius: Array, count: int, function: Callable[[NDArray[np.int64], Array], Array]) -> Array:
    """Least radius (count,) at which a function of direction and radius is not positive; infinite if none."""
    every = np.arange(count)
    value = function(every, np.broadcast_to(radius, (count, len(radius))))
    bad = ~(value > 0)
    # Between two samples the function may dip to zero and rise again: refine around every local minimum.
    which, column = np.nonzero((value[:, 1:-1] < value[:, :-2]) & (value[:, 1:-1] <= value[:, 2:]))
    if len(which):
        closely = np.linspace(radius[column], radius[column + 2], 65, axis=1)
        bad[which, column + 1] |= ~(function(which, closely) > 0).all(axis=1)
    first = np.argmax(bad, axis=1)
    low, high = radius[np.maximum(first - 1, 0)], radius[first]
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        positive = function(every, middle[:, None])[:, 0] > 0
        low, high = np.where(positive, middle, low), np.where(positive, high, middle)
    return np.where(bad.any(axis=1), low, np.inf)


def inside(coefficients: Coefficients, x: Array, y: Array) -> NDArray[np.bool_]:
    """Which undistorted points are in the field, ignoring the tilt's horizon."""
    edge = field_of(coefficients).edge
    nearest = float(edge.min())
    r2 = x * x + y * y
    near = np.asarray(r2 < nearest * nearest)
    if not np.isfinite(nearest) or near.all():
        return near
    step = np.mod(np.arctan2(y, x) * (_DIRECTIONS / (2 * np.pi)), _DIRECTIONS)
    limit = np.interp(step, np.arange(_DIRECTIONS + 1), edge)
    return np.asarray(near | (r2 < limit * limit), dtype=bool)


def distort(coefficients: Coefficients, xy: Array) -> tuple[Array, Array]:
    """Image of normalised coordinates, and the Jacobian.

    Parameters
    ----------
    coefficients : tuple of float
        OpenCV's, in OpenCV's order; missing ones of the 14 are zero.
    xy : (..., 2) array

    Returns
    -------
    distorted : (..., 2) array
    jacobian : (..., 2, 2) array
        d distorted / d xy. Both are NaN outside the field.
    """
    *_, tx, ty = _padded(coefficients)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x, y, rows = _bend(coefficients, xy[..., 0], xy[..., 1])
        good = inside(coefficients, xy[..., 0], xy[..., 1]) & (_determinant(rows) > 0)
        out, jacobian = np.stack([x, y], axis=-1), np.stack(rows, axis=-1).reshape(*xy.shape, 2)
        if tx or ty:
            out, outer = _tilted(tilt_matrix(tx, ty), out)
            jacobian = outer @ jacobian
    return np.where(good[..., None], out, np.nan), np.where(good[..., None, None], jacobian, np.nan)


def undistort(coefficients: Coefficients, xy: Array) -> Array:
    """The inverse of `distort`: normalised coordinates (..., 2), NaN where no point of the field is imaged.

    The tilt is inverted exactly. For the rest a table of R gives the initial guess for Newton's method. Each image has
    one point in the field at most: a solution inside the field is the answer, and one outside is discarded.
    """
    *_, tx, ty = _padded(coefficients)
    target = np.asarray(xy, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if tx or ty:
            target, _ = _tilted(np.asarray(np.linalg.inv(tilt_matrix(tx, ty)), dtype=np.float64), target)
        x, y = target[..., 0].ravel(), target[..., 1].ravel()
        out = np.stack(_plain_newton(coefficients, x, y), axis=-1)
        # Near the edge of the field a full step may leave it, so steps are damped there.
        open_ = np.isnan(out[:, 0]) & np.isfinite(x) & np.isfinite(y)
        out[open_] = np.stack(_guarded_newton(coefficients, x[open_], y[open_]), axis=-1)
    return out.reshape(target.shape)


def _solved(
    coefficients: Coefficients, x: Array, y: Array, jacobian: Sequence[Array], error: Array, unit: Array
) -> tuple[Array, Array]:
    good = (error < _RESIDUAL * unit) & (_determinant(jacobian) > 0) & inside(coefficients, x, y)
    return np.where(good, x, np.nan), np.where(good, y, np.nan)


def _plain_newton(coefficients: Coefficients, target_x: Array, target_y: Array) -> tuple[Array, Array]:
    """Newton's method with full steps; NaN where it did not converge."""
    unit = 1 + np.abs(target_x) + np.abs(target_y)
    x, y = _start(coefficients, target_x, target_y)
    for _ in range(_PLAIN_STEPS):
        value_x, value_y, jacobian = _bend(coefficients, x, y)
        miss_x, miss_y = target_x - value_x, target_y - value_y
        error = np.hypot(miss_x, miss_y)
        if not np.any(error > _ROUNDING * unit):
            break
        a, b, c, d = jacobian
        determinant = a * d - b * c
        x, y = x + (d * miss_x - b * miss_y) / determinant, y + (a * miss_y - c * miss_x) / determinant
    return _solved(coefficients, x, y, jacobian, error, unit)


def _guarded_newton(coefficients: Coefficients, target_x: Array, target_y: Array) -> tuple[Array, Array]:
    """Newton's method with steps shortened where they would leave the field or increase the residual."""
    unit, part = 1 + np.abs(target_x) + np.abs(target_y), np.ones_like(target_x)
    x, y = _start(coefficients, target_x, target_y)
    value_x, value_y, jacobian = _bend(coefficients, x, y)
    miss = np.stack([target_x - value_x, target_y - value_y])
    for _ in range(_GUARDED_STEPS):
        a, b, c, d = jacobian
        factor = part / (a * d - b * c)
        new_x, new_y = x + (d * miss[0] - b * miss[1]) * factor, y + (a * miss[1] - c * miss[0]) * factor
        value_x, value_y, slopes = _bend(coefficients, new_x, new_y)
        rest = np.stack([target_x - value_x, target_y - value_y])
        better = np.hypot(*rest) < np.hypot(*miss)
        better &= (_determinant(slopes) > 0) & inside(coefficients, new_x, new_y)
        x, y, miss = np.where(better, new_x, x), np.where(better, new_y, y), np.where(better, rest, miss)
        jacobian = tuple(np.where(better, new, old) for new, old in zip(slopes, jacobian, strict=True))
        part = np.where(better, np.minimum(1.0, 2 * part), part / 4)
        if not np.any((np.hypot(*miss) > _ROUNDING * unit) & (part > _SMALLEST_PART)):
            break
    return _solved(coefficients, x, y, jacobian, np.hypot(*miss), unit)


def _start(coefficients: Coefficients, target_x: Array, target_y: Array) -> tuple[Array, Array]:
    """The point in the same direction whose radial image is the target's radius, moved into the field."""
    field = field_of(coefficients)
    radius = np.hypot(target_x, target_y)
    factor = np.where(radius > 0, np.interp(radius, field.image, field.radius) / np.where(radius > 0, radius, 1.0), 1.0)
    for _ in range(8):
        outside = ~inside(coefficients, target_x * factor, target_y * factor)
        if not outside.any():
            break
        factor = np.where(outside, 0.9 * factor, factor)
    return target_x * factor, target_y * factor
