"""What of a user's meshes is between the camera and the marker, by rays against triangles in float64."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.assets.meshes import UserMesh

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def hidden_by(meshes: Sequence[UserMesh], eye: Array, points: Array) -> list[tuple[str, Mask]]:
    """Meshes that segments from the eye meet, with the points that each hides.

    Parameters
    ----------
    meshes : sequence of UserMesh
    eye : (3,) array
        The camera's centre, in the scene's frame and unit.
    points : (n, 3) array
        In the same frame; close together, as seen from the eye.

    Returns
    -------
    list of (name, (n,) array of bool)
        Only meshes that hide something.
    """
    toward = points - eye
    axis = toward.mean(axis=0)
    distance = float(np.linalg.norm(axis))
    axis = axis / distance
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    x = np.cross(axis, helper)
    x /= np.linalg.norm(x)
    frame = np.stack([x, np.cross(axis, x), axis])
    rays = toward @ frame.T
    # Wider than a pyramid holds (a fisheye close to a board): nothing is left out.
    is_wide = bool((rays[:, 2] < 0.05 * distance).any())
    slopes = np.zeros((1, 2)) if is_wide else rays[:, :2] / rays[:, 2:]
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    found = []
    for mesh in meshes:
        corners = ((mesh.vertices - eye) @ frame.T)[mesh.faces]
        near = corners if is_wide else corners[_in_pyramid(corners, low, high, float(rays[:, 2].max()))]
        mask = _meets(near, rays)
        if mask.any():
            found.append((mesh.name, mask))
    return found


def _in_pyramid(corners: Array, low: Array, high: Array, far: float) -> Mask:
    """Triangles (m, 3, 3) that may reach into the pyramid of slopes between `low` and `high`, from 0 to `far`."""
    z = corners[..., 2]
    outside = (z <= 0).all(axis=1) | (z > far).all(axis=1)
    for i in range(2):
        # Planes through the eye: all three corners on the outer side of one.
        outside |= (corners[..., i] < low[i] * z).all(axis=1) | (corners[..., i] > high[i] * z).all(axis=1)
    return np.asarray(~outside)


def _meets(corners: Array, rays: Array) -> Mask:
    """Which segments from the origin to `rays` (n, 3) meet a triangle (Moeller and Trumbore 1997)."""
    mask = np.zeros(len(rays), dtype=bool)
    if len(corners) == 0:
        return mask
    a = corners[:, 0]
    first, second = corners[:, 1] - a, corners[:, 2] - a
    q = np.cross(-a, first)
    reach = np.sum(second * q, axis=1)
    for i, ray in enumerate(rays):
        p = np.cross(ray, second)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / np.sum(first * p, axis=1)
            u, v, t = np.sum(-a * p, axis=1) * inverse, (q @ ray) * inverse, reach * inverse
        mask[i] = bool(((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1)).any())
    return mask
