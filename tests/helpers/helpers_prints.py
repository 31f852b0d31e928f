"""Random views of a printed plane, and noise-free drawings of prints of discs by supersampling."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.response_curve import LINEAR
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of
from roundel.solver.methods.plugin import View

Array = NDArray[np.float64]


def plane_view(
    rng: np.random.Generator, tilt_deg: tuple[float, float] = (5.0, 65.0), distance: tuple[float, float] = (8.0, 60.0)
) -> tuple[Array, Array]:
    """Pose (4, 4) of a marker in outer radii, and K, of a random view that has all of it before the camera."""
    while True:
        focal = rng.uniform(300.0, 1500.0)
        K = np.array([[focal, 0.0, 319.5], [0.0, focal, 239.5], [0.0, 0.0, 1.0]])
        normal = normal_of(rng.uniform(*tilt_deg), rng.uniform(-180.0, 180.0))
        depth = np.exp(rng.uniform(*np.log(distance)))
        centre = depth * np.array([rng.uniform(-0.2, 0.2), rng.uniform(-0.15, 0.15), 1.0])
        if normal @ centre < -0.2 * depth:
            return camera_from_marker_of(normal, centre, rng.uniform(0.0, 360.0)), K


def plane_homography(pose: Array, K: Array) -> Array:
    """From the marker's plane to pixels, (3, 3)."""
    matrix = K @ pose[:3, [0, 1, 3]]
    return np.asarray(matrix / matrix[2, 2])


def drawn(
    shape: tuple[int, int],
    matrix: Array,
    discs: Array,
    weights: Array,
    blur_px: float = 0.6,
    paper: float = 200.0,
    ink: float = 12.0,
    fine: int = 10,
) -> Array:
    """Levels (H, W) of a print: ink where the sum of the weights of the discs that hold a point is 1."""
    height, width = shape
    x = (np.arange(width * fine) + 0.5) / fine - 0.5
    y = (np.arange(height * fine) + 0.5) / fine - 0.5
    grid = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))])
    plane = np.einsum("ij,jyx->iyx", np.linalg.inv(matrix), grid)
    px, py = plane[:2] / plane[2]
    covered = np.zeros_like(px)
    for (cx, cy, r), weight in zip(discs, weights, strict=True):
        covered += weight * (np.hypot(px - cx, py - cy) < r)
    covered = gaussian_filter(covered, blur_px * fine, truncate=6)
    return np.asarray(paper - (paper - ink) * covered.reshape(height, fine, width, fine).mean(axis=(1, 3)))


def small_view(
    rng: np.random.Generator, semi_px: tuple[float, float] = (20.0, 30.0), tilt_deg: tuple[float, float] = (5.0, 60.0)
) -> tuple[Array, Array]:
    """Pose in outer radii and K of a marker of this size in an image of 96 by 96 px."""
    focal = rng.uniform(300.0, 700.0)
    K = np.array([[focal, 0.0, 47.5], [0.0, focal, 47.5], [0.0, 0.0, 1.0]])
    depth = focal / rng.uniform(*semi_px)
    centre = depth * np.array([rng.uniform(-6.0, 6.0) / focal, rng.uniform(-6.0, 6.0) / focal, 1.0])
    normal = normal_of(rng.uniform(*tilt_deg), rng.uniform(-180.0, 180.0))
    return camera_from_marker_of(normal, centre, rng.uniform(0.0, 360.0)), K


def view_of(levels: Array, K: Array, kind: str, layout: dict[str, Any] | None = None, focal_sigma: float = 0.0) -> View:
    """A view of 16 bits, so that rounding is no noise; the marker has a diameter of 2 m, its radius is the unit."""
    image = np.rint(np.clip(levels, 0, 255) * 257).astype(np.uint16)
    camera = Camera(levels.shape[1], levels.shape[0], K)
    marker = {"marker_id": 0, "kind": kind, "diameter_m": 2.0, "layout": layout or {}}
    return View(image, camera, 2.0, [marker], 65535.0, LINEAR, focal_sigma)
