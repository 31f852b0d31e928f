"""Orthogonal projection of points on an ellipse, exact and vectorised."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def foot_points(ellipse: Array | tuple[float, ...], points_px: Array) -> tuple[Array, Array, Array]:
    """Orthogonal projection of points on an ellipse.

    Newton's method on F(s) = (a x / (s + a^2 - b^2))^2 + (b y / s)^2 - 1 in the first quadrant of the ellipse's frame,
    where F is convex and decreasing, so that steps from the left of the root never overshoot.
    Source: D. Eberly, Distance from a point to an ellipse (2013).

    Parameters
    ----------
    ellipse : (5,) array
    points_px : (N, 2) array

    Returns
    -------
    distance : (N,) array
        Signed, positive outside, px.
    normal : (N, 2) array
        Unit outer normal at the foot point; the foot point is `points_px - distance * normal`.
    u : (N, 2) array
        Unit vector with foot point = centre + S u, S = Rot diag(a, b) Rot^T.
    """
    a, b, angle = float(ellipse[2]), float(ellipse[3]), math.radians(ellipse[4])
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    local = (points_px - np.array([ellipse[0], ellipse[1]])) @ turn
    axes = np.array([a, b])
    # On an axis the root may be at the pole s = 0; very close to it the foot point is the same to 1e-12.
    scaled = np.maximum(np.abs(local), 1e-12 * axes) * axes
    ax, by = np.ascontiguousarray(scaled.T)
    gap = (a - b) * (a + b)
    # One term alone reaches 1 at the first value, so F >= 0: left of the root. Most points are close to the contour,
    # s = b^2, and Newton's step from there is also left of the root.
    root = np.maximum(np.maximum(by, ax - gap), _newton(ax, by, gap, np.full_like(by, b * b)))
    for _ in range(100):
        step = _newton(ax, by, gap, root) - root
        root = root + step
        if np.max(np.abs(step) / root, initial=0.0) < 1e-8:  # convergence is quadratic: the remaining error is 1e-16
            break
    u = np.stack([ax / (root + gap), by / root], axis=1)
    gradient = u / axes
    steep = np.sqrt(np.einsum("ij,ij->i", gradient, gradient))
    sign = np.copysign(1.0, local)
    return (root - b * b) * steep, (gradient / steep[:, None] * sign) @ turn.T, (u * sign) @ turn.T


def _newton(ax: Array, by: Array, gap: float, at: Array) -> Array:
    far = at + gap
    p, q = ax / far, by / at
    p *= p
    q *= q
    return np.asarray(at + 0.5 * (p + q - 1.0) / (p / far + q / at))
