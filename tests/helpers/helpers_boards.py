"""Images of chessboards without a renderer, by supersampling through a Camera; random views of flat points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter

from roundel.scenes.camera.model import Camera, normalise, project, undistort_px
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of, transform_points
from roundel.solver.detect.chessboard_corners import BoardLayout, board_points_m

Array = NDArray[np.float64]


def _ink(camera_xy: Array, pose: Array, layout: BoardLayout) -> NDArray[np.bool_]:
    """Whether the rays of normalised coordinates (..., 2) hit ink."""
    ray = np.concatenate([camera_xy, np.ones((*camera_xy.shape[:-1], 1))], axis=-1)
    normal, centre = pose[:3, 2], pose[:3, 3]
    offset = ray * ((normal @ centre) / (ray @ normal))[..., None] - centre
    column = offset @ pose[:3, 0] / layout.square_m + (layout.columns + 1) / 2
    row = (layout.rows + 1) / 2 - offset @ pose[:3, 1] / layout.square_m
    on_board = (column >= 0) & (column < layout.columns + 1) & (row >= 0) & (row < layout.rows + 1)
    return on_board & ((np.floor(column) + np.floor(row)) % 2 == 0)


@lru_cache(maxsize=4)
def corner_rays(
    width: int, height: int, k: tuple[float, ...], distortion: tuple[float, ...], model: str = "opencv"
) -> Array:
    """Normalised coordinates (H + 1, W + 1, 2) of the pixels' corners."""
    camera = Camera(width, height, np.array(k).reshape(3, 3), distortion, distortion_model=model)
    corner = np.stack(np.meshgrid(np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5), axis=-1)
    return normalise(camera, undistort_px(camera, corner))


def subpixel_rays(corner: Array, pixels: NDArray[np.bool_], count: int) -> Array:
    """Normalised coordinates (N, count^2, 2) within masked pixels; the lens is bilinear in a pixel to 1e-7 px."""
    v, u = np.nonzero(pixels)
    step = (np.arange(count) + 0.5) / count
    x, y = (axis.ravel()[:, None] for axis in np.meshgrid(step, step))
    top = corner[v, u][:, None] * (1 - x) + corner[v, u + 1][:, None] * x
    bottom = corner[v + 1, u][:, None] * (1 - x) + corner[v + 1, u + 1][:, None] * x
    return np.asarray(top * (1 - y) + bottom * y)


def board_image(
    camera: Camera, pose: Array, layout: BoardLayout, subpixels: int = 8, blur_px: float = 0.0
) -> NDArray[np.uint8]:
    """Image (H, W) of a board on paper that fills the view; only pixels crossed by an edge are subdivided."""
    corner = corner_rays(
        camera.width_px, camera.height_px, tuple(camera.K.ravel()), camera.distortion, camera.distortion_model
    )
    ink = _ink(corner, pose, layout)
    count = ink[:-1, :-1].astype(int) + ink[1:, :-1] + ink[:-1, 1:] + ink[1:, 1:]
    coverage = count / 4.0
    mixed = binary_dilation((count > 0) & (count < 4), np.ones((3, 3)))
    coverage[mixed] = _ink(subpixel_rays(corner, mixed, subpixels), pose, layout).mean(axis=1)
    if blur_px:
        coverage = gaussian_filter(coverage, blur_px)
    return np.rint(220.0 - 190.0 * coverage).astype(np.uint8)


def true_corners(camera: Camera, pose: Array, layout: BoardLayout) -> Array:
    """True image (N, 2) of the inner corners."""
    return project(camera, transform_points(pose, board_points_m(layout)))


def board_views(camera: Camera, layout: BoardLayout, count: int, seed: int, span: float = 0.55) -> list[Array]:
    """`count` poses with the whole board in view, distributed over the image; `span` is its fraction of the width."""
    rng = np.random.default_rng(seed)
    size = layout.square_m * (max(layout.columns, layout.rows) + 1)
    near = camera.K[0, 0] * size / (span * camera.width_px)
    views: list[Array] = []
    while len(views) < count:
        distance = near * rng.uniform(1.0, 1.5)
        reach = np.array([camera.width_px, camera.height_px]) / 2 / camera.K[0, 0] * distance
        centre = np.array([*(rng.uniform(-0.6, 0.6, 2) * reach), distance])
        pose = camera_from_marker_of(normal_of(rng.uniform(5, 45), rng.uniform(0, 360)), centre, rng.uniform(-40, 40))
        pixels = true_corners(camera, pose, layout)
        margin = 2.0 * np.linalg.norm(pixels[1] - pixels[0])
        low, high = margin, np.array([camera.width_px, camera.height_px]) - margin
        if np.all((pixels > low) & (pixels < high)):
            views.append(pose)
    return views


# A square of 80 mm, from the top left clockwise.
SIDE_M = 0.08
SQUARE = np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]]) * SIDE_M / 2


def pinhole(focal_px: float) -> Camera:
    return Camera(640, 480, np.array([[focal_px, 0, 319.5], [0, focal_px, 239.5], [0, 0, 1.0]]))


@dataclass(frozen=True)
class PlaneView:
    """A true camera and pose, and the exact image (N, 2) of the points."""

    camera: Camera
    camera_from_marker: Array
    pixels: Array


def plane_views(
    count: int, seed: int, points_m: Array = SQUARE, tilt_deg: tuple[float, float] = (5, 65)
) -> Iterator[PlaneView]:
    """Views with focal lengths of 400 to 1200 px, distances of 3 to 12 sides, and any azimuth and roll."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        camera, distance = pinhole(rng.uniform(400, 1200)), SIDE_M * rng.uniform(3, 12)
        centre = np.array([*(rng.uniform(-0.25, 0.25, 2) * distance), distance])
        roll = rng.uniform(0, 2 * np.pi)
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]]
        pose = camera_from_marker_of(normal_of(rng.uniform(*tilt_deg), rng.uniform(-180, 180)), centre) @ turn
        yield PlaneView(camera, pose, project(camera, transform_points(pose, points_m)))
