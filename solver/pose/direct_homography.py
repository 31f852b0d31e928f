"""Homography from points of a plane to the image, and the pose that it shows, without iteration.

Source: R. Hartley, A. Zisserman, Multiple View Geometry (2004), section 4.4.4 (normalised direct linear
transformation); Z. Zhang, A flexible new technique for camera calibration, PAMI 22 (2000), section 3.1 and appendix C
(pose).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_DEGENERATE = 1e-10  # ratio of singular values: below it a second homography explains the points


def homography(plane: ArrayLike, image: ArrayLike) -> Array:
    """Homography (3, 3) of least algebraic error from points of a plane to their images, with H[2, 2] = 1.

    Parameters
    ----------
    plane : (n, 2) array_like
        Four points or more; the plane's origin has an image.
    image : (n, 2) array_like

    Raises
    ------
    ValueError
        If the points do not determine it.
    """
    points, pixels = np.asarray(plane, dtype=np.float64), np.asarray(image, dtype=np.float64)
    if len(points) < 4:
        raise ValueError(f"a homography needs four points; there are {len(points)}")
    to_plane, to_image = _normalising(points), _normalising(pixels)
    ones = np.ones((len(points), 1))
    a, b = np.hstack([points, ones]) @ to_plane.T, np.hstack([pixels, ones]) @ to_image.T
    zero = np.zeros_like(a)
    rows = np.concatenate([np.hstack([a, zero, -b[:, :1] * a]), np.hstack([zero, a, -b[:, 1:2] * a])])
    _, values, vectors = np.linalg.svd(rows)
    if not values[7] > _DEGENERATE * values[0]:
        raise ValueError("the points do not determine a homography: three of four lie in a line")
    h = np.linalg.inv(to_image) @ vectors[8].reshape(3, 3) @ to_plane
    return np.asarray(h / h[2, 2])


def _normalising(points: Array) -> Array:
    """Similarity (3, 3) to points about the origin, at a mean squared distance of 2."""
    middle = points.mean(axis=0)
    spread = float(np.sqrt(np.mean(np.sum((points - middle) ** 2, axis=1)))) or 1.0
    scale = np.sqrt(2.0) / spread
    return np.array([[scale, 0.0, -scale * middle[0]], [0.0, scale, -scale * middle[1]], [0.0, 0.0, 1.0]])


def pose_of_homography(h: ArrayLike, K: ArrayLike) -> Array:
    """Pose `camera_from_plane` (4, 4) of a homography from metres to undistorted pixels: the nearest rotation."""
    m = np.linalg.solve(np.asarray(K, dtype=np.float64), np.asarray(h, dtype=np.float64))
    m = m / np.sqrt(np.linalg.norm(m[:, 0]) * np.linalg.norm(m[:, 1]))
    if m[2, 2] < 0:
        m = -m
    u, _, vt = np.linalg.svd(np.column_stack([m[:, 0], m[:, 1], np.cross(m[:, 0], m[:, 1])]))
    pose = np.eye(4)
    pose[:3, :3] = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    pose[:3, 3] = m[:, 2]
    return pose
