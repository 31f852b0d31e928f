"""Guaranteed ellipse fit: minimal Sampson distances among ellipses, never a hyperbola.

The conic F = theta . (x^2, xy, y^2, x, y, 1) is written as theta = (1, 2p, p^2 + e^(2w), r, s, t): its discriminant
(2p)^2 - 4 (p^2 + e^(2w)) = -4 e^(2w) is negative for every p and w. A short arc, which does not determine the far end
of the ellipse, is regular in these parameters, whereas centre and axes diverge together.

Source: Z. L. Szpak, W. Chojnacki, A. van den Hengel, Guaranteed ellipse fitting with a confidence region and an
uncertainty measure for centre, axes, and orientation, J. Math. Imaging Vis. 52 (2015).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.solver.fit.ellipse import (
    EllipseFit,
    FailedFit,
    direct_ellipse,
    finished_fit,
    inverse_of,
    inverse_sigmas,
    usable_points,
)
from roundel.solver.fit.ellipse_distance import foot_points
from roundel.solver.fit.levenberg_marquardt import minimise

Array = NDArray[np.float64]

_SMALLEST_STEP = 1e-9  # in units of the points' size: rounding is 1e-15, magnified by short arcs
_THINNEST = math.log(1e-3)  # b / a; beyond it the ellipse is a parabola to a millionth of the points' size


def guaranteed_ellipse(points_px: ArrayLike, sigma_px: ArrayLike | None = None) -> EllipseFit | FailedFit:
    """Fit an ellipse by least squares of Sampson distances F / |grad F| (approximate maximum likelihood).

    Levenberg-Marquardt from the direct fit, on centred, scaled points rotated into the direct fit's axes, with x along
    the minor one, where x^2 has the largest coefficient of an ellipse, so that it can safely be set to 1.

    The covariance is sigma^2 pinv5(sum u u^T / (theta^T B theta)) of the conic's coefficients, theta^T B theta =
    |grad F|^2, propagated to the shape. The five parameters have no free scale, so no pseudo-inverse is needed: with
    D = d theta / d eta it is sigma^2 (D^T [...] D)^-1. sigma^2 = J / (N - 5).

    The Sampson distance is the orthogonal distance to first order. If the curvature times the noise is not small, the
    result differs from `fit_ellipse`, which is the maximum-likelihood fit; this fit needs no foot points.

    Parameters
    ----------
    points_px : (N, 2) array_like
        Six points or more.
    sigma_px : (N,) array_like, optional
        Standard deviations of the points along the normal; only their ratios matter.

    Returns
    -------
    EllipseFit or FailedFit
        Always an ellipse, unless the points are invalid (too few, not finite, coincident, on a line or a pair of
        lines). Points that fit a parabola better give a very long ellipse with a correspondingly large covariance.
    """
    points = usable_points(points_px)
    if isinstance(points, FailedFit):
        return points
    inverse_sigma = inverse_sigmas(sigma_px, len(points))
    if isinstance(inverse_sigma, FailedFit):
        return inverse_sigma
    origin = points.mean(axis=0)
    seed = direct_ellipse(points)
    if isinstance(seed, FailedFit):
        seed = _ellipse_of_moments(points)
    if isinstance(seed, FailedFit):
        return seed
    size = math.sqrt(float(np.mean(np.sum((points - origin) ** 2, axis=1))))
    turn = math.radians(float(seed[4]) + 90.0)
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    local = (points - origin) @ rotation / size
    x, y = np.ascontiguousarray(local.T)
    eta = _eta_of_seed((seed[:2] - origin) @ rotation / size, float(seed[2]) / size, float(seed[3]) / size)
    eta, rows = minimise(eta, lambda at: _rows(at, x, y, inverse_sigma), _is_ellipse, _SMALLEST_STEP)

    theta, by_eta = _shape(eta)
    inverse = inverse_of(_information(eta, x, y, inverse_sigma))
    if isinstance(inverse, FailedFit):
        return inverse
    variance = float(rows[5] @ rows[5]) / (len(points) - 5)
    residual, _, _ = foot_points(_axes(theta), local)
    # Back to the image: x -> origin + size R x, S -> size R S R^T; the last block is R S R^T written for S11, S12, S22.
    back = np.zeros((5, 5))
    back[:2, :2] = rotation
    back[2:, 2:] = [[c * c, -2 * c * s, s * s], [c * s, c * c - s * s, -c * s], [s * s, 2 * c * s, c * c]]
    back *= size
    full = back @ theta
    full[:2] += origin
    to_shape = back @ by_eta
    shape_cov = to_shape @ inverse @ to_shape.T * variance
    return finished_fit(full, residual * size, variance * size**2, shape_cov)


def _ellipse_of_moments(points: Array) -> Array | FailedFit:
    """The ellipse with the points' moments, a start if the direct fit fails (points exactly on a parabola)."""
    centre = points.mean(axis=0)
    square, vectors = np.linalg.eigh(2.0 * (points - centre).T @ (points - centre) / len(points))
    if not square[0] > 1e-12 * square[1]:  # a deviation of a millionth of their length from the line
        return FailedFit("the points lie on a line or nearly so")
    angle = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
    return np.array([*centre, math.sqrt(square[1]), math.sqrt(square[0]), angle])


