"""Outlines of a sheet's edges as polylines, for the allocation of samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.markers.marker import Bar, Cells, Checker, Disc, Sectors, Shape, Sheet

Array = NDArray[np.float64]

# Number of chords of a circle: they deviate from it by at most 8e-5 of its radius.
_CHORDS = 256


def outlines(sheet: Sheet) -> list[Array]:
    """Every edge of the print as a polyline (n, 2) in the sheet's plane, metres; the sheet's border first.

    Soft edges extend `edge_reach_m` to both sides of these lines. Clutter and grain have no lines here.
    """
    lines = [_rectangle(sheet.low_m, sheet.high_m)]
    for shape in sheet.shapes:
        lines += _edges_of(shape)
    return lines


def edge_reach_m(sheet: Sheet) -> float:
    """Extent of a soft edge to either side of its line: half its ramp."""
    return sheet.edge_softness_m / 2


def _rectangle(low: tuple[float, float], high: tuple[float, float]) -> Array:
    (x0, y0), (x1, y1) = low, high
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])


def _edges_of(shape: Shape) -> list[Array]:
    centre = np.array([shape.x_m, shape.y_m])
    if isinstance(shape, Disc):
        turn = np.linspace(0, 2 * np.pi, _CHORDS + 1)
        return [centre + shape.radius_m * np.stack([np.cos(turn), np.sin(turn)], axis=-1)]
    if isinstance(shape, Bar):
        l, w, turn = shape.length_m / 2, shape.width_m / 2, np.radians(shape.turn_deg)
        c, s = np.cos(turn), np.sin(turn)
        return [centre + _rectangle((-l, -w), (l, w)) @ np.array([[c, s], [-s, c]])]
    if isinstance(shape, Checker):
        return _checker_edges(shape, centre)
    if isinstance(shape, Sectors):
        return _sector_edges(shape, centre)
    return _cell_edges(shape, centre)


def _checker_edges(shape: Checker, centre: Array) -> list[Array]:
    half_w, half_h = (shape.columns + 1) * shape.square_m / 2, (shape.rows + 1) * shape.square_m / 2
    xs = np.linspace(-half_w, half_w, shape.columns + 2)
    ys = np.linspace(-half_h, half_h, shape.rows + 2)
    upright = [centre + np.array([[x, -half_h], [x, half_h]]) for x in xs]
    return upright + [centre + np.array([[-half_w, y], [half_w, y]]) for y in ys]


def _cell_edges(shape: Cells, centre: Array) -> list[Array]:
    """Boundaries between different cells, each once; collinear boundaries that touch are merged."""
    n, gap = shape.side, shape.pitch_m - shape.tag_m
    width, height = shape.span_m()
    between = 1 if gap > 0 else 0
    # The whole grid as one raster of cells and gaps, with an empty border.
    table = np.pad(shape.table(), ((0, 0), (0, 0), (0, between), (0, between)))
    raster = table.transpose(0, 2, 1, 3).reshape(shape.rows * (n + between), shape.columns * (n + between))
    raster = np.pad(raster[: len(raster) - between, : raster.shape[1] - between], 1)

    def lines(count: int) -> Array:
        """Positions of the lines between the raster's columns (or rows), from the first tag's border."""
        tag = np.arange(count)[:, None] * shape.pitch_m + np.arange(n + between) * shape.cell_m
        return np.append(tag.ravel()[: count * (n + between) - between], (count - 1) * shape.pitch_m + shape.tag_m)

    xs, ys = lines(shape.columns) - width / 2, height / 2 - lines(shape.rows)
    found = []
    for line, start, stop in _runs(np.diff(raster, axis=0) != 0):
        found.append(np.array([[xs[start - 1], ys[line]], [xs[stop - 1], ys[line]]]))
    for line, start, stop in _runs((np.diff(raster, axis=1) != 0).T):
        found.append(np.array([[xs[line], ys[start - 1]], [xs[line], ys[stop - 1]]]))
    return [centre + segment for segment in found]


def _sector_edges(shape: Sectors, centre: Array) -> list[Array]:
    """Boundaries between different cells: arcs, as chords, and radial segments."""
    table, step = shape.table(), 2 * np.pi / shape.sectors
    radii = shape.inner_m + shape.ring_m * np.arange(shape.rings + 1)
    chords = max(1, -(-_CHORDS // shape.sectors))
    found = []
    for ring, sector in np.argwhere(np.diff(np.pad(table, ((1, 1), (0, 0))), axis=0) != 0).tolist():
        turn = -step * (sector + np.linspace(0, 1, chords + 1))
        found.append(radii[ring] * np.stack([np.cos(turn), np.sin(turn)], axis=-1))
    for ring, sector in np.argwhere(table != np.roll(table, 1, axis=1)).tolist():
        ray = np.array([np.cos(step * sector), -np.sin(step * sector)])
        found.append(radii[ring : ring + 2, None] * ray)
    return [centre + line for line in found]


def _runs(edge: NDArray[np.bool_]) -> list[tuple[int, int, int]]:
    """Runs of True along each row as (row, start, stop); the first and last column are False."""
    change = np.diff(edge.astype(np.int8), axis=1)
    row, start = np.nonzero(change == 1)
    _, stop = np.nonzero(change == -1)
    return [(int(r), int(a) + 1, int(b) + 1) for r, a, b in zip(row, start, stop, strict=True)]
