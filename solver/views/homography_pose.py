"""Pose and focal length of a printed plane from a measured homography with covariance.

The plane has coordinates (X, Y) in outer radii, X right and Y up; a homography H takes (X, Y, 1) to undistorted pixels.
Near a measured H0 every homography is H0 (I + sum_k delta_k G_k) up to scale, with the eight generators `GENERATORS`; a
measurement is H0 with the covariance of delta. The last generator is the rotation in the plane, which concentric
circles do not show: they measure the first seven.

A camera with square pixels, a known principal point and u = 1 / f images the plane, about that point, as

    x = (s (r11 X + r12 Y) + x0) / (1 + s u (r31 X + r32 Y)),   y likewise,

with a rotation (r_ij), the scale s = f / t_z and the image (x0, y0) of the origin. All of it is regular in u, a distant
focal length (u = 0) included, and that is why the least squares are in u and not in f: their deviation is
chi2(u) = min over rotation, s, x0, y0 of delta^T Cov^-1 delta.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.solver.pose.circle_pose import poses_from_conic

Array = NDArray[np.float64]

ROTATION = 7  # index of the generator of the rotation in the plane
_AT = (
    ((0, 2, 1.0),),
    ((1, 2, 1.0),),
    ((0, 0, 1.0), (1, 1, 1.0)),
    ((0, 0, 1.0), (1, 1, -1.0)),
    ((0, 1, 1.0), (1, 0, 1.0)),
    ((2, 0, 1.0),),
    ((2, 1, 1.0),),
    ((0, 1, -1.0), (1, 0, 1.0)),
)

_STEPS = 40
_SETTLED, _ROUGHLY = 1e-11, 1e-4  # steps: radians, and fractions of the scale
_CHI2_95 = 3.841459  # of one degree of freedom
_SIGMAS_95 = 1.959964
_LONGEST = 30.0  # times the image's width: longer focal lengths are not searched
_SHORTEST = 0.15
_GRID = 7


def _generators() -> Array:
    out = np.zeros((8, 3, 3))
    for k, entries in enumerate(_AT):
        for i, j, value in entries:
            out[k, i, j] = value
    return out


GENERATORS = _generators()


@dataclass(frozen=True, eq=False)
class MeasuredHomography:
    """A homography from the plane to undistorted pixels, with covariance.

    Attributes
    ----------
    matrix : (3, 3) array
    cov : (7, 7) or (8, 8) array
        Of the coordinates of the first seven or of all eight generators.
    """

    matrix: Array
    cov: Array

    @property
    def turns(self) -> bool:
        """Whether the rotation in the plane is measured, too."""
        return len(self.cov) == len(GENERATORS)


@dataclass(frozen=True, eq=False)
class PlanePose:
    """A pose that explains a homography.

    Attributes
    ----------
    rotation : (3, 3) array
        Marker to camera; only its normal matters if the rotation in the plane is not measured.
    centre : (3,) array
        In outer radii, camera frame.
    focal_px : float
        Focal length fx for which it holds.
    chi2 : float
        Its deviation from the measurement.
    """

    rotation: Array
    centre: Array
    focal_px: float
    chi2: float

    @property
    def normal(self) -> Array:
        """Unit vector out of the printed face, (3,)."""
        return self.rotation[:, 2].copy()


@dataclass(frozen=True)
class FocalMeasurement:
    """A focal length from one image alone: the best one, and the standard deviation that its interval stands for."""

    focal_px: float
    sigma_px: float


def moved(matrix: Array, delta: Array) -> Array:
    """H (I + sum_k delta_k G_k), (3, 3)."""
    return np.asarray(matrix @ (np.eye(3) + np.tensordot(delta, GENERATORS[: len(delta)], axes=1)))


def homography_of(conic: Array, centre_px: Array) -> Array:
    """Homography that takes the unit circle to a conic and the origin to the image of its centre; rotation arbitrary.

    H = A B: A takes the unit circle to the ellipse; B takes it to itself and the origin to w = A^-1 o, |w| < 1, like a
    Lorentz boost (B^T diag(1, 1, -1) B = diag(1, 1, -1)).

    Raises
    ------
    ValueError
        If the point is not inside the ellipse.
    """
    from roundel.scenes.geometry.conic import ellipse_of_conic

    x, y, a, b, angle = ellipse_of_conic(conic)
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    # Symmetric, so that two near ellipses have near homographies; mirrored, because Y is up.
    turn = np.array([[c, -s], [s, c]])
    shape = turn @ np.diag([a, b]) @ turn.T @ np.diag([1.0, -1.0])
    w = np.linalg.solve(shape, np.asarray(centre_px, dtype=np.float64) - (x, y))
    square = float(w @ w)
    if not square < 1.0:
        raise ValueError("the image of the centre must be inside the ellipse")
    gamma = 1.0 / math.sqrt(1.0 - square)
    boost = np.eye(3)
    boost[:2, :2] += np.outer(w, w) * gamma**2 / (gamma + 1.0)
    boost[:2, 2] = boost[2, :2] = gamma * w
    boost[2, 2] = gamma
    affine = np.eye(3)
    affine[:2, :2], affine[:2, 2] = shape, (x, y)
    out = affine @ boost
    return np.asarray(out / out[2, 2])


def coordinates(matrix: Array, other: Array, turns: bool) -> Array:
    """Coordinates of `other` about `matrix`, (8,) or (7,): without `turns` it is turned in the plane to fit first."""
    return _coordinates(np.asarray(np.linalg.solve(matrix, other), dtype=np.float64), turns)


def _coordinates(between: Array, turns: bool) -> Array:
    """Coordinates of H0^-1 H, in plain floats: arrays of three numbers would take ten times as long."""
    (a, b, tx), (c, d, ty), (px, py, w) = between.tolist()
    a, b, c, d, tx, ty, px, py = (v / w for v in (a, b, c, d, tx, ty, px, py))
    if turns:
        return np.array([tx, ty, (a + d) / 2 - 1, (a - d) / 2, (b + c) / 2, px, py, (c - b) / 2])
    length = math.hypot(c - b, a + d)
    cos, sin = (a + d) / length, (c - b) / length
    a, b, c, d = a * cos - b * sin, a * sin + b * cos, c * cos - d * sin, c * sin + d * cos
    px, py = px * cos - py * sin, px * sin + py * cos
    return np.array([tx, ty, (a + d) / 2 - 1, (a - d) / 2, (b + c) / 2, px, py])


@dataclass(frozen=True, eq=False)
class _State:
    rotation: Array
    scale: float
    origin: Array
    u: float

    def matrix(self) -> Array:
        """The homography but for the camera without its focal length, see `_axes`."""
        out = np.empty((3, 3))
        out[:, :2] = self.scale * self.rotation[:, :2]
        out[2] *= self.u
        out[:2, 2], out[2, 2] = self.origin, 1.0
        return out

    def moved(self, step: Array, turns: bool) -> _State:
        turned = np.array([step[0], step[1], step[5] if turns else 0.0])
        u = self.u + (float(step[-1]) if len(step) == 6 + turns else 0.0)
        scale = self.scale * math.exp(float(np.clip(step[2], -1.0, 1.0)))
        return _State(self.rotation @ _rotation(turned), scale, self.origin + step[3:5], u)

    def pose(self, chi2: float) -> PlanePose:
        depth = 1.0 / (self.u * self.scale)
        x, y = self.origin * self.u * depth
        return PlanePose(self.rotation, np.array([x, y, depth]), 1.0 / self.u, chi2)


def _rotation(vector: Array) -> Array:
    x, y, z = vector.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-8:
        return np.asarray(np.eye(3) + cross + cross @ cross / 2)
    return np.asarray(np.eye(3) + math.sin(angle) / angle * cross + (1 - math.cos(angle)) / angle**2 * cross @ cross)


def _axes(K: Array) -> Array:
    """The camera without its focal length: principal point, skew and the ratio of fy to fx."""
    out = np.array(K, dtype=np.float64)
    out[:2, :2] /= K[0, 0]
    return out


class _Problem:
    """Least squares of a measured homography: residuals of unit variance."""

    def __init__(self, measured: MeasuredHomography, K: Array) -> None:
        self.turns = measured.turns
        self.from_camera = np.linalg.solve(measured.matrix, _axes(K))
        scale = np.sqrt(np.diag(measured.cov))
        factor = np.linalg.cholesky(measured.cov / np.outer(scale, scale))
        self.whiten = np.linalg.inv(factor) / scale

    def residual(self, state: _State) -> Array:
        return np.asarray(self.whiten @ _coordinates(self.from_camera @ state.matrix(), self.turns), dtype=np.float64)

    def best(self, state: _State, free_focal: bool, settled_at: float = _SETTLED) -> tuple[_State, float]:
        """Levenberg-Marquardt from a state to steps below `settled_at`; with `free_focal` u is a parameter, too."""
        size = 5 + self.turns + free_focal
        # The steps of difference quotients: rad, log scale, px, 1/px.
        unit = np.concatenate([[1.0, 1.0, 1.0], np.full(2, state.scale), np.ones(int(self.turns)), [0.3 / state.scale]])
        unit = unit[:size]
        residual = self.residual(state)
        damping = 1e-4
        for _ in range(_STEPS):
            steps = 1e-6 * np.diag(unit)
            ahead = np.stack([self.residual(state.moved(step, self.turns)) for step in steps], axis=1)
            jacobian = (ahead - residual[:, None]) / 1e-6
            normal, lean = jacobian.T @ jacobian, jacobian.T @ residual
            settled = False
            for _ in range(12):
                step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-30), lean)
                other = state.moved(step * unit, self.turns)
                trial = self.residual(other)
                if trial @ trial <= residual @ residual:
                    settled = bool(np.abs(step).max() < settled_at)
                    state, residual, damping = other, trial, max(damping / 10, 1e-14)
                    break
                damping *= 10
            else:
                settled = True
            if settled:
                break
        return state, float(residual @ residual)


def _starts(measured: MeasuredHomography, K: Array, focal_px: float) -> list[_State]:
    """Both poses of the outer circle for a focal length, turned in the plane as the homography is."""
    camera = _axes(K)
    full = camera @ np.diag([focal_px, focal_px, 1.0])
    inverse = np.linalg.inv(measured.matrix)
    poses = poses_from_conic(-inverse.T @ np.diag([1.0, 1.0, -1.0]) @ inverse, full, 1.0)
    out = []
    for normal, centre in zip(poses.normal, poses.centre_m, strict=True):
        rays = np.linalg.solve(full, measured.matrix)
        # X of the plane: the image of its point (1, 0) seen from the centre's, in the plane of this pose.
        point = rays[:, 0] + rays[:, 2]
        reached = point * float(normal @ centre) / float(normal @ point) - centre
        x_axis = reached - normal * float(normal @ reached)
        x_axis = x_axis / np.linalg.norm(x_axis)
        rotation = np.stack([x_axis, np.cross(normal, x_axis), normal], axis=1)
        scale = focal_px / float(centre[2])
        out.append(_State(rotation, scale, focal_px * centre[:2] / centre[2], 1.0 / focal_px))
    return out


def poses_of_homography(measured: MeasuredHomography, K: Array) -> list[PlanePose]:
    """Both poses for a known camera, the better explanation first.

    Parameters
    ----------
    measured : MeasuredHomography
    K : (3, 3) array

    Returns
    -------
    list of PlanePose
        The minima reached from both poses of the outer circle, which may be one. Where they are two, a `chi2` of the
        second that is hardly larger says that the measurement cannot tell them apart.
    """
    problem = _Problem(measured, K)
    found = [problem.best(state, False) for state in _starts(measured, K, float(K[0, 0]))]
    return sorted((state.pose(chi2) for state, chi2 in found), key=lambda pose: pose.chi2)


def focal_of_homography(measured: MeasuredHomography, K: Array, width_px: int) -> FocalMeasurement | None:
    """The focal length that a homography alone says, for square pixels and the camera's principal point.

    The standard deviation is that of log f: the longer side of the interval of 95 % (chi2 above its least value by
    3.84), divided by 1.96. Where chi2 does not bound f on both sides the image says nothing, as at low tilt.

    Parameters
    ----------
    measured : MeasuredHomography
    K : (3, 3) array
        Its focal length is not used, but the ratio of its two.
    width_px : int
        Width of the image: focal lengths from 0.15 to 30 times that are searched.

    Returns
    -------
    FocalMeasurement or None
    """
    problem = _Problem(measured, K)
    low, high = 1.0 / (_LONGEST * width_px), 1.0 / (_SHORTEST * width_px)

    def at(u: float) -> tuple[float, _State]:
        """chi2 for one u, and the pose there."""
        tried = [problem.best(start, False, _ROUGHLY) for start in _starts(measured, K, 1.0 / u)]
        return min(((chi2, state) for state, chi2 in tried), key=lambda pair: pair[0])

    grid = [at(float(u)) for u in np.geomspace(low, high, _GRID)]
    best, least = problem.best(min(grid, key=lambda pair: pair[0])[1], True)
    if not low < best.u < high:
        return None

    def above(u: float) -> float:
        return at(u)[0] - least - _CHI2_95

    if above(low) <= 0 or above(high) <= 0:
        return None
    # The nearest of the tried values that is excluded bounds the search for the end of the interval.
    us = np.geomspace(low, high, _GRID)
    out = [float(u) for u, (chi2, _) in zip(us, grid, strict=True) if chi2 - least > _CHI2_95]
    lower = _root(above, best.u, max(u for u in out if u < best.u))
    upper = _root(above, best.u, min(u for u in out if u > best.u))
    sigma = max(math.log(upper / best.u), math.log(best.u / lower)) / _SIGMAS_95
    return FocalMeasurement(1.0 / best.u, sigma / best.u)


def _root(function: Callable[[float], float], inside: float, outside: float) -> float:
    """Where a function of u becomes positive between two values, to 4 % of the distance of their logarithms."""
    near, far = math.log(inside), math.log(outside)
    start = near
    # The function grows about as the square of the distance.
    value_near, value_far = function(inside), function(outside)
    for _ in range(30):
        lean = value_near / (value_near - value_far)
        middle = near + (far - near) * min(max(math.sqrt(lean) if near == start else lean, 0.05), 0.95)
        value = function(math.exp(middle))
        if value > 0:
            far, value_far = middle, value
        else:
            near, value_near = middle, value
        if abs(far - near) < 0.04 * abs(far - start) or abs(value) < 0.15:
            return math.exp(middle)
    return math.exp(far)
