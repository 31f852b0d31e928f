"""Ellipses from points: the direct fit as a start, the orthogonal-distance fit as the estimate.

With isotropic noise on the points the orthogonal-distance fit is the maximum-likelihood fit, and only the component of
the noise along the contour's normal matters (errata, section 6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.conic import ellipse_of_conic
from roundel.solver.foot_points import foot_points

Array = NDArray[np.float64]
Loss = Literal["none", "huber", "tukey"]

_MIN_POINTS = 6  # five parameters, and one point more to measure the residual with
_MAX_ITERATIONS = 50
# Tuning constants for 95 % efficiency on Gaussian noise: P. J. Huber, Robust Statistics (1981); Beaton & Tukey (1974).
_TUNING = {"huber": 1.345, "tukey": 4.685}


@dataclass(frozen=True, eq=False)
class EllipseFit:
    """An ellipse fitted to points.

    Attributes
    ----------
    ellipse : (5,) array
        x_px, y_px, a_px, b_px, angle_deg: semi-axes a >= b, angle from +x toward +y in [0, 180).
    cov : (5, 5) array
        Covariance of `ellipse`, in px and degrees. Near a circle the angle is undefined: its variance has no bound.
    sigma_px : float
        RMS of the residual along the normal, over n - 5 degrees of freedom.
    n : int
        Number of points.
    shape_cov : (5, 5) array
        Covariance of (x, y, S11, S12, S22), px, where the contour is {(x, y) + S u, |u| = 1} with S symmetric:
        regular for circles too, so errors are carried on with this one.
    residual_px : (n,) array
        Signed orthogonal distances, positive outside.
    """

    ellipse: Array
    cov: Array
    sigma_px: float
    n: int
    shape_cov: Array
    residual_px: Array


@dataclass(frozen=True)
class FailedFit:
    """A fit that has no answer: false, and it says why."""

    reason: str

    def __bool__(self) -> bool:
        return False


def direct_ellipse(points_px: ArrayLike) -> Array | FailedFit:
    """Direct least-squares fit, which always is an ellipse but shrinks under noise: a start for `fit_ellipse`.

    Source: R. Halir, J. Flusser, Numerically stable direct least squares fitting of ellipses, WSCG (1998).

    Parameters
    ----------
    points_px : (N, 2) array_like

    Returns
    -------
    (5,) array or FailedFit
        x_px, y_px, a_px, b_px, angle_deg.
    """
    points = np.asarray(points_px, dtype=np.float64)
    problem = _unusable(points)
    if problem:
        return FailedFit(problem)
    centroid = points.mean(axis=0)
    # Centred and scaled: the columns x^2 .. 1 then are of one size, and S3 is well conditioned.
    scale = float(np.sqrt(np.mean(np.sum((points - centroid) ** 2, axis=1)) / 2.0))
    if not scale > 0:
        return FailedFit("all points coincide")
    x, y = ((points - centroid) / scale).T
    d1, d2 = np.stack([x * x, x * y, y * y], axis=1), np.stack([x, y, np.ones_like(x)], axis=1)
    s1, s2, s3 = d1.T @ d1, d1.T @ d2, d2.T @ d2
    try:
        t = -np.linalg.solve(s3, s2.T)
    except np.linalg.LinAlgError:
        return FailedFit("the points lie on a line")
    m = (s1 + s2 @ t)[[2, 1, 0]] * np.array([[0.5], [-1.0], [0.5]])
    _, vectors = np.linalg.eig(m)
    v = np.real(vectors)
    elliptic = 4.0 * v[0] * v[2] - v[1] ** 2
    best = int(np.argmax(elliptic))
    if not elliptic[best] > 0:
        return FailedFit("no ellipse fits the points: they lie on a line or nearly so")
    q = v[:, best]
    f = t @ q
    conic = np.array([[q[0], q[1] / 2, f[0] / 2], [q[1] / 2, q[2], f[1] / 2], [f[0] / 2, f[1] / 2, f[2]]])
    try:
        ellipse = ellipse_of_conic(conic)
    except ValueError as error:
        return FailedFit(str(error))
    ellipse[:4] *= scale
    ellipse[:2] += centroid
    return ellipse


def fit_ellipse(
    points_px: ArrayLike,
    sigma_px: ArrayLike | None = None,
    start: ArrayLike | None = None,
    loss: Loss = "none",
    tolerance: float = 1e-8,
) -> EllipseFit | FailedFit:
    """Fit with the least sum of squared orthogonal distances (maximum likelihood for isotropic noise).

    Levenberg-Marquardt over (x, y, S11, S12, S22), contour {(x, y) + S u, |u| = 1}: regular for circles. With the foot
    point at u and the normal nu there, the signed distance d has the exact derivative -nu . d((x, y) + S u) at fixed u.

    Parameters
    ----------
    points_px : (N, 2) array_like
    sigma_px : (N,) array_like, optional
        Standard deviations of the points along the normal; only their ratios matter.
    start : (5,) array_like, optional
        An ellipse to start from; the direct fit if left out.
    loss : {"none", "huber", "tukey"}
        Robust loss on the distance over its scale (from the median); the covariance then is approximate.
    tolerance : float
        Steps smaller than this fraction of the points' extent end the iteration.

    Returns
    -------
    EllipseFit or FailedFit

    Raises
    ------
    ValueError
        If `loss` is unknown or `sigma_px` is not positive.
    """
    if loss not in ("none", *_TUNING):
        raise ValueError(f"unknown loss {loss!r}; use none, huber or tukey")
    points = np.asarray(points_px, dtype=np.float64)
    problem = _unusable(points)
    if problem:
        return FailedFit(problem)
    weights = np.ones(len(points))
    if sigma_px is not None:
        sigmas = np.broadcast_to(np.asarray(sigma_px, dtype=np.float64), weights.shape)
        if not np.all(np.isfinite(sigmas) & (sigmas > 0)):
            raise ValueError("sigma_px must be positive and finite for every point")
        weights = 1.0 / sigmas**2
        weights /= weights.mean()
    ellipse = direct_ellipse(points) if start is None else np.asarray(start, dtype=np.float64)
    if isinstance(ellipse, FailedFit):
        return ellipse
    origin = points.mean(axis=0)  # digits: far from the image's origin the centre would hide the small steps
    local = points - origin
    extent = float(np.max(np.abs(local)))
    theta = shape_of_ellipse(ellipse)
    theta[:2] -= origin

    damping = 1e-4
    distance, jacobian = _distance_and_jacobian(theta, local)
    for _ in range(_MAX_ITERATIONS):
        w = weights * _loss_weight(distance, loss)
        gradient, hessian = jacobian.T @ (w * distance), jacobian.T @ (w[:, None] * jacobian)
        cost = float(np.sum(w * distance**2))
        scale = np.diag(hessian).copy()
        scale[scale <= 0] = 1.0
        moved = False
        step = np.zeros(5)
        while damping < 1e10:
            try:
                step = np.asarray(-np.linalg.solve(hessian + damping * np.diag(scale), gradient), dtype=np.float64)
            except np.linalg.LinAlgError:  # points that do not determine an ellipse
                damping *= 10.0
                continue
            trial = theta + step
            if _is_ellipse(trial):
                new_distance, new_jacobian = _distance_and_jacobian(trial, local)
                if np.sum(w * new_distance**2) <= cost:
                    theta, distance, jacobian, moved = trial, new_distance, new_jacobian, True
                    damping = max(damping * 0.1, 1e-12)
                    break
            damping *= 10.0
        if not moved or np.max(np.abs(step)) < tolerance * extent:
            break
    if not np.max(np.abs(theta)) < 1e4 * extent:
        return FailedFit("the points do not bound an ellipse: the best fit grows without end")
    return _result(theta, origin, distance, jacobian, weights * _loss_weight(distance, loss))


def _result(theta: Array, origin: Array, distance: Array, jacobian: Array, w: Array) -> EllipseFit | FailedFit:
    try:
        inverse = np.asarray(np.linalg.inv(jacobian.T @ (w[:, None] * jacobian)), dtype=np.float64)
    except np.linalg.LinAlgError:
        return FailedFit("the points do not determine an ellipse")
    degrees = max(float(np.sum(w > 0)) - 5.0, 1.0)
    variance = float(np.sum(w * distance**2)) / degrees
    shape_cov = inverse * variance
    full = theta.copy()
    full[:2] += origin
    ellipse = ellipse_of_shape(full)
    to_ellipse = _ellipse_by_shape(ellipse)
    return EllipseFit(
        ellipse, to_ellipse @ shape_cov @ to_ellipse.T, float(np.sqrt(variance)), len(distance), shape_cov, distance
    )


def _unusable(points: Array) -> str:
    if points.ndim != 2 or points.shape[1] != 2:
        return f"points must be an (N, 2) array; this one has shape {points.shape}"
    if len(points) < _MIN_POINTS:
        return f"only {len(points)} points; an ellipse needs {_MIN_POINTS}"
    return "" if np.all(np.isfinite(points)) else "a point is not finite"


def _loss_weight(distance: Array, loss: Loss) -> Array:
    if loss == "none":
        return np.ones_like(distance)
    size = np.abs(distance)
    scale = 1.4826 * float(np.median(size)) * _TUNING[loss]  # 1.4826 makes the median the sigma of a Gaussian
    ratio = size / max(scale, 1e-12)
    if loss == "huber":
        return np.asarray(1.0 / np.maximum(ratio, 1.0))
    return np.asarray(np.where(ratio < 1.0, (1.0 - ratio**2) ** 2, 0.0))


def shape_of_ellipse(ellipse: ArrayLike) -> Array:
    """(..., 5) x, y, a, b, angle_deg to (..., 5) x, y, S11, S12, S22 with S = Rot diag(a, b) Rot^T."""
    x, y, a, b, angle = np.moveaxis(np.asarray(ellipse, dtype=np.float64), -1, 0)
    half, twice = (a - b) / 2, np.radians(2 * angle)
    mean = (a + b) / 2
    return np.stack([x, y, mean + half * np.cos(twice), half * np.sin(twice), mean - half * np.cos(twice)], axis=-1)


def ellipse_of_shape(theta: ArrayLike) -> Array:
    """Inverse of `shape_of_ellipse`, with a >= b and the angle in [0, 180)."""
    x, y, s11, s12, s22 = np.moveaxis(np.asarray(theta, dtype=np.float64), -1, 0)
    mean, half = (s11 + s22) / 2, np.hypot((s11 - s22) / 2, s12)
    angle = np.mod(np.degrees(np.arctan2(s12, (s11 - s22) / 2)) / 2, 180.0)
    return np.stack([x, y, mean + half, mean - half, np.where(angle >= 180.0, 0.0, angle)], axis=-1)


def _is_ellipse(theta: Array) -> bool:
    return bool(np.all(np.isfinite(theta)) and theta[2] > 0 and theta[2] * theta[4] - theta[3] ** 2 > 0)


def _ellipse_by_shape(ellipse: Array) -> Array:
    """Derivative (5, 5) of x, y, a, b, angle_deg by x, y, S11, S12, S22: dS turned into the axes' frame."""
    c, s = np.cos(np.radians(ellipse[4])), np.sin(np.radians(ellipse[4]))
    out = np.zeros((5, 5))
    out[0, 0] = out[1, 1] = 1.0
    out[2, 2:] = c * c, 2 * c * s, s * s
    out[3, 2:] = s * s, -2 * c * s, c * c
    gap = max(float(ellipse[2] - ellipse[3]), 1e-12 * float(ellipse[2]))
    out[4, 2:] = np.degrees(np.array([-c * s, c * c - s * s, c * s]) / gap)
    return out


def _distance_and_jacobian(theta: Array, points: Array) -> tuple[Array, Array]:
    x, y, s11, s12, s22 = (float(v) for v in theta)
    mean, half, turn = (s11 + s22) / 2, math.hypot((s11 - s22) / 2, s12), math.atan2(s12, (s11 - s22) / 2) / 2
    distance, normal, u = foot_points((x, y, mean + half, mean - half, math.degrees(turn)), points)
    jacobian = np.empty((len(points), 5))
    np.negative(normal, out=jacobian[:, :2])
    np.multiply(jacobian[:, :2], u, out=jacobian[:, 2::2])
    jacobian[:, 3] = jacobian[:, 0] * u[:, 1] + jacobian[:, 1] * u[:, 0]
    return distance, jacobian
