"""Masks: pixels that an outline covers, by exact areas; COCO's run-length encoding of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.fidelity.pixel_coverage import Areas
from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.conic import circle_points_m

Array = NDArray[np.float64]
Outline = Array
Mask = NDArray[np.bool_]

# Chords of the outline: between them and a circle of radius 1,000 px are at most 0.001 px.
_POINTS = 2048


def outline_of(row: dict[str, Any], pose: Array, diameter_m: float, camera: Camera) -> Outline:
    """(n, 2) outline of a marker's image at the pose of record, distorted; without what the lens does not reach.

    Parameters
    ----------
    row : dict
        Of truth.parquet: on a curved surface the outline is its contour.
    pose : (4, 4) array
    diameter_m : float
    camera : Camera
    """
    if (row.get("surface") or "flat") == "flat":
        points = project(camera, circle_points_m(pose, diameter_m / 2, _POINTS))
    else:
        points = np.column_stack([row["contour_x_px"], row["contour_y_px"]]).astype(np.float64)
    return points[np.isfinite(points).all(axis=1)]


def covered_window(outline: Outline, width_px: int, height_px: int) -> tuple[int, int, Array]:
    """First column, first row and (h, w) fractions of the pixels that a closed outline covers.

    The areas are exact for the chords of the outline. As far as three times the image's size, centred on it.
    """
    window = window_of(outline)
    if window is None:
        return 0, 0, np.zeros((0, 0))
    x0, y0, width, height = window
    left, top = max(x0, -width_px), max(y0, -height_px)
    right, bottom = min(x0 + width, 2 * width_px), min(y0 + height, 2 * height_px)
    if right <= left or bottom <= top:
        return 0, 0, np.zeros((0, 0))
    x, y = outline.T
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0:
        x, y = x[::-1], y[::-1]
    areas = Areas(top, left, bottom - top, right - left)
    areas.add(x, y, np.roll(x, -1), np.roll(y, -1), np.ones((1, len(x))))
    return left, top, areas.inside()[0]


def window_of(outline: Outline) -> tuple[int, int, int, int] | None:
    """Left column, top row, width and height of the pixels that an outline touches, of the image or not."""
    if len(outline) < 3:
        return None
    low = np.floor(outline.min(axis=0) + 0.5).astype(int)
    high = np.floor(outline.max(axis=0) + 0.5).astype(int)
    width, height = (high - low + 1).tolist()
    return int(low[0]), int(low[1]), width, height


def box_of(mask: Mask) -> tuple[int, int, int, int] | None:
    """First column and row, last column and row of the pixels of a mask; None if there are none."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    return int(columns[0]), int(rows[0]), int(columns[-1]), int(rows[-1])


def run_lengths(mask: Mask) -> list[int]:
    """COCO's uncompressed counts: lengths of the runs down the columns, beginning with a run of zeros.

    Examples
    --------
    >>> run_lengths(np.array([[False, True], [True, True]]))
    [1, 3]
    """
    flat = mask.ravel(order="F")
    ends = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    counts = np.diff(np.concatenate([[0], ends, [len(flat)]])).tolist()
    return [0, *counts] if len(flat) and flat[0] else counts


def mask_of_runs(counts: list[int], height_px: int, width_px: int) -> Mask:
    """The mask of `run_lengths`.

    Raises
    ------
    ValueError
        If the runs are not those of an image of this size.
    """
    if any(n < 0 for n in counts) or sum(counts) != height_px * width_px:
        raise ValueError(f"runs of {sum(counts)} pixels, but the image has {height_px * width_px}")
    flat = np.repeat(np.arange(len(counts)) % 2 == 1, counts)
    return np.asarray(flat.reshape((height_px, width_px), order="F"))
