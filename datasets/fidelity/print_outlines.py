"""The pattern of a print as closed edges with their reflectance steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.markers.marker import Bar, Cells, Checker, Disc, Shape, Sheet

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Outline:
    """A closed edge in the plane of a sheet, and the increase of the reflectance inside it.

    A circle of `radius_m` about (x_m, y_m), or else a polygon of `corners_m` (n, 2), counterclockwise seen from the
    front. `softness_m` is the width of its ramp.
    """

    step: float
    softness_m: float
    x_m: float = 0.0
    y_m: float = 0.0
    radius_m: float = 0.0
    corners_m: Array | None = None

    def points_m(self, count: int, ramp: Array) -> tuple[Array, Array]:
        """Coordinates (m, count) of points along it, for m ramp positions (m, 2); clockwise seen from the front."""
        shift = self.softness_m * ramp
        if self.corners_m is None:
            turn = -2 * np.pi * np.arange(count) / count
            # Slightly larger, so that the polygon has the circle's area.
            swell = np.sqrt(2 * np.pi / count / np.sin(2 * np.pi / count))
            radius = (self.radius_m + shift[:, :1]) * swell
            return self.x_m + radius * np.cos(turn), self.y_m + radius * np.sin(turn)
        # y points down in the image: the reversed order of corners runs from +x toward +y there.
        corners = self.corners_m[::-1]
        lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        counts = np.maximum(1, np.round(count * lengths / lengths.sum())).astype(np.int64)
        sides = [
            a + (b - a) * (np.arange(n) / n)[:, None]
            for a, b, n in zip(corners, np.roll(corners, -1, axis=0), counts, strict=True)
        ]
        line = np.concatenate(sides)
        return line[:, 0] + shift[:, :1], line[:, 1] + shift[:, 1:]


def _rectangle(x: float, y: float, width: float, height: float, turn_deg: float = 0.0) -> Array:
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    half = np.array([[-width, -height], [width, -height], [width, height], [-width, height]]) / 2
    return np.asarray(np.array([x, y]) + half @ np.array([[c, s], [-s, c]]), dtype=np.float64)


def _of_shape(shape: Shape, beneath: float, softness_m: float) -> list[Outline]:
    step = shape.reflectance - beneath
    if isinstance(shape, Disc):
        return [Outline(step, softness_m, shape.x_m, shape.y_m, shape.radius_m)]
    if isinstance(shape, Bar):
        sides = shape.length_m, shape.width_m, shape.turn_deg
        return [Outline(step, softness_m, corners_m=_rectangle(shape.x_m, shape.y_m, *sides))]
    if isinstance(shape, Checker):
        side = shape.square_m
        places = [
            (shape.x_m + (i - shape.columns / 2) * side, shape.y_m + (shape.rows / 2 - j) * side)
            for j in range(shape.rows + 1)
            for i in range(shape.columns + 1)
            if (i + j) % 2 == 0
        ]
        return [Outline(step, softness_m, corners_m=_rectangle(x, y, side, side)) for x, y in places]
    if isinstance(shape, Cells):
        return [Outline(step, softness_m, corners_m=corners) for corners in _runs_of_cells(shape)]
    raise TypeError(f"cannot outline a {type(shape).__name__}")


def _runs_of_cells(shape: Cells) -> list[Array]:
    """Rectangles around neighbouring cells of ink in a row of a tag; a side that two rows share adds up to nothing."""
    side, (width, height) = shape.cell_m, shape.span_m()
    found = []
    table = shape.table()
    for row, column, line in np.ndindex(table.shape[:3]):
        ink = np.diff(np.concatenate([[0], table[row, column, line].astype(np.int8), [0]]))
        left = shape.x_m - width / 2 + column * shape.pitch_m
        y = shape.y_m + height / 2 - row * shape.pitch_m - (line + 0.5) * side
        for start, stop in zip(np.flatnonzero(ink == 1), np.flatnonzero(ink == -1), strict=True):
            found.append(_rectangle(left + (start + stop) / 2 * side, y, (stop - start) * side, side))
    return found


def outlines_of(sheet: Sheet) -> tuple[Outline, list[Outline]]:
    """The border of a sheet and the edges of its ink; shapes are disjoint or nested, as in all kinds of markers.

    The reflectance of the print is the wall's reflectance plus the steps of all edges that enclose the point.
    """
    low, high = np.array(sheet.low_m), np.array(sheet.high_m)
    border = Outline(sheet.paper - sheet.wall, 0.0, corners_m=_rectangle(*(low + high) / 2, *(high - low)))
    edges: list[Outline] = []
    for i, shape in enumerate(sheet.shapes):
        beneath = sheet.paper
        for below in sheet.shapes[:i]:
            if isinstance(below, Disc) and np.hypot(shape.x_m - below.x_m, shape.y_m - below.y_m) < below.radius_m:
                beneath = below.reflectance
        edges += _of_shape(shape, beneath, sheet.edge_softness_m)
    return border, edges
