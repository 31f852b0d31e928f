"""Realistic lenses: coefficients of the size found in calibrations of real cameras, one for each count."""

from __future__ import annotations

import numpy as np

from roundel.scenes.camera.model import Camera

K = np.array([[913.0, 0.7, 641.2], [0.0, 905.0, 355.7], [0.0, 0.0, 1.0]])
K_WIDE = np.array([[400.0, 1.5, 640.2], [0.0, 405.0, 355.7], [0.0, 0.0, 1.0]])

# The rational ones nearly cancel between numerator and denominator, like fitted ones.
RATIONAL = (0.52, -2.63, 0.0005, -0.0002, 1.52, 0.40, -2.45, 1.44)
PRISM = (*RATIONAL, 0.002, -0.001, -0.003, 0.0005)
OPENCV = {
    "4": (-0.21, 0.06, 0.001, -0.002),
    "5": (-0.3, 0.12, 0.001, -0.002, -0.02),
    "8": RATIONAL,
    "12": PRISM,
    "14": (*PRISM, 0.03, -0.05),
    "pincushion": (0.3, 0.1, -0.001, 0.002),
}
# The corners of 1280 x 720 px are 98 to 113 degrees from the axis.
FISHEYE = {
    "equidistant": (0.0, 0.0, 0.0, 0.0),
    "stretched": (0.05, -0.01, 0.002, -0.0005),
    "squeezed": (-0.02, 0.003, -0.001, 0.0001),
}


def lens(name: str) -> Camera:
    """A camera of 1280 x 720 px with one of the lenses above."""
    if name in FISHEYE:
        return Camera(1280, 720, K_WIDE, FISHEYE[name], distortion_model="fisheye")
    return Camera(1280, 720, K, OPENCV[name])


def image_grid(camera: Camera, columns: int = 65, rows: int = 37) -> np.ndarray:
    """Points (n, 2) over the whole image, including its outer edges."""
    u, v = np.linspace(-0.5, camera.width_px - 0.5, columns), np.linspace(-0.5, camera.height_px - 0.5, rows)
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
