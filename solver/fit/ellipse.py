"""Ellipses from points: a direct fit as the starting value, the orthogonal-distance fit as the estimate.

With isotropic noise on the points the orthogonal-distance fit is the maximum-likelihood fit, and only the component of
the noise along the contour's normal matters (errata, section 6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.fit.levenberg_marquardt import minimise
from roundel.solver.kernels.ellipse_distances import shape_rows

Array = NDArray[np.float64]
Loss = Literal["none", "huber", "tukey"]

MIN_POINTS = 6  # five parameters, plus one point to measure the residual
_FARTHEST_PX = 1e12  # beyond it float64 cannot resolve an edge
_SINGULAR = 1e-13  # smallest ratio of the scaled normal matrix's eigenvalues: less is rounding
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
        Covariance of `ellipse`, in px and degrees. Near a circle the angle is undefined and its variance unbounded.
    sigma_px : float
        RMS of the residual along the normal, over n - 5 degrees of freedom; with a robust loss, that of the inliers
        (from the median).
    n : int
        Number of points.
    shape_cov : (5, 5) array
        Covariance of (x, y, S11, S12, S22), px, where the contour is {(x, y) + S u, |u| = 1} with S symmetric:
        regular also for circles, so use this one to propagate errors.
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
    """A failed fit: falsy, with its reason."""

    reason: str

    def __bool__(self) -> bool:
        return False


def direct_ellipse(points_px: ArrayLike) -> Array | FailedFit:
    """Direct least-squares fit, always an ellipse but biased toward small ones by noise: a start for `fit_ellipse`.

    Source: R. Halir, J. Flusser, Numerically stable direct least squares fitting of ellipses, WSCG (1998).

    Parameters
    ----------
    points_px : (N, 2) array_like

    Returns
    -------
    (5,) array or FailedFit
        x_px, y_px, a_px, b_px, angle_deg.
    """
    points = usable_points(points_px)
    return points if isinstance(points, FailedFit) else _direct(points)


def _direct(points: Array) -> Array | FailedFit:
    centroid = points.mean(axis=0)
    local = points - centroid
    # Centred and scaled, so that the columns x^2 .. 1 have similar magnitude and S3 is well conditioned.
    scale = math.sqrt(float(np.vdot(local, local)) / (2 * len(local)))
    x, y = np.ascontiguousarray(local.T) / scale
    design = np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)])
    scatter = design @ design.T
    s1, s2, s3 = scatter[:3, :3], scatter[:3, 3:], scatter[3:, 3:]
    try:
        t = -np.linalg.solve(s3, s2.T)
    except np.linalg.LinAlgError:
        return FailedFit("the points lie on a line")
    _, vectors = np.linalg.eig((s1 + s2 @ t)[::-1] * np.array([[0.5], [-1.0], [0.5]]))
    v = np.real(vectors)
    elliptic = 4.0 * v[0] * v[2] - v[1] ** 2
    best = int(np.argmax(elliptic))
    if not elliptic[best] > 0:
        return FailedFit("no ellipse fits the points: they lie on a line or nearly so")
    q = v[:, best]
    found = _ellipse_of_coefficients(*q.tolist(), *(t @ q).tolist())
    if found is None:
        return FailedFit("no ellipse fits the points: the best one has no real contour")
    x, y, a, b, angle = found
    return np.array([x * scale + float(centroid[0]), y * scale + float(centroid[1]), a * scale, b * scale, angle])


def _ellipse_of_coefficients(
    a: float, b: float, c: float, d: float, e: float, f: float
) -> tuple[float, float, float, float, float] | None:
    """Ellipse of a x^2 + b xy + c y^2 + d x + e y + f = 0; `ellipse_of_conic` in floats, ten times faster for one."""
    b, d, e = b / 2, d / 2, e / 2
    determinant = a * c - b * b
    x, y = (b * e - c * d) / determinant, (b * d - a * e) / determinant
    size = -(f + d * x + e * y) / determinant
    # S S^T = size [[c, -b], [-b, a]]; its trace and determinant are free of cancellation.
    mean, half = size * (a + c) / 2, abs(size) * math.hypot((c - a) / 2, b)
    if not mean > 0:
        return None
    major = mean + half
    minor = size * size * determinant / major
    if not (minor > 0 and math.isfinite(major)):
        return None
    angle = math.degrees(math.atan2(-b * size, (c - a) / 2 * size)) / 2 % 180.0
    return x, y, math.sqrt(major), math.sqrt(minor), angle if angle < 180.0 else 0.0


def fit_ellipse(
    points_px: ArrayLike,
    sigma_px: ArrayLike | None = None,
    start: ArrayLike | None = None,
    loss: Loss = "none",
    tolerance: float = 1e-8,
) -> EllipseFit | FailedFit:
    """Fit an ellipse by least squares of orthogonal distances (maximum likelihood for isotropic noise).

    Levenberg-Marquardt over (x, y, S11, S12, S22), contour {(x, y) + S u, |u| = 1}: regular for circles. With the foot
    point at u and the normal nu there, the signed distance d has the exact derivative -nu . d((x, y) + S u) at fixed u.

    With a robust loss the covariance is that of an M-estimator, Huber's "sandwich"
    s^2 H^-1 (sum psi^2 j j^T) H^-1 n / (n - 5) with H = sum psi' j j^T: it is valid for any distribution of
    the outliers, if they are on both sides. It does not include the bias of outliers on one side.
    Source: P. J. Huber, Robust Statistics (1981), section 7.6.

    Parameters
    ----------
    points_px : (N, 2) array_like
    sigma_px : (N,) array_like, optional
        Standard deviations of the points along the normal; only their ratios matter.
    start : (5,) array_like, optional
        An ellipse to start from; by default the direct fit.
    loss : {"none", "huber", "tukey"}
        Robust loss on the distance over its standard deviation, scaled by the median.
    tolerance : float
        The iteration ends at steps smaller than this fraction of the points' extent.

    Returns
    -------
    EllipseFit or FailedFit

    Raises
    ------
    ValueError
        If `loss` is unknown.
    """
    if loss not in ("none", *_TUNING):
        raise ValueError(f"unknown loss {loss!r}; use none, huber or tukey")
    points = usable_points(points_px)
    if isinstance(points, FailedFit):
        return points
    inverse_sigma = inverse_sigmas(sigma_px, len(points))
    if isinstance(inverse_sigma, FailedFit):
        return inverse_sigma
    ellipse = _direct(points) if start is None else _checked_start(start)
    if isinstance(ellipse, FailedFit):
        return ellipse
    origin = points.mean(axis=0)  # keeps the digits of small steps far from the image's origin
    local = points - origin
    extent = float(np.abs(local).max())
    theta = shape_of_ellipse(ellipse)
    theta[:2] -= origin

    theta, rows = minimise(
        theta,
        lambda at: _rows(at, local, inverse_sigma),
        _is_ellipse,
        tolerance * extent,
        None if loss == "none" else lambda residual: _loss_weight(residual, loss),
    )
    if not float(np.abs(theta).max()) < 1e4 * extent:
        return FailedFit("the points do not bound an ellipse: the best fit grows without bound")
    distance = rows[5] / inverse_sigma
    theta[:2] += origin
    if loss == "none":
        inverse = inverse_of(rows[:5] @ rows[:5].T)
        if isinstance(inverse, FailedFit):
            return inverse
        variance = float(rows[5] @ rows[5]) / (len(local) - 5)
        return finished_fit(theta, distance, variance, inverse * variance)
    return _robust_fit(theta, distance, rows, loss)


def usable_points(points_px: ArrayLike) -> Array | FailedFit:
    """Points (N, 2) as float64, or why no ellipse can be fitted to them."""
    try:
        points = np.asarray(points_px, dtype=np.float64)
    except (TypeError, ValueError):
        return FailedFit("points must be an (N, 2) array of numbers")
    if points.ndim != 2 or points.shape[1] != 2:
        return FailedFit(f"points must be an (N, 2) array; this one has shape {points.shape}")
    if len(points) < MIN_POINTS:
        return FailedFit(f"only {len(points)} points; an ellipse needs {MIN_POINTS}")
    largest = float(np.abs(points).max())
    if not math.isfinite(largest):
        return FailedFit("a point is not finite")
    if largest > _FARTHEST_PX:
        return FailedFit(f"a point lies at {largest:.0e} px; beyond {_FARTHEST_PX:.0e} px nothing can be measured")
    # Sorted as complex numbers, by x, then y, equal points are adjacent.
    ordered = np.sort(np.ascontiguousarray(points).view(np.complex128).ravel())
    distinct = 1 + int(np.count_nonzero(ordered[1:] != ordered[:-1]))
    # 1e-9 of the coordinates is ten million times their rounding; closer points count as one.
    if distinct == 1 or float(np.abs(points - points[0]).max()) <= max(1e-9 * largest, 1e-100):
        return FailedFit("all points coincide")
    if distinct < MIN_POINTS:
        return FailedFit(f"only {distinct} distinct points; an ellipse needs {MIN_POINTS}")
    return points


def inverse_sigmas(sigma_px: ArrayLike | None, count: int) -> Array | FailedFit:
    """1 / sigma of each point, scaled to a mean square of one; ones if no sigma is given."""
    if sigma_px is None:
        return np.ones(count)
    given = np.asarray(sigma_px, dtype=np.float64)
    if given.shape not in ((), (count,)):
        return FailedFit(f"sigma_px must be one number per point; it has shape {given.shape} for {count} points")
    sigmas = np.broadcast_to(given, (count,))
    if not np.all(np.isfinite(sigmas) & (sigmas > 0)):
        return FailedFit("sigma_px must be positive and finite for every point")
    inverse = float(np.min(sigmas)) / sigmas
    return np.asarray(inverse / math.sqrt(float(np.mean(inverse**2))))


def finished_fit(theta: Array, residual_px: Array, variance: float, shape_cov: Array) -> EllipseFit:
    """The record of a fit.

    Parameters
    ----------
    theta : (5,) array
        Shape parameters x, y, S11, S12, S22.
    residual_px : (N,) array
    variance : float
        Variance of a point with relative sigma one, px^2.
    shape_cov : (5, 5) array
        Covariance of theta.
    """
    ellipse = ellipse_of_shape(theta)
    to_ellipse = _ellipse_by_shape(ellipse)
    cov = to_ellipse @ shape_cov @ to_ellipse.T
    return EllipseFit(ellipse, cov, math.sqrt(variance), len(residual_px), shape_cov, residual_px)


def inverse_of(normal: Array) -> Array | FailedFit:
    """Inverse of a normal matrix, computed with a unit diagonal; a failure if it is singular."""
    diagonal = np.diag(normal)
    if not (np.all(np.isfinite(normal)) and np.all(diagonal > 0)):
        return FailedFit("the points do not determine an ellipse")
    scale = 1.0 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(normal * scale[:, None] * scale)
    if not values[0] > _SINGULAR * values[-1]:
        return FailedFit("the points do not determine an ellipse")
    return np.asarray((vectors / values) @ vectors.T * scale[:, None] * scale)


def _robust_fit(theta: Array, distance: Array, rows: Array, loss: Loss) -> EllipseFit | FailedFit:
    """The record of an M-estimate: Huber's sandwich, see `fit_ellipse`."""
    n = len(distance)
    ratio = np.abs(rows[5]) / max(_TUNING[loss] * _scale(rows[5]), 1e-300)
    if loss == "huber":
        slope = (ratio < 1.0).astype(np.float64)
        weight = 1.0 / np.maximum(ratio, 1.0)
    else:
        inside = np.maximum(1.0 - ratio**2, 0.0)
        slope, weight = inside * (1.0 - 5.0 * ratio**2), inside**2
    if np.count_nonzero(weight) < MIN_POINTS:
        return FailedFit("fewer than six points agree on an ellipse")
    bread = inverse_of((rows[:5] * slope) @ rows[:5].T)
    if isinstance(bread, FailedFit):
        return bread
    psi = rows[:5] * (weight * rows[5])
    cov = bread @ (psi @ psi.T) @ bread * (n / (n - 5))
    return finished_fit(theta, distance, _scale(rows[5]) ** 2 * n / (n - 5), cov)


