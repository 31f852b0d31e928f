"""Coverage of ink, grain and clutter, traced by Dr.Jit in float32.

The definitions are those of `roundel.scenes.markers.ink_pattern` and `roundel.scenes.markers.value_noise`, with the
same hashed integers. Every number is opaque to the tracer: a kernel depends only on the kinds of shapes and their
count, and a board of tags is one table lookup.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from roundel.scenes.markers.marker import Bar, Cells, Checker, Clutter, Disc, Sectors, Shape
from roundel.scenes.markers.value_noise import (
    CLUTTER_LEAST,
    CLUTTER_MORE,
    CLUTTER_PLACE,
    CLUTTER_SHAPE,
    GRAIN,
    GRAIN_AMPLITUDE,
)

# Function from positions in the sheet's plane to coverage; a mask if edges are sharp.
Cover = Callable[[Any, Any], Any]


def cover_of(mi: Any, shape: Shape, softness_m: float) -> Cover:
    """A shape's coverage as a function of the position in the sheet's plane: a mask if sharp, else in [0, 1]."""
    import drjit as dr

    x, y = (dr.opaque(mi.Float, v) for v in (shape.x_m, shape.y_m))
    make: dict[type[Any], Callable[..., Cover]] = {
        Disc: _disc,
        Bar: _bar,
        Checker: _checker,
        Cells: _cells,
        Sectors: _sectors,
    }
    cover = make[type(shape)](mi, shape, dr.opaque(mi.Float, softness_m) if softness_m > 0 else None)
    return lambda px, py: cover(px - x, py - y)


def _ramp(inside: Any, softness: Any) -> Any:
    import drjit as dr

    return inside > 0 if softness is None else dr.clip(inside / softness + 0.5, 0, 1)


def _disc(mi: Any, shape: Disc, softness: Any) -> Cover:
    import drjit as dr

    radius = dr.opaque(mi.Float, shape.radius_m)
    if softness is None:
        return lambda u, v: u * u + v * v < radius * radius
    return lambda u, v: _ramp(radius - dr.sqrt(u * u + v * v), softness)


def _bar(mi: Any, shape: Bar, softness: Any) -> Cover:
    import drjit as dr

    turn = np.radians(shape.turn_deg)
    c, s, half_length, half_width = (
        dr.opaque(mi.Float, float(n)) for n in (np.cos(turn), np.sin(turn), shape.length_m / 2, shape.width_m / 2)
    )

    def cover(u: Any, v: Any) -> Any:
        along = _ramp(half_length - dr.abs(c * u + s * v), softness)
        across = _ramp(half_width - dr.abs(c * v - s * u), softness)
        return along & across if softness is None else along * across

    return cover


# Intervals, and the share of each.
_Reached = list[tuple[Any, Any]]


def _reached(dr: Any, at: Any, softness: Any, locate: Callable[[Any], tuple[Any, Any]]) -> _Reached:
    """The intervals within half a ramp of a position, and the share of each."""
    if softness is None:
        return [(locate(at)[0], None)]
    last, start = locate(at + softness / 2)
    share = dr.clip((at + softness / 2 - start) / softness, 0, 1)
    return [(locate(at - softness / 2)[0], 1 - share), (last, share)]


def _summed(dr: Any, rows: _Reached, columns: _Reached, ink: Callable[[Any, Any], Any]) -> Any:
    """Coverage from the ink of the intervals: of the only one, or weighted by the shares of all."""
    if rows[0][1] is None:
        return ink(columns[0][0], rows[0][0])
    return sum(
        dr.select(ink(column, row), in_row * in_column, 0) for row, in_row in rows for column, in_column in columns
    )


def _checker(mi: Any, shape: Checker, softness: Any) -> Cover:
    import drjit as dr

    square, columns, rows = (dr.opaque(mi.Float, n) for n in (shape.square_m, shape.columns + 1.0, shape.rows + 1.0))

    def locate(at: Any) -> tuple[Any, Any]:
        index = dr.floor(at / square)
        return index, index * square

    def ink(column: Any, row: Any) -> Any:
        on_board = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        return on_board & (((mi.Int32(column) + mi.Int32(row)) & 1) == 0)

    def cover(u: Any, v: Any) -> Any:
        in_rows = _reached(dr, rows * square / 2 - v, softness, locate)
        return _summed(dr, in_rows, _reached(dr, u + columns * square / 2, softness, locate), ink)

    return cover


def _cells(mi: Any, shape: Cells, softness: Any) -> Cover:
    import drjit as dr

    width, height = shape.span_m()
    side = dr.opaque(mi.UInt32, shape.side)
    across = dr.opaque(mi.UInt32, shape.columns)
    # Touching tags have no gap, so rounding must not create one.
    last = dr.opaque(mi.UInt32, shape.side if shape.pitch_m > shape.tag_m else shape.side - 1)
    pitch, cell = (dr.opaque(mi.Float, n) for n in (shape.pitch_m, shape.cell_m))
    sizes = [dr.opaque(mi.Float, float(n)) for n in (width, height)]
    counts = [dr.opaque(mi.UInt32, n - 1) for n in (shape.columns, shape.rows)]
    table = mi.UInt32(shape.table().ravel().astype(np.uint32))

    def locate(size: Any, top: Any) -> Callable[[Any], tuple[Any, Any]]:
        def at_position(at: Any) -> tuple[Any, Any]:
            on_grid = (at >= 0) & (at < size)
            near = dr.clip(at, 0, size)
            tag = dr.minimum(mi.UInt32(near / pitch), top)
            within = dr.maximum(near - mi.Float(tag) * pitch, 0)
            index = dr.minimum(mi.UInt32(within / cell), last)
            start = dr.select(at < size, mi.Float(tag) * pitch + mi.Float(index) * cell, size)
            return (tag, index, on_grid & (index < side)), start

        return at_position

    def ink(column: Any, row: Any) -> Any:
        (tag_column, cell_column, in_column), (tag_row, cell_row, in_row) = column, row
        place = ((tag_row * across + tag_column) * side + cell_row) * side + cell_column
        inside = in_column & in_row
        return inside & (dr.gather(mi.UInt32, table, place, inside) == 1)

    def cover(u: Any, v: Any) -> Any:
        in_rows = _reached(dr, sizes[1] / 2 - v, softness, locate(sizes[1], counts[1]))
        return _summed(dr, in_rows, _reached(dr, u + sizes[0] / 2, softness, locate(sizes[0], counts[0])), ink)

    return cover


def _sectors(mi: Any, shape: Sectors, softness: Any) -> Cover:
    import drjit as dr

    inner, width, step = (dr.opaque(mi.Float, n) for n in (shape.inner_m, shape.ring_m, 2 * np.pi / shape.sectors))
    rings, sectors = dr.opaque(mi.Int32, shape.rings), dr.opaque(mi.Int32, shape.sectors)
    table = mi.UInt32(shape.table().ravel().astype(np.uint32))

    def ring_at(at: Any) -> tuple[Any, Any]:
        index = dr.floor((at - inner) / width)
        return index, inner + index * width

    def sector_at(at: Any) -> tuple[Any, Any]:
        index = dr.floor(at / step)
        return index, index * step

    def ink(sector: Any, ring: Any) -> Any:
        # A ramp across +X continues from its start. No remainder: in a lane without a hit the divisor would be 0, and
        # the process would be killed.
        column = mi.Int32(sector)
        column = dr.select(column < 0, column + sectors, column)
        column = dr.clip(dr.select(column >= sectors, column - sectors, column), 0, sectors - 1)
        inside = (ring >= 0) & (ring < mi.Float(rings))
        place = mi.UInt32(dr.clip(mi.Int32(ring), 0, rings - 1) * sectors + column)
        return inside & (dr.gather(mi.UInt32, table, place, inside) == 1)

    def cover(u: Any, v: Any) -> Any:
        radius, angle = dr.sqrt(u * u + v * v), dr.atan2(-v, u)
        angle = dr.select(angle < 0, angle + 2 * dr.pi, angle)
        turn = None if softness is None else softness / dr.maximum(radius, inner / 2)
        return _summed(dr, _reached(dr, radius, softness, ring_at), _reached(dr, angle, turn, sector_at), ink)

    return cover


def _pcg3d(a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
    a, b, c = (v * 1664525 + 1013904223 for v in (a, b, c))
    a = a + b * c
    b = b + c * a
    c = c + a * b
    a, b, c = (v ^ (v >> 16) for v in (a, b, c))
    a = a + b * c
    b = b + c * a
    c = c + a * b
    return a, b, c


def _unit(mi: Any, h: Any) -> Any:
    return mi.Float(h >> 8) * 2.0**-24


def grain_of(mi: Any, cell_m: float, seed: int) -> Cover:
    """`value_noise.grain_at` as a function of the position."""
    import drjit as dr

    cell, key = dr.opaque(mi.Float, cell_m), dr.opaque(mi.UInt32, (seed + GRAIN) & 0xFFFFFFFF)

    def grain(x: Any, y: Any) -> Any:
        u, v = x / cell, y / cell
        i, j = dr.floor(u), dr.floor(v)
        s, t = (f * f * (3 - 2 * f) for f in (u - i, v - j))
        column, row = mi.UInt32(mi.Int32(i)), mi.UInt32(mi.Int32(j))
        lower, upper = (
            _unit(mi, _pcg3d(column, r, key)[0]) * (1 - s) + _unit(mi, _pcg3d(column + 1, r, key)[0]) * s
            for r in (row, row + 1)
        )
        return (2 * (lower * (1 - t) + upper * t) - 1) * GRAIN_AMPLITUDE

    return grain


def clutter_of(mi: Any, clutter: Clutter, seed: int) -> Callable[[Any, Any], tuple[Any, Any]]:
    """`value_noise.clutter_at` as a function of the position."""
    import drjit as dr

    cell = dr.opaque(mi.Float, clutter.cell_m)
    shape_key, place_key = (dr.opaque(mi.UInt32, (seed + n) & 0xFFFFFFFF) for n in (CLUTTER_SHAPE, CLUTTER_PLACE))

    def at(x: Any, y: Any) -> tuple[Any, Any]:
        u, v = x / cell, y / cell
        i, j = dr.floor(u), dr.floor(v)
        column, row = mi.UInt32(mi.Int32(i)), mi.UInt32(mi.Int32(j))
        kind, size, level = _pcg3d(column, row, shape_key)
        place = _pcg3d(column, row, place_key)
        half = CLUTTER_LEAST + CLUTTER_MORE * _unit(mi, size)
        du, dv = (w - k - (half + (1 - 2 * half) * _unit(mi, h)) for w, k, h in ((u, i, place[0]), (v, j, place[1])))
        round_one = du * du + dv * dv < half * half
        square = (dr.abs(du) < half) & (dr.abs(dv) < half)
        return dr.select(kind >> 31 == 0, round_one, square), 2 * _unit(mi, level) - 1

    return at
