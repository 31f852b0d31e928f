"""A first camera from the homographies of a plane, for the bundle adjustment to start from.

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
