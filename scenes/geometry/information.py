"""Fisher information of a circle's pose in points of its contour, or in that about the shape of its ellipse.

Contours: edge point i is pi(X(t_i)) + N(0, sigma^2 I). Its position t_i along the circle is unknown; the Schur
complement over t_i leaves the component along the image normal nu_i of the contour (errata, section 6):

    F = sigma^-2 sum J_i^T J_i,   J_i = nu_i^T J_pi(X_i) [w x (X_i - c), I3 (, d / d ln f)],   w = r1, r2
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic

Array = NDArray[np.float64]

# The integral over the circle is a sum over this many points: the integrand is smooth and periodic, so that the sum
# converges faster than any power of their number (64 suffice for a circle that nearly touches the camera's plane).
_QUADRATURE = 256
# Above this condition number (parameters scaled to one) the information is singular to rounding.
_SINGULAR = 1e13


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


def shape_of_pose(camera_from_marker: ArrayLike, radius_m: float, K: ArrayLike) -> Array:
    """Shape (5,) of the image of a circle: x, y, S11, S12, S22 (px), the contour being {(x, y) + S u, |u| = 1}.

    Raises
    ------
    ValueError
        If the image is no ellipse.
    """
    x, y, a, b, angle = ellipse_of_conic(conic_of_circle(camera_from_marker, radius_m, K))
    along, across = (a - b) / 2 * np.array([math.cos(math.radians(2 * angle)), math.sin(math.radians(2 * angle))])
    return np.array([x, y, (a + b) / 2 + along, across, (a + b) / 2 - along])


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
            ends.append(shape_of_pose(moved, radius_m, K))
        columns.append((ends[0] - ends[1]) / (2 * size))
    jacobian = np.stack(columns, axis=-1)
    return np.asarray(jacobian.T @ np.asarray(information, dtype=np.float64) @ jacobian, dtype=np.float64)