def _scale(residual: Array) -> float:
    return 1.4826 * float(np.median(np.abs(residual)))  # 1.4826 makes the median the sigma of a Gaussian


def _loss_weight(residual: Array, loss: Loss) -> Array:
    """Weights psi(r) / r of the iteration."""
    ratio = np.abs(residual) / max(_TUNING[loss] * _scale(residual), 1e-12)
    if loss == "huber":
        return np.asarray(1.0 / np.maximum(ratio, 1.0))
    return np.asarray(np.maximum(1.0 - ratio**2, 0.0) ** 2)


def _checked_start(start: ArrayLike) -> Array | FailedFit:
    ellipse = np.asarray(start, dtype=np.float64)
    if ellipse.shape != (5,) or not (np.all(np.isfinite(ellipse)) and np.all(ellipse[2:4] > 0)):
        return FailedFit("start must be x, y, a, b, angle of an ellipse: five finite numbers, both semi-axes positive")
    return ellipse


def _shape_of_one(x: float, y: float, a: float, b: float, angle: float) -> tuple[float, ...]:
    """As `shape_of_ellipse`, in plain floats: several times faster."""
    half, twice, mean = (a - b) / 2, math.radians(2 * angle), (a + b) / 2
    return x, y, mean + half * math.cos(twice), half * math.sin(twice), mean - half * math.cos(twice)


