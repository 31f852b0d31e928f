"""Fisher information of a circle's pose in its contour, and of an ellipse in its pixels.

Contours: edge point i is pi(X(t_i)) + N(0, sigma^2 I). Its position t_i along the circle is unknown; the Schur
complement over t_i leaves the component along the image normal nu_i of the contour (errata, section 6):

    F = sigma^-2 sum J_i^T J_i,   J_i = nu_i^T J_pi(X_i) [w x (X_i - c), I3 (, d / d ln f)],   w = r1, r2
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.edge_spread_function import (
    PIXEL_VARIANCE,
    curved_distance,
    ellipse_curvature,
    step_response,
)

Array = NDArray[np.float64]

# The integral over the circle is a sum over this many points: the integrand is smooth and periodic, so that the sum
# converges faster than any power of their number (64 suffice for a circle that nearly touches the camera's plane).
_QUADRATURE = 256
# Above this condition number (parameters scaled to one) the information is singular to rounding.
_SINGULAR = 1e13
# Quadrature over a band of pixels: angles (for a blunt ellipse, for others), and Gauss-Legendre nodes across it before,
# within and beyond six sigma of the edge. The error against many more nodes is within 0.3 % for sharp edges, where the
# response has corners, and 3 % if the blur is half of the minor semi-axis.
_ANGLES, _NODES = (32, 96), (4, 48, 4)
_SHARPEST_PX = 0.05  # a blur below it counts as none; it keeps the response differentiable


@dataclass(frozen=True, eq=False)
class PoseBound:
    """The Cramer-Rao bound of an unbiased estimate of a circle's pose.

    Attributes
    ----------
    normal_deg : float
        RMS angle between estimated and true normal, both tangential axes together. Infinite if one axis is unknown.
    position_m : float
        RMS distance between estimated and true centre, all three axes together.
    cov : (5, 5) or (6, 6) array
        Inverse of the information, in the same parameters.
    """

    normal_deg: float
    position_m: float
    cov: Array


def contour_information(
    camera_from_marker: ArrayLike,
    radius_m: float,
    K: ArrayLike,
    sigma_px: float,
    count: float,
    *,
    spacing: Literal["contour", "circle"] = "contour",
    focal_sigma: float | None = None,
) -> Array:
    """Fisher information of edge points of a circle about its pose (errata, section 6).

    Parameters
    ----------
    camera_from_marker : (4, 4) array_like
        Pose; the circle is centred at the marker frame's origin in its plane Z = 0.
    radius_m : float
    K : (3, 3) array_like
    sigma_px : float
        Standard deviation of each coordinate of a point, equivalently of its distance from the contour.
    count : float
        Number of points.
    spacing : str
        The points are evenly spaced along the contour in the image (`contour`: by arc length, like its pixels) or along
        the circle in the world (`circle`). The sum averages over all phases of the pattern.
    focal_sigma : float, optional
        Adds ln f, for both focal lengths at once, as sixth parameter with a prior of this standard deviation (a
        fraction of f), as one more row 1 / focal_sigma. Infinite for no prior: the information then has rank 5, because
        every f has a pose that reproduces the ellipse.

    Returns
    -------
    (5, 5) or (6, 6) array
        Parameters: rotation about the marker's X and Y axes (rad), centre x, y, z (m) in the camera frame (, ln f).

    Raises
    ------
    ValueError
        If a number is not positive, or the circle is not entirely in front of the camera or is seen edge-on.
    """
    if not all(math.isfinite(v) and v > 0 for v in (radius_m, sigma_px, count)):
        raise ValueError("radius_m, sigma_px and count must be positive, finite numbers")
    if focal_sigma is not None and not focal_sigma > 0:
        raise ValueError(f"focal_sigma must be positive, not {focal_sigma}; leave it out for a known focal length")
    m, k = np.asarray(camera_from_marker, dtype=np.float64), np.asarray(K, dtype=np.float64)
    t = np.arange(_QUADRATURE) * (2 * np.pi / _QUADRATURE)
    r1, r2, centre = m[:3, 0], m[:3, 1], m[:3, 3]
    arm = radius_m * (np.cos(t)[:, None] * r1 + np.sin(t)[:, None] * r2)
    tangent = radius_m * (np.cos(t)[:, None] * r2 - np.sin(t)[:, None] * r1)
    x, y, z = (centre + arm).T
    if not np.all(z > 0):
        raise ValueError("the circle is not entirely in front of the camera")
    if not abs(m[:3, 2] @ centre) > 1e-12 * np.linalg.norm(centre):
        raise ValueError("the circle is seen edge-on: its image is not an ellipse")
    zero = np.zeros_like(z)
    projection = np.stack([np.stack([1 / z, zero, -x / z**2], -1), np.stack([zero, 1 / z, -y / z**2], -1)], axis=-2)
    projection = k[:2, :2] / k[2, 2] @ projection
    along = np.einsum("nij,nj->ni", projection, tangent)  # d pixel / dt
    speed = np.hypot(along[:, 0], along[:, 1])
    normal = np.stack([along[:, 1], -along[:, 0]], axis=-1) / speed[:, None]
    moved = np.einsum("ni,nij->nj", normal, projection)  # d distance / d X
    columns = [np.sum(moved * np.cross(axis, arm), axis=-1) for axis in (r1, r2)] + list(moved.T)
    if focal_sigma is not None:  # (x, y) / z stretched about the principal point
        columns.append(np.einsum("ni,ij,jn->n", normal, k[:2, :2] / k[2, 2], np.stack([x / z, y / z])))
    jacobian = np.stack(columns, axis=-1)
    share = speed / np.sum(speed) if spacing == "contour" else np.full(_QUADRATURE, 1 / _QUADRATURE)
    information = jacobian.T @ (jacobian * (share * count / sigma_px**2)[:, None])
    if focal_sigma is not None:
        information[5, 5] += focal_sigma**-2
    return np.asarray(information, dtype=np.float64)


def pose_bound(information: ArrayLike) -> PoseBound:
    """Cramer-Rao bound of normal and position from `contour_information`.

    Both are infinite if the information is singular: for a circle seen along its own axis, where a small tilt cannot be
    distinguished from a shift, and without a prior on the focal length. Close to that (below the breakdown tilt of
    errata, section 6) the bound is finite, but no estimator is unbiased, so the bound does not apply.
    """
    f = np.asarray(information, dtype=np.float64)
    scale = 1 / np.sqrt(np.diag(f))
    unit = f * scale[:, None] * scale
    if not np.all(np.isfinite(unit)) or np.linalg.cond(unit) > _SINGULAR:
        return PoseBound(math.inf, math.inf, np.full_like(f, math.inf))
    cov = np.linalg.inv(unit) * scale[:, None] * scale
    normal = math.degrees(math.sqrt(cov[0, 0] + cov[1, 1]))
    return PoseBound(normal, math.sqrt(cov[2, 2] + cov[3, 3] + cov[4, 4]), np.asarray(cov, dtype=np.float64))


def shape_information_of_pixels(
    ellipse: ArrayLike,
    inside_dn: float,
    outside_dn: float,
    blur_px: float,
    noise_dn: float | tuple[float, float],
    reach_px: float = 8.0,
) -> Array:
    """Fisher information of pixels about the shape of an ellipse, with unknown grey levels and blur.

    A pixel is inside + (outside - inside) T(z) with Gaussian noise, T and z as in `scenes.edge_spread_function`. Pixels
    are dense and at all phases: their sum is the integral over the band. One pair of grey levels and one blur (the
    variance b^2 in T, to which the pixel adds its square) are unknown and eliminated by a Schur complement. If they
    were known, the bound would be 1.2 to 1.5 times smaller.

    Parameters
    ----------
    ellipse : (5,) array_like
        x_px, y_px, a_px, b_px, angle_deg.
    inside_dn, outside_dn : float
    blur_px : float
        Gaussian sigma, without the pixel.
    noise_dn : float or (float, float)
        Standard deviation of a pixel, or of a pixel inside and one outside.
    reach_px : float
        Distance from the contour up to which pixels count, beyond five sigma of the blur: they determine the grey
        levels. Above 6 px it changes the result by less than a tenth.

    Returns
    -------
    (5, 5) array
        Parameters x, y, S11, S12, S22 (px), where the contour is {(x, y) + S u, |u| = 1} with S symmetric.

    Raises
    ------
    ValueError
        If there is no contrast, or if noise, blur or axes are not positive numbers.
    """
    _, _, a, b, angle = (float(v) for v in np.asarray(ellipse, dtype=np.float64))
    noise = np.broadcast_to(np.asarray(noise_dn, dtype=np.float64), (2,))
    height = outside_dn - inside_dn
    if not (math.isfinite(height) and height != 0):
        raise ValueError("inside_dn and outside_dn must differ: without contrast there is no edge")
    if not (np.all(noise > 0) and b > 0 and blur_px >= 0 and reach_px > 0):
        raise ValueError("noise_dn, reach_px and the semi-axes must be positive, blur_px not negative")
    variance = max(blur_px, _SHARPEST_PX) ** 2
    spread = math.sqrt(variance + PIXEL_VARIANCE)
    # If no normals cross within the edge's reach, the integrand is smooth everywhere.
    angles = _ANGLES[b * b / a < 6.0 * spread]
    t = (np.arange(angles) + 0.5) * (2 * np.pi / angles)
    curvature, curvature_ss = ellipse_curvature(a, b, np.cos(t), np.sin(t))
    speed = np.hypot(a * np.sin(t), b * np.cos(t))
    # Normals cross beyond the centre of curvature: pixels there are counted from another part of the contour.
    far = reach_px + 5.0 * spread
    near = np.maximum(-far, -1.0 / curvature)
    ends = [near, np.maximum(near, -6.0 * spread), np.full_like(near, 6.0 * spread), np.full_like(near, far)]
    distance, step = (np.concatenate(parts, axis=1) for parts in zip(*map(_nodes, ends, ends[1:], _NODES), strict=True))
    count = distance.shape[1]
    area = (speed * (2 * np.pi / angles))[:, None] * step * (1.0 + curvature[:, None] * distance)
    local_normal = np.stack([b * np.cos(t), a * np.sin(t)], axis=-1) / speed[:, None]
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    turn = np.array([[c, s], [-s, c]])
    normal, u = local_normal @ turn, np.stack([np.cos(t), np.sin(t)], axis=-1) @ turn
    rows = np.column_stack(
        [normal, normal[:, 0] * u[:, 0], normal[:, 0] * u[:, 1] + normal[:, 1] * u[:, 0], normal[:, 1] * u[:, 1]]
    )
    whole = np.broadcast_to(curvature[:, None], distance.shape).ravel()
    whole_ss = np.broadcast_to(curvature_ss[:, None], distance.shape).ravel()
    nx, ny = np.repeat(np.abs(normal), count, axis=0).T
    z, drift = curved_distance(distance.ravel(), whole, whole_ss, variance + PIXEL_VARIANCE)
    response, slope, bend = step_response(z, (nx + ny) / 2, (nx - ny) / 2, variance)
    design = np.empty((len(z), 8))
    design[:, :5] = np.repeat(rows, count, axis=0) * (-height * slope)[:, None]
    design[:, 5] = height * (bend / 2 + slope * drift)
    design[:, 6], design[:, 7] = 1.0 - response, response
    weight = area.ravel() / (noise[0] ** 2 * (1.0 - response) + noise[1] ** 2 * response)
    full = design.T @ (design * weight[:, None])
    return np.asarray(full[:5, :5] - full[:5, 5:] @ np.linalg.solve(full[5:, 5:], full[5:, :5]), dtype=np.float64)


@lru_cache
def _legendre(count: int) -> tuple[Array, Array]:
    x, w = np.polynomial.legendre.leggauss(count)
    return x, w


def _nodes(low: Array, high: Array, count: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights (n, count) of each of n intervals."""
    x, w = _legendre(count)
    half = (high - low)[:, None] / 2
    return low[:, None] + half * (1.0 + x), half * w