def _eta_of_seed(centre: Array, a: float, b: float) -> Array:
    """p, w, r, s, t of an ellipse whose minor axis is along x."""
    w = max(math.log(b / a), _THINNEST)
    x, y = float(centre[0]), float(centre[1])
    ratio2 = math.exp(2 * w)
    return np.array([0.0, w, -2 * x, -2 * ratio2 * y, x * x + ratio2 * (y * y - a * a)])


def _rows(eta: Array, x: Array, y: Array, inverse_sigma: Array) -> Array:
    """(6, N): derivatives of the Sampson distances by eta, and the distances, over the points' relative sigmas."""
    p, w, r, s, t = eta.tolist()
    ratio2 = math.exp(2 * w)
    skewed = x + p * y
    gx = 2 * skewed + r
    gy = p * (2 * skewed) + (2 * ratio2) * y + s
    slope = np.maximum(np.hypot(gx, gy), 1e-12)  # zero only at the centre
    per = inverse_sigma / slope
    nx, ny = gx / slope, gy / slope
    rows = np.empty((6, len(x)))
    distance = (skewed * skewed + ratio2 * y * y + r * x + s * y + t) / slope
    # d (F / |grad F|) = (dF - distance n . d grad F) / |grad F|
    dnx, dny = distance * nx, distance * ny
    rows[0] = 2 * y * skewed - dnx * (2 * y) - dny * (2 * skewed + 2 * p * y)
    rows[1] = 2 * ratio2 * y * (y - 2 * dny)
    rows[2] = x - dnx
    rows[3] = y - dny
    rows[4] = 1.0
    rows[:5] *= per
    np.multiply(distance, inverse_sigma, out=rows[5])
    return rows


def _information(eta: Array, x: Array, y: Array, inverse_sigma: Array) -> Array:
    """D^T (sum u u^T / |grad F|^2) D: u^T D is dF / d eta at the points."""
    p, w, r, s, _ = eta.tolist()
    ratio2 = math.exp(2 * w)
    skewed = x + p * y
    slope = np.hypot(2 * skewed + r, p * (2 * skewed) + (2 * ratio2) * y + s)
    by_eta = np.stack([2 * y * skewed, 2 * ratio2 * y * y, x, y, np.ones_like(x)])
    by_eta *= inverse_sigma / np.maximum(slope, 1e-12)
    return np.asarray(by_eta @ by_eta.T)


def _is_ellipse(eta: Array) -> bool:
    """Whether the conic is a real ellipse and not practically a parabola: F at the centre is negative."""
    p, w, r, s, t = eta.tolist()
    if not (math.isfinite(p + w + r + s + t) and _THINNEST <= w < -_THINNEST):
        return False
    # In skewed coordinates F = (x + p y + r/2)^2 + e^2w (y + k)^2 + level with 2 e^2w k = s - p r.
    k = (s - p * r) / 2 * math.exp(-2 * w)
    return bool(t - r * r / 4 - math.exp(2 * w) * k * k < 0)


def _shape(eta: Array) -> tuple[Array, Array]:
    """Shape parameters (5,) of eta, and their derivatives (5, 5) by it.

    Q x^2 + 2 l x + t = 0: centre c = -Q^-1 l, level k = -(t + l c), S^2 = k Q^-1. Differentials follow line by line;
    S dS + dS S = d(S^2) is solved in the eigenvectors of S, dS_ij = d(S^2)_ij / (s_i + s_j).
    """
    p, w, r, s, t = eta.tolist()
    ratio2 = math.exp(2 * w)
    inverse = np.array([[p * p + ratio2, -p], [-p, 1.0]]) / ratio2
    linear = np.array([r, s]) / 2
    centre = -inverse @ linear
    level = -(t + float(linear @ centre))
    values, vectors = np.linalg.eigh(level * inverse)
    axes = np.sqrt(values)
    shape = (vectors * axes) @ vectors.T
    zero = np.zeros((2, 2))
    d_q = np.array([[[0.0, 1.0], [1.0, 2 * p]], [[0.0, 0.0], [0.0, 2 * ratio2]], zero, zero, zero])
    d_linear = np.array([[0, 0], [0, 0], [0.5, 0], [0, 0.5], [0, 0]])
    d_t = np.array([0.0, 0, 0, 0, 1])
    d_centre = -(d_q @ centre + d_linear) @ inverse
    d_level = -(d_t + d_linear @ centre + d_centre @ linear)
    d_square = d_level[:, None, None] * inverse - level * (inverse @ d_q @ inverse)
    d_shape = vectors @ (vectors.T @ d_square @ vectors / (axes[:, None] + axes)) @ vectors.T
    theta = np.array([*centre, shape[0, 0], shape[0, 1], shape[1, 1]])
    return theta, np.vstack([d_centre.T, d_shape[:, 0, 0], d_shape[:, 0, 1], d_shape[:, 1, 1]])


def _axes(theta: Array) -> tuple[float, ...]:
    x, y, s11, s12, s22 = theta.tolist()
    mean, half = (s11 + s22) / 2, math.hypot((s11 - s22) / 2, s12)
    return x, y, mean + half, mean - half, math.degrees(math.atan2(s12, (s11 - s22) / 2) / 2)
