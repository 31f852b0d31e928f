"""Images of chessboards and circle grids without a renderer, exact dots, and random views of flat points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter

from roundel.scenes.camera.model import Camera, normalise, project, undistort_px
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of, transform_points
from roundel.solver.calibration.contour_model import Dots, rotations
from roundel.solver.calibration.grid_layout import GridLayout
from roundel.solver.detect.chessboard_corners import BoardLayout, board_points_m
from roundel.solver.fit.ellipse import fit_ellipse, shape_of_ellipse

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


GRID = GridLayout(6, 5, 0.03, 0.018)
ASYMMETRIC_GRID = GridLayout(4, 7, 0.02, 0.014, asymmetric=True)
GRID_CAMERA = Camera(
    640, 480, np.array([[700.0, 0.0, 322.0], [0.0, 703.0, 236.0], [0.0, 0.0, 1.0]]), (-0.25, 0.08, 1e-3, -5e-4)
)


def grid_pose(tilt_deg: float, azimuth_deg: float, roll_deg: float, x: float, y: float, z: float) -> Array:
    """`camera_from_board`: facing the camera, rolled in its plane, then tilted about an axis in the image."""
    facing = np.diag([1.0, -1.0, -1.0])
    axis = np.radians(azimuth_deg)
    turns = np.radians([[0.0, 0.0, roll_deg], [tilt_deg * np.cos(axis), tilt_deg * np.sin(axis), 0.0]])
    roll, tilt = rotations(turns)
    out = np.eye(4)
    out[:3, :3] = tilt @ roll @ facing
    out[:3, 3] = x, y, z
    return out


def grid_poses(count: int, seed: int = 0, distance_m: float = 0.42) -> list[Array]:
    """Views tilted by 15 to 40 degrees in evenly spaced directions."""
    rng = np.random.default_rng(seed)
    return [
        grid_pose(
            rng.uniform(15, 40), 360 * k / count + rng.uniform(0, 20), rng.uniform(-180, 180),
            rng.uniform(-0.02, 0.02), rng.uniform(-0.02, 0.02), distance_m * rng.uniform(0.95, 1.15),
        )
        for k in range(count)
    ]  # fmt: skip


def grid_contours(camera: Camera, board_pose: Array, layout: GridLayout, points: int = 512, rise: Any = None) -> Array:
    """Images (n, points, 2) of the dots' contours; `rise(x, y)` is the board's height above its plane, m."""
    turn = 2 * np.pi * np.arange(points) / points
    xy = layout.centres_m()[:, None] + layout.diameter_m / 2 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    z = np.zeros(xy.shape[:2]) if rise is None else rise(xy[..., 0], xy[..., 1])
    board = np.concatenate([xy, z[..., None]], axis=-1)
    return project(camera, board @ board_pose[:3, :3].T + board_pose[:3, 3])


def fitted_shape(contour: Array) -> Array:
    """Least-squares ellipse of a contour with all its length weighed alike, by the solver's other fit."""
    step = np.linalg.norm(np.roll(contour, -1, axis=0) - np.roll(contour, 1, axis=0), axis=1)
    fit = fit_ellipse(contour, 1 / np.sqrt(step), tolerance=1e-13)
    assert fit
    return np.asarray(shape_of_ellipse(fit.ellipse))


def exact_dots(
    camera: Camera, board_poses: Sequence[Array], layout: GridLayout, sigma_px: float = 0.01, rise: Any = None
) -> Dots:
    """Exact dots of all views, with a covariance of `sigma_px` in each parameter."""
    shapes = [fitted_shape(c) for p in board_poses for c in grid_contours(camera, p, layout, rise=rise)]
    n = len(layout.centres_m())
    view = np.repeat(np.arange(len(board_poses)), n)
    centres = np.tile(layout.centres_m(), (len(board_poses), 1))
    cov = np.broadcast_to(sigma_px**2 * np.eye(5), (len(view), 5, 5)).copy()
    return Dots(view, centres, np.array(shapes), cov)


def grid_image(
    camera: Camera, board_pose: Array, layout: GridLayout, noise: float = 1.0, seed: int = 0
) -> NDArray[np.uint8]:
    """A picture of the grid: each pixel is the mean of 12 by 12 points inside or outside the contours, plus noise."""
    image = np.full((camera.height_px, camera.width_px), 200.0)
    part = (np.arange(12) + 0.5) / 12 - 0.5
    for contour in grid_contours(camera, board_pose, layout, 1024):
        left, top = np.floor(contour.min(axis=0)).astype(int) - 1
        right, bottom = np.ceil(contour.max(axis=0)).astype(int) + 1
        columns, rows = np.arange(left, right + 1), np.arange(top, bottom + 1)
        middle = contour.mean(axis=0)
        x, y = np.meshgrid((columns[:, None] + part).ravel() - middle[0], (rows[:, None] + part).ravel() - middle[1])
        # The contour as a radius by angle about a point inside it.
        angle, radius = np.arctan2(*(contour - middle).T[::-1]), np.linalg.norm(contour - middle, axis=1)
        order = np.argsort(angle)
        inside = np.hypot(x, y) < np.interp(np.arctan2(y, x), angle[order], radius[order], period=2 * np.pi)
        cover = inside.reshape(len(rows), 12, len(columns), 12).mean(axis=(1, 3))
        ys, xs = np.ix_(np.isin(rows, np.arange(camera.height_px)), np.isin(columns, np.arange(camera.width_px)))
        image[rows[ys], columns[xs]] -= 170.0 * cover[ys, xs]
    image += np.random.default_rng(seed).normal(0.0, noise, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