def pose_information_of_shape(
    information: ArrayLike, camera_from_marker: ArrayLike, radius_m: float, K: ArrayLike
) -> Array:
    """Information about a circle's pose from that about the shape of its ellipse: J^T F J, with as many parameters.

    Parameters
    ----------
    information : (5, 5) array_like
        As `shape_information_of_pixels` returns it.
    camera_from_marker : (4, 4) array_like
    radius_m : float
    K : (3, 3) array_like

    Returns
    -------
    (5, 5) array
        Parameters: rotation about the marker's X and Y axes (rad), centre x, y, z (m), for `pose_bound`.
    """
    m = np.asarray(camera_from_marker, dtype=np.float64)
    # Central differences: rounding of 1e-16 / 1e-5 and curvature of 1e-10 are both negligible.
    tiny = 1e-5
    columns = []
    for i in range(5):
        size = tiny if i < 2 else tiny * float(np.linalg.norm(m[:3, 3]))
        ends = []
        for sign in (1.0, -1.0):
            moved = m.copy()
            if i < 2:
                axis, other = m[:3, i], m[:3, 1 - i]
                moved[:3, 1 - i] = math.cos(size) * other + sign * math.sin(size) * np.cross(axis, other)
                moved[:3, 2] = math.cos(size) * m[:3, 2] + sign * math.sin(size) * np.cross(axis, m[:3, 2])
            else:
                moved[i - 2, 3] += sign * size
            x, y, a, b, angle = ellipse_of_conic(conic_of_circle(moved, radius_m, K))
            along, across = (
                (a - b) / 2 * np.array([math.cos(math.radians(2 * angle)), math.sin(math.radians(2 * angle))])
            )
            ends.append(np.array([x, y, (a + b) / 2 + along, across, (a + b) / 2 - along]))
        columns.append((ends[0] - ends[1]) / (2 * size))
    jacobian = np.stack(columns, axis=-1)
    return np.asarray(jacobian.T @ np.asarray(information, dtype=np.float64) @ jacobian, dtype=np.float64)
