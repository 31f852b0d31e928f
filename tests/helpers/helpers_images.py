"""Images of ellipses without a renderer: area of each pixel inside the ellipse, by supersampling."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter

from roundel.scenes.camera.model import Camera, undistort_px

Array = NDArray[np.float64]


def _inside(ellipse: Array, x: Array, y: Array) -> Array:
    """(x/a)^2 + (y/b)^2 in the ellipse's frame: below 1 inside."""
    angle = np.radians(ellipse[4])
    c, s = np.cos(angle), np.sin(angle)
    dx, dy = x - ellipse[0], y - ellipse[1]
    return ((c * dx + s * dy) / ellipse[2]) ** 2 + ((c * dy - s * dx) / ellipse[3]) ** 2


def coverage(ellipse: ArrayLike, width_px: int, height_px: int, blur_px: float = 0.0, subpixels: int = 32) -> Array:
    """Fraction (H, W) of each pixel inside an ellipse, optionally after a Gaussian blur of the ideal image."""
    e = np.asarray(ellipse, dtype=np.float64)
    if blur_px == 0.0:
        return _box_coverage(e, width_px, height_px, subpixels)
    # The blur comes before the pixel's aperture: use a grid eight times as fine, whose pixels are also areas.
    fine, reach = 8, int(np.ceil(e[2] + 6 * blur_px + 2))
    x0, y0 = round(float(e[0])) - reach, round(float(e[1])) - reach
    size = 2 * reach + 1
    local = np.array([(e[0] - x0 + 0.5) * fine - 0.5, (e[1] - y0 + 0.5) * fine - 0.5, e[2] * fine, e[3] * fine, e[4]])
    soft = gaussian_filter(_box_coverage(local, size * fine, size * fine, 4), blur_px * fine, truncate=6.0)
    patch = soft.reshape(size, fine, size, fine).mean(axis=(1, 3))
    out = np.zeros((height_px, width_px))
    left, top = max(x0, 0), max(y0, 0)
    right, bottom = min(x0 + size, width_px), min(y0 + size, height_px)
    if left < right and top < bottom:
        out[top:bottom, left:right] = patch[top - y0 : bottom - y0, left - x0 : right - x0]
    return out


def _box_coverage(e: Array, width_px: int, height_px: int, subpixels: int) -> Array:
    y, x = np.mgrid[:height_px, :width_px].astype(np.float64)
    radius = np.sqrt(_inside(e, x, y))
    # The contour is at least b |radius - 1| away: it cuts only pixels within half a diagonal of it.
    cut = np.abs(radius - 1.0) <= 0.75 / e[3]
    out = np.where(cut, 0.0, (radius < 1.0).astype(np.float64))
    offsets = (np.arange(subpixels) + 0.5) / subpixels - 0.5
    oy, ox = np.meshgrid(offsets, offsets, indexing="ij")
    xs, ys = x[cut][:, None] + ox.ravel(), y[cut][:, None] + oy.ravel()
    out[cut] = np.mean(_inside(e, xs, ys) < 1.0, axis=1)
    return out


def picture(
    layers: Sequence[tuple[ArrayLike, float]],
    width_px: int,
    height_px: int,
    paper_dn: float = 200.0,
    blur_px: float = 0.0,
    noise_dn: float = 0.0,
    seed: int = 0,
    subpixels: int = 32,
) -> NDArray[np.uint8]:
    """An 8-bit image of ellipses painted over one another: (ellipse, grey level) from back to front."""
    image = np.full((height_px, width_px), float(paper_dn))
    for ellipse, level in layers:
        cover = coverage(ellipse, width_px, height_px, blur_px, subpixels)
        image += (level - image) * cover
    if noise_dn > 0:
        image += np.random.default_rng(seed).normal(0.0, noise_dn, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def coverage_through_lens(ellipse: ArrayLike, camera: Camera, subpixels: int = 16) -> Array:
    """Fraction (H, W) of each pixel inside an ellipse of undistorted pixel coordinates, seen through the distortion."""
    e = np.asarray(ellipse, dtype=np.float64)
    grid = np.stack(np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px)), axis=-1).astype(np.float64)
    straight = undistort_px(camera, grid)
    radius = np.sqrt(_inside(e, straight[..., 0], straight[..., 1]))
    cut = np.abs(radius - 1.0) <= 1.5 / e[3]  # as above, with room for the lens's own scale
    out = np.where(cut, 0.0, (radius < 1.0).astype(np.float64))
    offsets = (np.arange(subpixels) + 0.5) / subpixels - 0.5
    steps = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    fine = undistort_px(camera, grid[cut][:, None] + steps)
    out[cut] = np.mean(_inside(e, fine[..., 0], fine[..., 1]) < 1.0, axis=1)
    return out
