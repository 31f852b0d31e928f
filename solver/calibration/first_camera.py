"""A first camera and first poses from the homographies of a plane, for the bundle adjustment to start from.

With a centred principal point, square pixels and no distortion, each homography gives two equations that are linear in
1 / f^2. Source: Z. Zhang, A flexible new technique for camera calibration, PAMI 22 (2000), section 3.1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, principal_point_at_centre

Array = NDArray[np.float64]

# Focal lengths beyond these parts of the image's width are of no camera: views near to frontal give any number.
_SHORTEST, _LONGEST, _USUAL = 0.3, 30.0, 1.2


def homography(board: Array, image: Array) -> Array:
    """Homography (3, 3) of least algebraic error from board to image points (n, 2); n >= 4, not on a line."""
    to_board, to_image = _normalising(board), _normalising(image)
    a = np.column_stack([board, np.ones(len(board))]) @ to_board.T
    b = np.column_stack([image, np.ones(len(image))]) @ to_image.T
    zero = np.zeros_like(a)
    rows = np.concatenate([np.hstack([a, zero, -b[:, :1] * a]), np.hstack([zero, a, -b[:, 1:2] * a])])
    h = np.linalg.svd(rows)[2][-1].reshape(3, 3)
    return np.asarray(np.linalg.inv(to_image) @ h @ to_board)


def _normalising(points: Array) -> Array:
    mean = points.mean(axis=0)
    scale = np.sqrt(2.0) / np.sqrt(np.mean(np.sum((points - mean) ** 2, axis=1)))
    return np.array([[scale, 0.0, -scale * mean[0]], [0.0, scale, -scale * mean[1]], [0.0, 0.0, 1.0]])


def first_camera(homographies: Sequence[Array], width_px: int, height_px: int, coefficients: int) -> Camera:
    """A camera without distortion from homographies of a plane."""
    centre = np.array(principal_point_at_centre(width_px, height_px))
    rows = []
    for h in homographies:
        m = np.asarray(h, dtype=np.float64).copy()
        m[:2] -= centre[:, None] * m[2]
        m[:2] /= width_px
        m /= np.linalg.norm(m)
        # h1^T w h2 = 0 and h1^T w h1 = h2^T w h2 with w = diag(s, s, 1), s = (width / f)^2
        for a, b in ((m[:, 0], m[:, 1]), (m[:, 0] + m[:, 1], m[:, 0] - m[:, 1])):
            rows.append((a[:2] @ b[:2], -a[2] * b[2]))
    left, right = np.array(rows).T
    focal = float(left @ left / (left @ right)) if left @ right > 0 else 0.0
    focal = np.sqrt(focal) if focal > 0 else _USUAL
    if not _SHORTEST < focal < _LONGEST:
        focal = _USUAL
    f = focal * width_px
    k = np.array([[f, 0.0, centre[0]], [0.0, f, centre[1]], [0.0, 0.0, 1.0]])
    return Camera(width_px, height_px, k, (0.0,) * coefficients)


def pose_of_homography(h: Array, camera: Camera) -> Array:
    """Pose `camera_from_board` (4, 4) of a homography from metres to undistorted pixels: the nearest rotation."""
    m = np.linalg.inv(camera.K) @ h
    m = m / np.sqrt(np.linalg.norm(m[:, 0]) * np.linalg.norm(m[:, 1]))
    if m[2, 2] < 0:
        m = -m
    u, _, vt = np.linalg.svd(np.column_stack([m[:, 0], m[:, 1], np.cross(m[:, 0], m[:, 1])]))
    pose = np.eye(4)
    pose[:3, :3] = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    pose[:3, 3] = m[:, 2]
    return pose
