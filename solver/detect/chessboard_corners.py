"""Corners of a chessboard: found by OpenCV, then ordered and refined.

Board frame: origin at the board's centre, X right, Y up, Z out of the print, metres. `columns` and `rows` count inner
corners. The top-left square of the print (smallest X, largest Y) is ink.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.errors import DataError

Array = NDArray[np.float64]


# Outer squares differ by at least this part of the inner squares' contrast; paper beyond a board differs by nothing.
LEAST_OF_CONTRAST = 0.25


@dataclass(frozen=True)
class BoardLayout:
    """A chessboard by its inner corners."""

    columns: int
    rows: int
    square_m: float


def layout_of(layout: Mapping[str, Any]) -> BoardLayout:
    """The layout described by a marker's record in `cameras.json`.

    Raises
    ------
    DataError
        If a key is missing or is not a number.
    """
    try:
        return BoardLayout(int(layout["columns"]), int(layout["rows"]), float(layout["square_m"]))
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"a chessboard's layout needs columns, rows and square_m, not {dict(layout)}") from error


def board_points_m(layout: BoardLayout) -> Array:
    """Inner corners (columns * rows, 3) in the board frame: row by row from the top left, as OpenCV orders them."""
    column, row = np.meshgrid(np.arange(layout.columns), np.arange(layout.rows))
    x = (column - (layout.columns - 1) / 2) * layout.square_m
    y = ((layout.rows - 1) / 2 - row) * layout.square_m
    return np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)


def grey(image: ArrayLike) -> Array:
    """An image (H, W[, C]) of any depth as grey levels (H, W) in [0, 255], float64.

    8-bit images keep their values; deeper images are scaled by their range of values, because OpenCV's detector reads
    8 bits.
    """
    pixels = np.asarray(image)
    levels = pixels.astype(np.float64)
    if levels.ndim == 3:
        levels = levels[..., :3].mean(axis=-1)
    if pixels.dtype == np.uint8:
        return levels
    low, high = float(levels.min()), float(levels.max())
    return (levels - low) * (255.0 / max(high - low, 1e-12))


def detect_corners(image: ArrayLike, columns: int, rows: int) -> Array | None:
    """Inner corners of a chessboard.

    Parameters
    ----------
    image : (H, W[, C]) array_like
        Of any depth.
    columns, rows : int
        Inner corners; one odd and one even, so that the board's orientation is unique.

    Returns
    -------
    (columns * rows, 2) array or None
        Pixels, row by row from the print's top-left corner; None if the board was not found.

    Notes
    -----
    `cv2.findChessboardCornersSB` (Duda and Frese, 2018) finds the grid, but on exact renders its corners share an
    offset of up to 0.06 px within an image, and of 0.4 px if squares are small and tilted. `cv2.cornerSubPix` has no
    such offset, but has a scatter of 0.04 px on sharp images, where finite differences across a step of one pixel do
    not approximate the gradient; a Gaussian of 1.5 px before it reduces the scatter to 0.01 px.
    """
    levels = grey(image)
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(np.rint(levels).astype(np.uint8), (columns, rows), flags=flags)
    if not found or corners.size != 2 * columns * rows:
        return None
    grid = np.asarray(corners, dtype=np.float64).reshape(rows, columns, 2)
    return _upright(refined_corners(levels, grid), levels).reshape(-1, 2)


def refined_corners(levels: Array, grid: Array, square_px: float | None = None) -> Array:
    """Corners refined by `cornerSubPix`, in the largest window without another corner.

    Parameters
    ----------
    levels : (H, W) array
        From `grey`.
    grid : (rows, columns, 2) or (N, 2) array
        The corners, to a pixel.
    square_px : float, optional
        Smallest side of a square; default: that of the grid.
    """
    if square_px is None:
        square_px = float(min(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1)))
    window = int(np.clip(0.4 * square_px, 2, 8))
    # The window must contain twice this blur, or it cuts the Gaussian's tails and the iteration drifts.
    sigma = min(1.5, window / 4)
    smooth = cv2.GaussianBlur(levels.astype(np.float32), (0, 0), sigma)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-6)
    start = np.ascontiguousarray(grid.reshape(-1, 1, 2), dtype=np.float32)
    refined = cv2.cornerSubPix(smooth, start.copy(), (window, window), (-1, -1), criteria)
    moved = np.asarray(refined, dtype=np.float64).reshape(grid.shape)
    # For tilted squares of 15 px the detector is off by a pixel, which the refinement may correct. A correction of more
    # than a quarter of a square has locked on something else, such as a glint, and the detector's corner is kept.
    wandered = np.linalg.norm(moved - grid, axis=-1, keepdims=True) > 0.25 * square_px
    return np.where(wandered, grid, moved)


def _upright(grid: Array, levels: Array) -> Array:
    """The grid (rows, columns, 2) reordered to start at the print's top left, by the colours of the squares."""
    right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if right[0] * down[1] - right[1] * down[0] < 0:
        # A print is never viewed from behind, so the columns were counted backwards.
        grid = grid[:, ::-1]
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    column = np.clip(np.rint(centres[..., 0]).astype(int), 0, levels.shape[1] - 1)
    row = np.clip(np.rint(centres[..., 1]).astype(int), 0, levels.shape[0] - 1)
    ink = np.indices(centres.shape[:2]).sum(axis=0) % 2 == 0
    square = levels[row, column]
    return grid if square[ink].mean() < square[~ink].mean() else grid[::-1, ::-1]


def is_whole_board(image: ArrayLike, corners_px: ArrayLike, columns: int, rows: int) -> bool:
    """Whether the outer squares about the corners are those of the board.

    On squares of a few pixels OpenCV's grid may be shifted by a row: the board's outline is then taken for its last row
    of corners, and the squares beyond it are paper.
    """
    levels, grid = grey(image), np.asarray(corners_px, dtype=np.float64)
    index = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(np.float64)
    h, _ = cv2.findHomography(index, grid)
    if h is None:
        return False
    squares = np.stack(np.meshgrid(np.arange(columns + 1), np.arange(rows + 1)), axis=-1)
    centres = cv2.perspectiveTransform((squares - 0.5).reshape(-1, 1, 2), h).reshape(rows + 1, columns + 1, 2)
    place = np.rint(centres).astype(int)
    inside = np.all((place >= 0) & (place < levels.shape[::-1]), axis=-1)
    place = np.clip(place, 0, np.array(levels.shape[::-1]) - 1)
    seen, ink = levels[place[..., 1], place[..., 0]], squares.sum(axis=-1) % 2 == 0
    inner = np.zeros_like(ink)
    inner[1:-1, 1:-1] = True
    contrast = seen[inner & ~ink].mean() - seen[inner & ink].mean()
    sides = (np.s_[0, :], np.s_[-1, :], np.s_[:, 0], np.s_[:, -1])
    for side in sides:
        dark, light = seen[side][inside[side] & ink[side]], seen[side][inside[side] & ~ink[side]]
        if len(dark) and len(light) and light.mean() - dark.mean() < LEAST_OF_CONTRAST * contrast:
            return False
    return True
