"""Conics: the image of a circle, its ellipse, the image of its centre, and the second pose.

A conic is a symmetric 3x3 matrix C with x^T C x = 0 in undistorted pixel coordinates, of unit Frobenius norm,
positive inside. A single ellipse is an `Ellipse`; arrays (..., 5) hold the fields of many ellipses in the same order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Ellipse(NamedTuple):
    """An ellipse in pixels: centre, semi-axes a >= b, angle of the major axis from +x toward +y in [0, 180) degrees.

    `np.asarray` converts it to a (5,) array; functions that take an ellipse do so themselves.
    """

    x_px: float
    y_px: float
    a_px: float
    b_px: float
    angle_deg: float

    @classmethod
    def from_array(cls, values: ArrayLike) -> Ellipse:
        """Create an `Ellipse` from a (5,) array."""
        return cls(*np.asarray(values, dtype=np.float64).tolist())


def _unit_positive_inside(conic: Array) -> Array:
    # An ellipse that is positive inside has signature (1, 2), and therefore a positive determinant.
    scaled = conic / np.linalg.norm(conic, axis=(-2, -1), keepdims=True)
    sign = np.where(np.linalg.det(scaled) < 0, -1.0, 1.0)
    return np.asarray(scaled * sign[..., None, None], dtype=np.float64)


def conic_of_circle(camera_from_marker: ArrayLike, radius_m: ArrayLike, K: ArrayLike) -> Array:
    """Image of a circle: C ~ H^-T Q H^-1 (paper, section III; the print has H^T, see the errata).

    Parameters
    ----------
    camera_from_marker : (..., 4, 4) array_like
        Pose; the circle is centred at the marker frame's origin in its plane Z = 0.
    radius_m : (...) array_like
    K : (3, 3) array_like

    Returns
    -------
    (..., 3, 3) array
        Unit Frobenius norm, positive inside.
    """
    m = np.asarray(camera_from_marker, dtype=np.float64)
    r = np.asarray(radius_m, dtype=np.float64)[..., None]
    r1, r2, r3, c = (m[..., :3, i] for i in range(4))
    d = np.sum(r3 * c, axis=-1, keepdims=True)
    # The inverse of [R r1, R r2, c], row by row: p = X R r1 + Y R r2 + W c has W = r3.p / d and X R = r1.p - W r1.c.
    # A general inverse would lose accuracy by its condition number, about 1e5 for a far marker.
    rows = [(axis - np.sum(axis * c, axis=-1, keepdims=True) / d * r3) / r for axis in (r1, r2)]
    rows.append(np.broadcast_to(r3 / d, rows[0].shape))
    inverse = np.stack(rows, axis=-2) @ np.linalg.inv(np.asarray(K, dtype=np.float64))
    return _unit_positive_inside(np.swapaxes(inverse, -1, -2) @ np.diag([-1.0, -1.0, 1.0]) @ inverse)


def ellipse_of_conic(conic: ArrayLike) -> Array:
    """Ellipse (..., 5) of a conic (..., 3, 3) of any scale and sign.

    Raises
    ------
    ValueError
        If a conic is not a real, non-degenerate ellipse.
    """
    c = np.asarray(conic, dtype=np.float64)
    block, linear = c[..., :2, :2], c[..., :2, 2]
    determinant = block[..., 0, 0] * block[..., 1, 1] - block[..., 0, 1] ** 2
    if not np.all(determinant > 0):
        raise ValueError("not an ellipse: the conic is a hyperbola, a parabola or degenerate")
    centre = -np.linalg.solve(block, linear[..., None])[..., 0]
    level = c[..., 2, 2] + np.sum(linear * centre, axis=-1)
    eigenvalues, vectors = np.linalg.eigh(block)
    squared = -level[..., None] / eigenvalues
    if not np.all(squared > 0):
        raise ValueError("not an ellipse: the conic has no real points")
    # The semi-axis is longest where the eigenvalue is smallest in magnitude.
    order = np.argsort(-squared, axis=-1)
    axes = np.sqrt(np.take_along_axis(squared, order, axis=-1))
    major = np.take_along_axis(vectors, order[..., None, :], axis=-1)[..., :, 0]
    angle = np.mod(np.degrees(np.arctan2(major[..., 1], major[..., 0])), 180.0)
    angle = np.where(angle >= 180.0, 0.0, angle)
    return np.concatenate([centre, axes, angle[..., None]], axis=-1)


def conic_of_ellipse(ellipse: ArrayLike) -> Array:
    """Conic (..., 3, 3) of an ellipse (..., 5): unit Frobenius norm, positive inside."""
    e = np.asarray(ellipse, dtype=np.float64)
    angle = np.radians(e[..., 4])
    c, s = np.cos(angle), np.sin(angle)
    u = np.stack([c, s], axis=-1) / e[..., 2:3]
    v = np.stack([-s, c], axis=-1) / e[..., 3:4]
    block = u[..., :, None] * u[..., None, :] + v[..., :, None] * v[..., None, :]
    centre = e[..., :2]
    linear = -(block @ centre[..., None])[..., 0]
    corner = -np.sum(linear * centre, axis=-1) - 1.0
    top = np.concatenate([block, linear[..., :, None]], axis=-1)
    bottom = np.concatenate([linear, corner[..., None]], axis=-1)[..., None, :]
    return _unit_positive_inside(-np.concatenate([top, bottom], axis=-2))


def ellipse_points(ellipse: ArrayLike, count: int) -> Array:
    """`count` points (..., count, 2) on an ellipse (..., 5), evenly spaced in the eccentric angle."""
    e = np.asarray(ellipse, dtype=np.float64)
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    angle = np.radians(e[..., 4, None])
    along, across = e[..., 2, None] * np.cos(t), e[..., 3, None] * np.sin(t)
    x = e[..., 0, None] + along * np.cos(angle) - across * np.sin(angle)
    y = e[..., 1, None] + along * np.sin(angle) + across * np.cos(angle)
    return np.stack([x, y], axis=-1)


def ellipse_perimeter_px(ellipse: ArrayLike) -> Array:
    """Perimeter of an ellipse (..., 5), by the complete elliptic integral of the second kind: 4 a E(1 - b^2/a^2)."""
    from scipy.special import ellipe

    e = np.asarray(ellipse, dtype=np.float64)
    return np.asarray(4 * e[..., 2] * ellipe(1 - (e[..., 3] / e[..., 2]) ** 2), dtype=np.float64)


def circle_points_m(camera_from_marker: ArrayLike, radius_m: float, count: int) -> Array:
    """`count` points (count, 3) of the circle in the camera frame, evenly spaced on the circle."""
    m = np.asarray(camera_from_marker, dtype=np.float64)
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return m[:3, 3] + radius_m * (np.cos(t)[:, None] * m[:3, 0] + np.sin(t)[:, None] * m[:3, 1])


def vanishing_line(camera_from_marker: ArrayLike, K: ArrayLike) -> Array:
    """Vanishing line (3,) of the marker's plane, K^-T normal, of unit norm."""
    m = np.asarray(camera_from_marker, dtype=np.float64)
    line = np.linalg.solve(np.asarray(K, dtype=np.float64).T, m[:3, 2])
    return np.asarray(line / np.linalg.norm(line), dtype=np.float64)


