"""Surfaces that a flat print is bent to without stretching: cylinders and waves.

The paper is bent about one axis in its plane, through the sheet's origin. Along the other direction u the surface
follows a plane curve by arc length, so that distances on the paper, and with them the ink, stay what they are:

    point(u, v) = p(u) e_u + v e_v + z(u) n,    p' = cos(theta), z' = -sin(theta), theta' = curvature(u)

(a developable surface; do Carmo 1976, section 2-4). The tangent plane at the origin is the sheet's own plane z = 0, and
a positive radius bends the paper away from its reader.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Gauss-Legendre nodes for the curve of a wave: exact to 1e-12 of the sheet for up to four waves across it.
_NODES = 64
# A sheet is drawn as strips along its axis, at least this many; a chord deviates from the curve by at most
# (angle of a strip)^2 / 8 of its radius: 1e-7 for half a turn.
_STRIPS = 2048


@dataclass(frozen=True)
class Curve:
    """How a sheet is bent.

    Attributes
    ----------
    kind : str
        `cylinder`: constant curvature; `bent`: a wave whose curvature is cos(2 pi u / wave_m) / radius_m.
    radius_m : float
        Radius of curvature at the sheet's origin.
    axis_deg : float
        Direction that stays straight, in the sheet, degrees from +X toward +Y.
    wave_m : float
        Length of a wave along the paper; of a cylinder infinite.
    """

    kind: str
    radius_m: float
    axis_deg: float
    wave_m: float = np.inf

    def axes(self) -> Array:
        """Rows e_u and e_v (2, 2): across the axis and along it; e_u x e_v is the sheet's normal."""
        c, s = np.cos(np.radians(self.axis_deg)), np.sin(np.radians(self.axis_deg))
        return np.array([[s, -c], [c, s]])

    def slope_rad(self, u_m: ArrayLike) -> Array:
        """Angle theta (...) by which the surface has turned away at arc length u (...)."""
        u = np.asarray(u_m, dtype=np.float64)
        if np.isinf(self.wave_m):
            return u / self.radius_m
        k = 2 * np.pi / self.wave_m
        return np.asarray(np.sin(k * u) / (k * self.radius_m))

    def profile_m(self, u_m: ArrayLike) -> tuple[Array, Array]:
        """Coordinates p and z (...) of the curve at arc length u (...)."""
        u = np.asarray(u_m, dtype=np.float64)
        if np.isinf(self.wave_m):
            theta = u / self.radius_m
            # 1 - cos without cancellation.
            return self.radius_m * np.sin(theta), -2 * self.radius_m * np.sin(theta / 2) ** 2
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        theta = self.slope_rad(u[..., None] * (nodes + 1) / 2)
        return np.asarray(u / 2 * (np.cos(theta) @ weights)), np.asarray(-u / 2 * (np.sin(theta) @ weights))


def lifted(curve: Curve | None, x_m: ArrayLike, y_m: ArrayLike) -> Array:
    """Points (..., 3) of the sheet's frame where the points (x, y) (...) of the paper are."""
    x, y = np.broadcast_arrays(np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64))
    if curve is None:
        return np.stack([x, y, np.zeros_like(x)], axis=-1)
    (ux, uy), (vx, vy) = curve.axes()
    u, v = ux * x + uy * y, vx * x + vy * y
    p, z = curve.profile_m(u)
    return np.stack([p * ux + v * vx, p * uy + v * vy, z], axis=-1)


def normals(curve: Curve | None, x_m: ArrayLike, y_m: ArrayLike) -> Array:
    """Unit normals (..., 3) of the printed face at the points (x, y) (...) of the paper, in the sheet's frame."""
    x, y = np.broadcast_arrays(np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64))
    if curve is None:
        return np.broadcast_to([0.0, 0.0, 1.0], (*x.shape, 3)).copy()
    (ux, uy), _ = curve.axes()
    theta = curve.slope_rad(ux * x + uy * y)
    return np.stack([np.sin(theta) * ux, np.sin(theta) * uy, np.cos(theta)], axis=-1)


def tangent_frame(curve: Curve | None, x_m: float, y_m: float) -> Array:
    """Pose (4, 4) in the sheet's frame of the tangent plane at (x, y): X and Y are the paper's own directions there."""
    pose = np.eye(4)
    pose[:3, 3] = lifted(curve, x_m, y_m)
    if curve is None:
        return pose
    (ux, uy), (vx, vy) = curve.axes()
    normal = normals(curve, x_m, y_m)
    theta = float(curve.slope_rad(ux * x_m + uy * y_m))
    across = np.array([np.cos(theta) * ux, np.cos(theta) * uy, -np.sin(theta)])
    along = np.array([vx, vy, 0.0])
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = ux * across + vx * along, uy * across + vy * along, normal
    return pose


def strips(curve: Curve, low_m: tuple[float, float], high_m: tuple[float, float]) -> tuple[Array, NDArray[np.int64]]:
    """A rectangle of paper cut into strips along the axis, for a renderer.

    Returns
    -------
    paper_m : (n, 2) array
        Coordinates (x, y) on the paper of the vertices.
    faces : (m, 3) int array
        Triangles, counterclockwise seen from the printed side.
    """
    corners = np.array([[low_m[0], low_m[1]], [high_m[0], low_m[1]], [high_m[0], high_m[1]], [low_m[0], high_m[1]]])
    uv = corners @ curve.axes().T
    u = np.unique(np.concatenate([np.linspace(uv[:, 0].min(), uv[:, 0].max(), _STRIPS + 1), uv[:, 0]]))
    ends = []
    for at in u:
        # Where the line u = at crosses the rectangle's sides.
        v = []
        for a, b in zip(uv, np.roll(uv, -1, axis=0), strict=True):
            low, high = min(a[0], b[0]), max(a[0], b[0])
            if low <= at <= high:
                v += [a[1], b[1]] if high == low else [a[1] + (at - a[0]) / (b[0] - a[0]) * (b[1] - a[1])]
        ends.append((min(v), max(v)))
    low_v, high_v = np.array(ends).T
    low, high = np.stack([u, low_v], axis=-1), np.stack([u, high_v], axis=-1)
    i = np.arange(len(u) - 1)
    bottom, top = i, i + len(u)
    faces = np.concatenate([np.stack([bottom, bottom + 1, top + 1], -1), np.stack([bottom, top + 1, top], -1)])
    return np.concatenate([low, high]) @ curve.axes(), faces
