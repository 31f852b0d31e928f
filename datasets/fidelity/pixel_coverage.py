"""Exact areas of closed curves in pixels, by Green's theorem.

A segment with height dy within one pixel adds to that pixel dy times its distance to the pixel's right side, and dy
times the pixel's width to every pixel right of it; a sum along the rows then gives the area inside. Exact-coverage
rasterisers of font renderers use this method (R. Levien, "Inside the fastest font renderer in the world", 2016).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Cells = NDArray[np.int64]


class Areas:
    """Sums over the segments of closed curves, in a window of pixels.

    Pixels collect light in centred squares with a side of `side` pixels. Curves run from +x toward +y; curves in the
    other direction count as holes. Each segment has `kinds` weights, and each kind has its own sum.
    """

    def __init__(self, row0: int, col0: int, height: int, width: int, side: float = 1.0, kinds: int = 1) -> None:
        self.row0, self.col0, self.side = row0, col0, side
        self.height, self.width = height, width
        # One extra column collects what falls right of the window.
        self._steps = np.zeros((kinds, height * (width + 1)))
        self._edges = np.zeros((3, height * (width + 1)))

    def add(self, x0: Array, y0: Array, x1: Array, y1: Array, weights: Array) -> None:
        """Add segments (n,) from (x0, y0) to (x1, y1), with weights (kinds, n), in every row that they cross."""
        source, start, end, cell = _cut(y0, y1, self.side)
        row, inside = _place(cell, self.side)
        keep = inside & (row >= self.row0) & (row < self.row0 + self.height)
        if not keep.all():
            source, start, end, row = source[keep], start[keep], end[keep], row[keep]
        self._add_within_rows(x0, y0, x1, y1, weights, source, start, end, row)

    def add_to_rows(self, x0: Array, y0: Array, x1: Array, y1: Array, weights: Array, row: Cells) -> None:
        """Add segments that each belong to one row of pixels only."""
        low, high = row - self.side / 2, row + self.side / 2
        level = y0 == y1
        span = np.where(level, 1.0, y1 - y0)
        a, b = (low - y0) / span, (high - y0) / span
        start, end = np.clip(np.minimum(a, b), 0.0, 1.0), np.clip(np.maximum(a, b), 0.0, 1.0)
        start, end = np.where(level, 0.0, start), np.where(level, 1.0, end)
        seen = (row >= self.row0) & (row < self.row0 + self.height) & (end > start)
        source = np.flatnonzero(seen & ~(level & ((y0 < low) | (y0 >= high))))
        self._add_within_rows(x0, y0, x1, y1, weights, source, start[source], end[source], row[source])

    def _add_within_rows(
        self, x0: Array, y0: Array, x1: Array, y1: Array, weights: Array, source: Cells, s: Array, e: Array, row: Cells
    ) -> None:
        """Add the parts from s to e of segments `source`, each within one row; cut them at column boundaries."""
        dx, dy = (x1 - x0)[source], (y1 - y0)[source]
        xs, xe = x0[source] + s * dx, x0[source] + e * dx
        dy = (e - s) * dy
        part, s, e, cell = _cut(xs, xe, self.side)
        column, inside = _place(cell, self.side)
        dx = (xe - xs)[part]
        # Width of the square to the left of the piece's midpoint.
        left = np.clip((xs[part] + (s + e) / 2 * dx - column) / self.side + 0.5, 0.0, 1.0)
        dx, dy = (e - s) * dx, (e - s) * dy[part]
        column = column - self.col0
        base = (row[part] - self.row0) * (self.width + 1)
        here = base + np.clip(column, 0, self.width)
        after = base + np.clip(column + 1, 0, self.width)
        origin = source[part]
        size = self._steps.shape[1]
        step = -dy / self.side
        for sums, weight in zip(self._steps, weights, strict=True):
            weighted = weight[origin] * step
            sums += np.bincount(here, weighted * (1 - left), size) + np.bincount(after, weighted * left, size)
        seen = inside & (column >= 0) & (column < self.width)
        here, weight = here[seen], weights[0][origin[seen]] / self.side**2
        dx, dy = dx[seen], dy[seen]
        for sums, value in zip(self._edges, (dy, -dx, np.hypot(dx, dy)), strict=True):
            sums += np.bincount(here, weight * value, size)

    def inside(self) -> Array:
        """Weighted fraction of each pixel's square inside the curves, (kinds, h, w)."""
        steps = self._steps.reshape(-1, self.height, self.width + 1)
        return np.asarray(np.cumsum(steps, axis=2)[:, :, :-1], dtype=np.float64)

    def derivatives(self) -> Array:
        """Derivatives of the first kind of `inside`, (3, h, w): per pixel of shift in x, in y, of growth outward."""
        return np.asarray(self._edges.reshape(3, self.height, self.width + 1)[:, :, :-1], dtype=np.float64)


def _cut(a0: Array, a1: Array, side: float) -> tuple[Cells, Array, Array, Cells]:
    """Cut segments from a0 to a1 at the boundaries of the pixels' squares, along one axis.

    Returns
    -------
    source : (m,) array
        The segment that a piece belongs to.
    start, end : (m,) arrays
        The piece's ends, as fractions of the segment.
    cell : (m,) array
        See `_place`.
    """
    first = _cell(a0, side)
    steps = _cell(a1, side) - first
    count = np.abs(steps) + 1
    if count.max(initial=1) == 1:
        return np.arange(len(a0)), np.zeros(len(a0)), np.ones(len(a0)), first
    source = np.repeat(np.arange(len(a0)), count)
    number = np.arange(len(source)) - np.repeat(np.cumsum(count) - count, count)
    upward = steps[source] > 0
    cell = first[source] + np.where(upward, number, -number)
    span = np.where(steps == 0, 1.0, a1 - a0)[source]
    origin = a0[source]
    # A piece that goes up enters its cell at the lower side and leaves it at the upper side.
    lower, upper = _lower_side(cell, side), _lower_side(cell + 1, side)
    start = np.where(number == 0, 0.0, (np.where(upward, lower, upper) - origin) / span)
    end = np.where(number == count[source] - 1, 1.0, (np.where(upward, upper, lower) - origin) / span)
    return source, np.clip(start, 0.0, 1.0), np.clip(end, 0.0, 1.0), cell


def _cell(a: Array, side: float) -> Cells:
    """The cell of each coordinate: pixel i if pixels touch, else 2 i for its square, 2 i + 1 for the gap after it."""
    pixel = np.floor(a + side / 2)
    if side == 1.0:
        return pixel.astype(np.int64)
    return (2 * pixel + (a - pixel >= side / 2)).astype(np.int64)


def _lower_side(cell: Cells, side: float) -> Array:
    if side == 1.0:
        return np.asarray(cell - 0.5, dtype=np.float64)
    pixel, gap = np.divmod(cell, 2)
    return np.asarray(pixel + np.where(gap == 1, side / 2, -side / 2), dtype=np.float64)


def _place(cell: Cells, side: float) -> tuple[Cells, NDArray[np.bool_]]:
    """Pixel of each cell, and whether the cell is the pixel's square rather than the gap after it."""
    if side == 1.0:
        return cell, np.ones(len(cell), dtype=bool)
    pixel, gap = np.divmod(cell, 2)
    return pixel, gap == 0
