"""Where the sheet lies in a user's scene: the pose that takes the sheet's frame to the scene's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.assets.meshes import UserMesh

Array = NDArray[np.float64]

# Below this, in radians or as a length, a direction is none.
_LEAST = 1e-6


def scene_from_sheet(position_m: ArrayLike, normal: ArrayLike, up: ArrayLike, thickness_m: float) -> Array:
    """Pose (4, 4) of the sheet in the scene's axes, metres.

    Parameters
    ----------
    position_m : (3,) array_like
        Where the back of the sheet is, behind the origin of the sheet's frame (the centre of its first marker).
    normal : (3,) array_like
        Out of the surface, of any length: the sheet's Z.
    up : (3,) array_like
        Toward the upper edge of the print, the sheet's Y; its part along the normal is dropped.
    thickness_m : float
        Of the sheet.

    Raises
    ------
    ValueError
        If the normal is zero, or `up` is zero or parallel to it.
    """
    n, u = (np.asarray(v, dtype=np.float64) for v in (normal, up))
    if not np.linalg.norm(n) > _LEAST:
        raise ValueError("normal: is zero; give a direction out of the surface")
    z = n / np.linalg.norm(n)
    if not np.linalg.norm(u) > _LEAST:
        raise ValueError("up: is zero; give the direction of the print's upper edge")
    across = u / np.linalg.norm(u)
    across = across - (across @ z) * z
    if not np.linalg.norm(across) > _LEAST:
        raise ValueError("up: is parallel to the normal; give a direction along the surface")
    y = across / np.linalg.norm(across)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(y, z), y, z], axis=-1)
    pose[:3, 3] = np.asarray(position_m, dtype=np.float64) + thickness_m * z
    return pose


def top_m(meshes: Sequence[UserMesh], unit_m: float, axis: int) -> Array:
    """The highest point (3,) on the vertical through the middle of the meshes' bounding box, metres.

    Raises
    ------
    ValueError
        If the vertical meets nothing.
    """
    low = np.min([mesh.vertices.min(axis=0) for mesh in meshes], axis=0)
    high = np.max([mesh.vertices.max(axis=0) for mesh in meshes], axis=0)
    middle = (low + high) / 2
    flat = [i for i in range(3) if i != axis]
    best = -np.inf
    for mesh in meshes:
        corners = mesh.vertices[mesh.faces]
        a, b, c = (corners[:, i][:, flat] - middle[flat] for i in range(3))
        areas = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=-1)
        whole = areas.sum(axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = areas / whole[:, None]
        hit = (np.abs(whole) > 0) & (weights >= -1e-12).all(axis=-1)
        if hit.any():
            best = max(best, float((weights[hit] * corners[hit][:, :, axis]).sum(axis=-1).max()))
    if not np.isfinite(best):
        raise ValueError("nothing is in the middle of the scene for the sheet to lie on; give anchor.position_m")
    middle[axis] = best
    return np.asarray(middle * unit_m)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
