"""Bodies as triangles, with normals and texture coordinates at real scale.

All are meshes, spheres and cylinders too: what an analytic shape knows of its place is a constant of the kernel, and
each frame would be compiled anew; the vertices of a mesh are data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.surroundings.bodies import Body

Array = NDArray[np.float64]

_TURNS = 64
_TUBE_SIDES = 12
# Edges of a profile that turn by more than this are sharp: a long face must not borrow the normal of a short one.
_SHARP_DEG = 20.0


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices (n, 3) and normals (n, 3) in the body's frame, texture coordinates (n, 2) in metres, faces (m, 3)."""

    vertices: Array
    normals: Array
    uv_m: Array
    faces: NDArray[np.int64]


def mesh_of(body: Body) -> Mesh:
    """The triangles of a body."""
    if body.shape == "box":
        return _box(body.half_m)
    if body.shape == "tube":
        assert body.path is not None
        return _tube(body.path, body.radius_m)
    if body.shape == "sphere":
        angle = np.linspace(-np.pi / 2, np.pi / 2, _TURNS // 2 + 1)
        profile = body.half_m[2] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    elif body.shape == "cylinder":
        r, h = body.half_m[0], body.half_m[2]
        profile = np.array([[0.0, -h], [r, -h], [r, h], [0.0, h]])
    else:
        assert body.profile is not None
        profile = body.profile
    return _revolved(profile)


def _box(half: Array) -> Mesh:
    """Six faces; v runs along Z on the upright ones, so that courses of bricks lie flat."""
    vertices: list[Array] = []
    normals, uv, faces = [], [], []
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
    for axis in range(3):
        # u and v of a face: of the two other axes the later one is v.
        u, v = [i for i in range(3) if i != axis]
        for sign in (-1.0, 1.0):
            corner = np.zeros((4, 3))
            corner[:, axis], corner[:, u], corner[:, v] = (
                sign * half[axis],
                square[:, 0] * half[u],
                square[:, 1] * half[v],
            )
            outward = np.zeros(3)
            outward[axis] = sign
            turned = np.cross(corner[1] - corner[0], corner[2] - corner[0]) @ outward < 0
            start = 4 * len(vertices)
            order = [[0, 2, 1], [0, 3, 2]] if turned else [[0, 1, 2], [0, 2, 3]]
            faces.append(start + np.array(order))
            vertices.append(corner)
            normals.append(np.repeat(outward[None], 4, axis=0))
            uv.append(corner[:, [u, v]])
    return Mesh(np.concatenate(vertices), np.concatenate(normals), np.concatenate(uv), np.concatenate(faces))


def _revolved(profile: Array) -> Mesh:
    """A solid about Z from (radius, z) points, bottom to top; sharp where the profile turns sharply."""
    step = np.diff(profile, axis=0)
    length = np.linalg.norm(step, axis=1)
    keep = length > 1e-9
    start, step, length = profile[:-1][keep], step[keep], length[keep]
    # Outward: the profile runs upward on the outside.
    flat = np.stack([step[:, 1], -step[:, 0]], axis=-1) / length[:, None]
    cosine = np.sum(flat[1:] * flat[:-1], axis=1)
    smooth = cosine > np.cos(np.radians(_SHARP_DEG))
    first, last = flat.copy(), flat.copy()
    mean = flat[1:] + flat[:-1]
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    last[:-1][smooth], first[1:][smooth] = mean[smooth], mean[smooth]
    turn = np.linspace(0.0, 2 * np.pi, _TURNS + 1)
    c, s = np.cos(turn), np.sin(turn)
    vertices, normals, uv, faces = [], [], [], []
    travelled = np.concatenate([[0.0], np.cumsum(length)])
    for i in range(len(start)):
        for point, normal, v in (
            (start[i], first[i], travelled[i]), (start[i] + step[i], last[i], travelled[i + 1]),
        ):  # fmt: skip
            vertices.append(np.stack([point[0] * c, point[0] * s, np.full_like(c, point[1])], axis=-1))
            normals.append(np.stack([normal[0] * c, normal[0] * s, np.full_like(c, normal[1])], axis=-1))
            uv.append(np.stack([turn * max(float(profile[:, 0].max()), 1e-3), np.full_like(c, v)], axis=-1))
        faces.append(_ring_faces(2, _TURNS + 1) + 2 * i * (_TURNS + 1))
    return Mesh(np.concatenate(vertices), np.concatenate(normals), np.concatenate(uv), np.concatenate(faces))


def _tube(path: Array, radius_m: float) -> Mesh:
    """A tube of circular section along a path in a plane Z = constant."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    up = np.array([0.0, 0.0, 1.0])
    across = np.cross(up, along)
    turn = np.linspace(0.0, 2 * np.pi, _TUBE_SIDES + 1)
    ring = np.cos(turn)[None, :, None] * across[:, None] + np.sin(turn)[None, :, None] * up
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(turn[None, :] * radius_m, travelled[:, None]), axis=-1)
    vertices = path[:, None] + radius_m * ring
    faces = _ring_faces(len(path), _TUBE_SIDES + 1)
    return Mesh(vertices.reshape(-1, 3), ring.reshape(-1, 3), uv.reshape(-1, 2), faces)


def _ring_faces(rings: int, points: int) -> NDArray[np.int64]:
    """Faces between rings of `points` vertices, outward for rings that go counter-clockwise and upward."""
    sides = points - 1
    ring, side = np.mgrid[0 : rings - 1, 0:sides].reshape(2, -1)
    a, b = ring * points + side, ring * points + side + 1
    return np.concatenate([np.stack([a, b, b + points], axis=-1), np.stack([a, b + points, a + points], axis=-1)])
