"""Circle grids in exact images: contours, drawn pictures and measured dots."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, project
from roundel.solver.calibration.contour_model import Dots, rotations
from roundel.solver.calibration.grid_layout import GridLayout
from roundel.solver.fit.ellipse import fit_ellipse, shape_of_ellipse

Array = NDArray[np.float64]

LAYOUT = GridLayout(6, 5, 0.03, 0.018)
ASYMMETRIC = GridLayout(4, 7, 0.02, 0.014, asymmetric=True)
CAMERA = Camera(
    640, 480, np.array([[700.0, 0.0, 322.0], [0.0, 703.0, 236.0], [0.0, 0.0, 1.0]]), (-0.25, 0.08, 1e-3, -5e-4)
)


def pose(tilt_deg: float, azimuth_deg: float, roll_deg: float, x: float, y: float, z: float) -> Array:
    """`camera_from_board`: facing the camera, rolled in its plane, then tilted about an axis in the image."""
    facing = np.diag([1.0, -1.0, -1.0])
    axis = np.radians(azimuth_deg)
    turns = np.radians([[0.0, 0.0, roll_deg], [tilt_deg * np.cos(axis), tilt_deg * np.sin(axis), 0.0]])
    roll, tilt = rotations(turns)
    out = np.eye(4)
    out[:3, :3] = tilt @ roll @ facing
    out[:3, 3] = x, y, z
    return out


def poses(count: int, seed: int = 0, distance_m: float = 0.42) -> list[Array]:
    """Views tilted by 15 to 40 degrees in evenly spaced directions."""
    rng = np.random.default_rng(seed)
    return [
        pose(
            rng.uniform(15, 40), 360 * k / count + rng.uniform(0, 20), rng.uniform(-180, 180),
            rng.uniform(-0.02, 0.02), rng.uniform(-0.02, 0.02), distance_m * rng.uniform(0.95, 1.15),
        )
        for k in range(count)
    ]  # fmt: skip


def contours(camera: Camera, board_pose: Array, layout: GridLayout, points: int = 512, rise: Any = None) -> Array:
    """Images (n, points, 2) of the dots' contours; `rise(x, y)` is the board's height above its plane, m."""
    turn = 2 * np.pi * np.arange(points) / points
    xy = layout.centres_m()[:, None] + layout.diameter_m / 2 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    z = np.zeros(xy.shape[:2]) if rise is None else rise(xy[..., 0], xy[..., 1])
    board = np.concatenate([xy, z[..., None]], axis=-1)
    return project(camera, board @ board_pose[:3, :3].T + board_pose[:3, 3])


def fitted(contour: Array) -> Array:
    """Least-squares ellipse of a contour with all its length weighed alike, by the solver's other fit."""
    step = np.linalg.norm(np.roll(contour, -1, axis=0) - np.roll(contour, 1, axis=0), axis=1)
    fit = fit_ellipse(contour, 1 / np.sqrt(step), tolerance=1e-13)
    assert fit
    return np.asarray(shape_of_ellipse(fit.ellipse))


def dots_of(
    camera: Camera, board_poses: Sequence[Array], layout: GridLayout, sigma_px: float = 0.01, rise: Any = None
) -> Dots:
    """Exact dots of all views, with a covariance of `sigma_px` in each parameter."""
    shapes = [fitted(c) for p in board_poses for c in contours(camera, p, layout, rise=rise)]
    n = len(layout.centres_m())
    view = np.repeat(np.arange(len(board_poses)), n)
    centres = np.tile(layout.centres_m(), (len(board_poses), 1))
    cov = np.broadcast_to(sigma_px**2 * np.eye(5), (len(view), 5, 5)).copy()
    return Dots(view, centres, np.array(shapes), cov)


def drawn(
    camera: Camera, board_pose: Array, layout: GridLayout, noise: float = 1.0, seed: int = 0
) -> NDArray[np.uint8]:
    """A picture of the grid: each pixel is the mean of 12 by 12 points inside or outside the contours, plus noise."""
    image = np.full((camera.height_px, camera.width_px), 200.0)
    part = (np.arange(12) + 0.5) / 12 - 0.5
    for contour in contours(camera, board_pose, layout, 1024):
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