def _ellipse_of_one(x: float, y: float, s11: float, s12: float, s22: float) -> tuple[float, ...]:
    """As `ellipse_of_shape`, in plain floats."""
    mean, half = (s11 + s22) / 2, math.hypot((s11 - s22) / 2, s12)
    angle = math.degrees(math.atan2(s12, (s11 - s22) / 2)) / 2 % 180.0
    return x, y, mean + half, mean - half, angle if angle < 180.0 else 0.0


def shape_of_ellipse(ellipse: ArrayLike) -> Array:
    """(..., 5) x, y, a, b, angle_deg to (..., 5) x, y, S11, S12, S22 with S = Rot diag(a, b) Rot^T."""
    e = np.asarray(ellipse, dtype=np.float64)
    if e.ndim == 1:
        return np.array(_shape_of_one(*e.tolist()))
    x, y, a, b, angle = (e[..., i] for i in range(5))
    half, twice = (a - b) / 2, np.radians(2 * angle)
    mean = (a + b) / 2
    return np.stack([x, y, mean + half * np.cos(twice), half * np.sin(twice), mean - half * np.cos(twice)], axis=-1)


def ellipse_of_shape(theta: ArrayLike) -> Array:
    """Inverse of `shape_of_ellipse`, with a >= b and the angle in [0, 180)."""
    t = np.asarray(theta, dtype=np.float64)
    if t.ndim == 1:
        return np.array(_ellipse_of_one(*t.tolist()))
    x, y, s11, s12, s22 = (t[..., i] for i in range(5))
    mean, half = (s11 + s22) / 2, np.hypot((s11 - s22) / 2, s12)
    angle = np.mod(np.degrees(np.arctan2(s12, (s11 - s22) / 2)) / 2, 180.0)
    return np.stack([x, y, mean + half, mean - half, np.where(angle >= 180.0, 0.0, angle)], axis=-1)


def _is_ellipse(theta: Array) -> bool:
    x, y, s11, s12, s22 = theta.tolist()
    return math.isfinite(x + y + s11 + s12 + s22) and s11 > 0 and s11 * s22 - s12 * s12 > 0


def _ellipse_by_shape(ellipse: Array) -> Array:
    """Derivative (5, 5) of x, y, a, b, angle_deg by x, y, S11, S12, S22: dS rotated into the axes' frame."""
    _, _, a, b, angle = ellipse.tolist()
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    turn = math.degrees(1.0) / max(a - b, 1e-12 * a)
    return np.array(
        [
            [1.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, c * c, 2 * c * s, s * s],
            [0.0, 0.0, s * s, -2 * c * s, c * c],
            [0.0, 0.0, -c * s * turn, (c * c - s * s) * turn, c * s * turn],
        ]
    )


def _rows(theta: Array, points: Array, inverse_sigma: Array) -> Array:
    """(6, N): derivatives of the signed distances by theta, and the distances, over the points' relative sigmas."""
    rows = np.empty((6, len(points)))
    shape_rows(theta, points, inverse_sigma, rows)
    return rows
