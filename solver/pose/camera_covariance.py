"""What the uncertain parameters of a camera do to the ellipse of a circle.

An image pixel that belongs to another ray than the camera's best guess says is a pixel of the undistorted image that
lies elsewhere. So an error of fx, fy, cx, cy or of the lens moves the contour of the ellipse, and with it the fit.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, normalise
from roundel.solver.fit.ellipse import shape_of_ellipse

Array = NDArray[np.float64]

_POINTS = 32  # of the contour: the displacement by a lens is a polynomial of low order in their angle
_PROJECTION = 4


def shape_covariance_of_camera(ellipse: Array, camera: Camera, covariance: Array) -> Array:
    """Covariance (..., 5, 5) of x, y, S11, S12, S22 (px) that a camera's uncertain parameters cause.

    Parameters
    ----------
    ellipse : (..., 5) array
        x_px, y_px, a_px, b_px, angle_deg; undistorted pixel coordinates of the camera.
    camera : Camera
        OpenCV's lens model.
    covariance : (c, c) array
        Of fx, fy, cx, cy (px) and the first c - 4 coefficients of the lens, which may be more than the camera has.
    """
    rates = shape_by_camera(ellipse, camera, len(covariance) - _PROJECTION)
    return np.asarray(rates @ covariance @ np.swapaxes(rates, -1, -2))


def shape_by_camera(ellipse: Array, camera: Camera, coefficients: int) -> Array:
    """Derivative (..., 5, 4 + coefficients) of x, y, S11, S12, S22 by fx, fy, cx, cy and the coefficients of the lens.

    The image is fixed: its points are undistorted by other parameters, and the ellipse is fitted to them anew, by least
    squares of their distances, each weighted by the length of contour that it stands for.

    Parameters
    ----------
    ellipse : (..., 5) array
    camera : Camera
    coefficients : int
        4, 5, 8, 12 or 14.
    """
    shape = shape_of_ellipse(ellipse)
    angle = 2.0 * np.pi * np.arange(_POINTS) / _POINTS
    cos, sin = np.cos(angle), np.sin(angle)
    s11, s12, s22 = (shape[..., i, None] for i in (2, 3, 4))
    contour = np.stack([shape[..., 0, None] + s11 * cos + s12 * sin, shape[..., 1, None] + s12 * cos + s22 * sin], -1)
    along = np.stack([s12 * cos - s11 * sin, s22 * cos - s12 * sin], axis=-1)
    length = np.hypot(along[..., 0], along[..., 1])
    outward = np.stack([along[..., 1], -along[..., 0]], axis=-1) / length[..., None]

    by_camera = np.einsum("...ni,...nip->...np", outward, _displacement(contour, camera, coefficients))
    x, y = outward[..., 0], outward[..., 1]
    by_shape = np.stack([x, y, x * cos, x * sin + y * cos, y * sin], axis=-1)
    weighted = np.swapaxes(by_shape * length[..., None], -1, -2)
    return np.asarray(np.linalg.solve(weighted @ by_shape, weighted @ by_camera))


def _displacement(points: Array, camera: Camera, coefficients: int) -> Array:
    """Derivative (..., 2, c) of undistorted pixels, whose images are fixed, by the parameters."""
    lens = np.zeros(coefficients)
    lens[: len(camera.distortion)] = camera.distortion
    rays = np.ones((points[..., 0].size, 3))
    rays[:, :2] = normalise(camera, points).reshape(-1, 2)
    still = np.zeros(3)
    # OpenCV's derivatives by rotation (3), translation (3), fx, fy, cx, cy and the lens; x and y alternate in rows. At
    # unit depth the translation is a shift of the normalised point.
    _, jacobian = cv2.projectPoints(rays, still, still, camera.K, lens)
    by_point, by_parameter = (jacobian[:, part].reshape(len(rays), 2, -1) for part in (slice(3, 5), slice(6, None)))
    moved = camera.K[:2, :2] @ np.linalg.solve(by_point, -by_parameter)
    return np.asarray(moved.reshape(*points.shape, -1))
