"""Reflectance of a sheet, point by point, in float64: the definition of what `roundel.render.scene.ink` traces.

Inequalities decide the coverage of ink at sharp edges. With `edge_softness_m` = w every edge is a linear ramp of full
width w, centred on it. For circles the ramp is along the radius. For squares, bars and cells the sharp pattern is
averaged over an aligned square of side w, which gives a ramp across each edge and the product of two ramps at a corner.
Sectors do the same along radius and arc. The sheet's border is cut and stays sharp.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.markers.marker import Bar, Cells, Checker, Disc, Sectors, Shape, Sheet
from roundel.scenes.markers.value_noise import clutter_at, grain_at

Array = NDArray[np.float64]


def reflectance_at(sheet: Sheet, x_m: ArrayLike, y_m: ArrayLike) -> Array:
    """Reflectance of the print at points of its plane, (...) float64, in [0, 1]."""
    x, y = np.broadcast_arrays(np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64))
    value = np.full(x.shape, float(sheet.paper))
    # Rays that miss the plane are NaN or infinite: they are not on the sheet, whatever their coverage.
    with np.errstate(invalid="ignore"):
        for shape in sheet.shapes:
            cover = coverage(shape, x, y, sheet.edge_softness_m)
            value = (1 - cover) * value + cover * shape.reflectance
    if sheet.grain > 0:
        value = np.clip(value * (1 + sheet.grain * grain_at(x, y, sheet.grain_m, sheet.seed)), 0.0, 1.0)
    wall: Array = np.array(float(sheet.wall))
    if sheet.clutter is not None:
        inside, level = clutter_at(x, y, sheet.clutter.cell_m, sheet.seed)
        wall = np.where(inside, np.clip(sheet.wall + sheet.clutter.contrast * level, 0.0, 1.0), sheet.wall)
    on_sheet = (x > sheet.low_m[0]) & (x < sheet.high_m[0]) & (y > sheet.low_m[1]) & (y < sheet.high_m[1])
    return np.asarray(np.where(on_sheet, value, wall), dtype=np.float64)


def coverage(shape: Shape, x_m: Array, y_m: Array, softness_m: float = 0.0) -> Array:
    """Ink coverage of a shape at points of the plane, (...) in [0, 1]; 0 or 1 if its edges are sharp."""
    u, v = x_m - shape.x_m, y_m - shape.y_m
    if isinstance(shape, Disc):
        return _ramp(shape.radius_m - np.hypot(u, v), softness_m)
    if isinstance(shape, Bar):
        c, s = np.cos(np.radians(shape.turn_deg)), np.sin(np.radians(shape.turn_deg))
        along = shape.length_m / 2 - np.abs(c * u + s * v)
        across = shape.width_m / 2 - np.abs(c * v - s * u)
        return _ramp(along, softness_m) * _ramp(across, softness_m)
    if isinstance(shape, Checker):
        return _checker(shape, u, v, softness_m)
    if isinstance(shape, Sectors):
        return _sectors(shape, u, v, softness_m)
    return _cells(shape, u, v, softness_m)


def _ramp(inside_m: Array, softness_m: float) -> Array:
    """Ramp from 0 to 1 over the ramp's width, by the signed distance from the edge."""
    if softness_m == 0:
        return np.asarray(inside_m > 0, dtype=np.float64)
    return np.asarray(np.clip(inside_m / softness_m + 0.5, 0.0, 1.0), dtype=np.float64)


# Functions from a position to the index of its interval, and from an index to the start of that interval.
_Locate = Callable[[Array], tuple[Array, Array]]


def _reached(at: Array, softness_m: Array | float, locate: _Locate) -> list[tuple[Array, Array | float]]:
    """The intervals covered by a segment of the ramp's width, centred at a position, and its share of each.

    The ramp is narrower than any interval, so there are at most two.
    """
    if not np.any(softness_m):
        return [(locate(at)[0], 1.0)]
    last, start = locate(at + softness_m / 2)
    share = np.clip((at + softness_m / 2 - start) / softness_m, 0.0, 1.0)
    return [(locate(at - softness_m / 2)[0], 1 - share), (last, share)]


def _checker(shape: Checker, u: Array, v: Array, softness_m: float) -> Array:
    columns, rows = shape.columns + 1, shape.rows + 1

    def locate(at: Array) -> tuple[Array, Array]:
        index = np.floor(at / shape.square_m)
        return index, index * shape.square_m

    cover = np.zeros(np.shape(u))
    for row, in_row in _reached(rows * shape.square_m / 2 - v, softness_m, locate):
        for column, in_column in _reached(u + columns * shape.square_m / 2, softness_m, locate):
            on_board = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
            cover += in_row * in_column * (on_board & ((column + row) % 2 == 0))
    return cover


def _cells(shape: Cells, u: Array, v: Array, softness_m: float) -> Array:
    width, height = shape.span_m()
    table = shape.table()
    n, cell = shape.side, shape.cell_m

    def locate(count: int, span: float) -> _Locate:
        # Touching tags have no gap, so rounding must not create one.
        last = n if shape.pitch_m > shape.tag_m else n - 1

        def at_position(at: Array) -> tuple[Array, Array]:
            tag = np.clip(np.floor(at / shape.pitch_m), 0, count - 1)
            index = np.clip(np.floor((at - tag * shape.pitch_m) / cell), 0, last)
            start = np.where(at < span, tag * shape.pitch_m + index * cell, span)
            on_tag = (at >= 0) & (at < span) & (index < n)
            return np.where(on_tag, tag * n + index, -1.0), start

        return at_position

    cover = np.zeros(np.shape(u))
    for row, in_row in _reached(height / 2 - v, softness_m, locate(shape.rows, height)):
        for column, in_column in _reached(u + width / 2, softness_m, locate(shape.columns, width)):
            tag_row, cell_row = np.divmod(row.astype(np.int64), n)
            tag_column, cell_column = np.divmod(column.astype(np.int64), n)
            ink = table[tag_row, tag_column, cell_row, cell_column]  # index -1 reads an arbitrary cell and is masked
            cover += in_row * in_column * ((row >= 0) & (column >= 0) & (ink == 1))
    return cover


def _sectors(shape: Sectors, u: Array, v: Array, softness_m: float) -> Array:
    """Ramps along the radius and along the arc."""
    table, step = shape.table(), 2 * np.pi / shape.sectors
    radius, angle = np.hypot(u, v), np.mod(np.arctan2(-v, u), 2 * np.pi)

    def ring_at(at: Array) -> tuple[Array, Array]:
        index = np.floor((at - shape.inner_m) / shape.ring_m)
        return index, shape.inner_m + index * shape.ring_m

    def sector_at(at: Array) -> tuple[Array, Array]:
        index = np.floor(at / step)
        return index, index * step

    cover = np.zeros(np.shape(u))
    turn = softness_m / np.maximum(radius, shape.inner_m / 2)
    for ring, in_ring in _reached(radius, softness_m, ring_at):
        inside = (ring >= 0) & (ring < shape.rings)
        row = np.where(inside, ring, 0).astype(np.int64)
        for sector, in_sector in _reached(angle, turn, sector_at):
            column = np.where(inside, sector, 0).astype(np.int64) % shape.sectors
            cover += np.where(inside, in_ring * in_sector * (table[row, column] == 1), 0.0)
    return cover