def other_candidate(normal: ArrayLike, centre_m: ArrayLike, radius_m: ArrayLike) -> tuple[Array, Array]:
    """The second pose whose circle has the same image.

    The viewing cone of a circle with centre c, normal n and radius R has the dual A^-1 ~ c c^T + R^2 n n^T - R^2 I
    (errata, section 2, in other words). It is symmetric under reflection in the plane through the camera centre
    perpendicular to its axis e3; the reflection carries one solution to the other. e1, the axis of the cone, lies
    in the plane of c and n, at theta from c toward n, with tan 2 theta = R^2 sin 2 phi / (|c|^2 + R^2 cos 2 phi),
    phi the angle from c to n.

    Parameters
    ----------
    normal, centre_m : (..., 3) array_like
    radius_m : (...) array_like

    Returns
    -------
    normal, centre_m : (..., 3) arrays
        Equal to the input if the circle is seen along its own axis, where there is only one solution.
    """
    n, c = np.asarray(normal, dtype=np.float64), np.asarray(centre_m, dtype=np.float64)
    radius = np.asarray(radius_m, dtype=np.float64)
    distance = np.linalg.norm(c, axis=-1)
    axis = c / distance[..., None]
    away = -n  # away from the camera, so that phi is the small angle
    cos_phi = np.sum(axis * away, axis=-1)
    across = away - cos_phi[..., None] * axis
    sin_phi = np.linalg.norm(across, axis=-1)
    # A circle seen along its axis has sin phi = 0: any perpendicular direction works, the reflection has no effect.
    safe = np.where(sin_phi > 0, sin_phi, 1.0)
    across = across / safe[..., None]
    # Near the axis the first subtraction leaves a remainder of 1e-16 / sin phi along it; the second removes it.
    across = across - np.sum(across * axis, axis=-1, keepdims=True) * axis
    theta = 0.5 * np.arctan2(
        2 * radius**2 * sin_phi * cos_phi, distance**2 + radius**2 * (cos_phi - sin_phi) * (cos_phi + sin_phi)
    )
    e3 = np.cos(theta)[..., None] * across - np.sin(theta)[..., None] * axis
    mirrored_normal = n - 2 * np.sum(n * e3, axis=-1, keepdims=True) * e3
    mirrored_centre = c - 2 * np.sum(c * e3, axis=-1, keepdims=True) * e3
    return mirrored_normal, mirrored_centre
