"""Markers as exact ink: circles and squares in the plane of the print, in metres.

Marker frame: X right, Y up, Z out of the printed face; the origin is the circle's centre, or the board's.
A sheet carries one or more parts (a disc, a chessboard beside it); each part has a row of its own in the truth.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.marker_section import DiscWithChessboardSection, Marker

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Disc:
    """A filled circle of one reflectance."""

    x_m: float
    y_m: float
    radius_m: float
    reflectance: float


@dataclass(frozen=True)
class Checker:
    """A chessboard of `columns + 1` by `rows + 1` squares; the top-left square (min X, max Y) is ink."""

    x_m: float
    y_m: float
    square_m: float
    columns: int
    rows: int
    reflectance: float


Shape = Disc | Checker


@dataclass(frozen=True)
class Part:
    """What the truth has one row for; it is centred at (x_m, y_m) of the sheet."""

    marker_id: int
    kind: str
    x_m: float
    y_m: float
    radius_m: float | None
    layout: dict[str, Any] = field(default_factory=dict)

    def half_size_m(self) -> tuple[float, float]:
        """Half the width and height of the print."""
        if self.radius_m is not None:
            return self.radius_m, self.radius_m
        square = self.layout["square_m"]
        return (self.layout["columns"] + 1) * square / 2, (self.layout["rows"] + 1) * square / 2


@dataclass(frozen=True)
class Sheet:
    """A printed sheet before a wall: shapes are painted in order; outside `low_m` .. `high_m` the wall begins."""

    low_m: tuple[float, float]
    high_m: tuple[float, float]
    paper: float
    wall: float
    shapes: tuple[Shape, ...]
    parts: tuple[Part, ...]


def _board_layout(board: Any) -> dict[str, Any]:
    return {"columns": board.columns, "rows": board.rows, "square_m": float(board.square_m)}


def sheet_of(section: Marker) -> Sheet:
    """The sheet that a marker's section describes (its spreads already drawn)."""
    ink, paper = (section.paper, section.ink) if section.inverted else (section.ink, section.paper)
    shapes: list[Shape] = []
    parts: list[Part] = []

    def board(layout: dict[str, Any], marker_id: int, x: float, y: float) -> None:
        if section.inverted:
            # Only the colour of its first square tells which way up a board is.
            raise ValueError("marker.inverted: a chessboard is dark on light; invert discs and rings only")
        shapes.append(Checker(x, y, layout["square_m"], layout["columns"], layout["rows"], ink))
        parts.append(Part(marker_id, "chessboard", x, y, None, layout))

    if section.kind == "chessboard":
        board(_board_layout(section), 0, 0.0, 0.0)
    else:
        radius = section.diameter_m / 2
        shapes.append(Disc(0.0, 0.0, radius, ink))
        layout: dict[str, Any] = {}
        if section.kind == "ring":
            if section.inner_diameter_m >= section.diameter_m:
                raise ValueError("marker.inner_diameter_m: must be smaller than diameter_m")
            shapes.append(Disc(0.0, 0.0, section.inner_diameter_m / 2, paper))
            layout = {"inner_diameter_m": section.inner_diameter_m}
        parts.append(Part(0, "ring" if section.kind == "ring" else "disc", 0.0, 0.0, radius, layout))
        if isinstance(section, DiscWithChessboardSection):
            below = _board_layout(section.chessboard)
            width = (below["columns"] + 1) * below["square_m"]
            board(below, 1, radius + section.gap_m + width / 2, 0.0)
    boxes = [(p.x_m, p.y_m, *p.half_size_m()) for p in parts]
    low = (min(x - w for x, _, w, _ in boxes), min(y - h for _, y, _, h in boxes))
    high = (max(x + w for x, _, w, _ in boxes), max(y + h for _, y, _, h in boxes))
    margin = section.margin_m if section.margin_m is not None else min(high[0] - low[0], high[1] - low[1]) / 3
    return Sheet(
        (low[0] - margin, low[1] - margin),
        (high[0] + margin, high[1] + margin),
        paper,
        section.wall,
        tuple(shapes),
        tuple(parts),
    )


def reflectance_at(sheet: Sheet, x_m: Array, y_m: Array) -> Array:
    """Reflectance of the print at points of its plane, in float64."""
    on_sheet = (x_m > sheet.low_m[0]) & (x_m < sheet.high_m[0]) & (y_m > sheet.low_m[1]) & (y_m < sheet.high_m[1])
    value = np.where(on_sheet, sheet.paper, sheet.wall)
    for shape in sheet.shapes:
        if isinstance(shape, Disc):
            inside = (x_m - shape.x_m) ** 2 + (y_m - shape.y_m) ** 2 < shape.radius_m**2
        else:
            column = np.floor((x_m - shape.x_m) / shape.square_m + (shape.columns + 1) / 2)
            row = np.floor((shape.y_m - y_m) / shape.square_m + (shape.rows + 1) / 2)
            on_board = (column >= 0) & (column <= shape.columns) & (row >= 0) & (row <= shape.rows)
            inside = on_board & ((column + row) % 2 == 0)
        value = np.where(inside, shape.reflectance, value)
    return value


def outlines(sheet: Sheet) -> list[Array]:
    """Every edge of the print as a polyline (n, 2) in the sheet's plane, metres; the sheet's border first."""
    (x0, y0), (x1, y1) = sheet.low_m, sheet.high_m
    lines: list[Array] = [np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])]
    turn = np.linspace(0, 2 * np.pi, 257)
    for shape in sheet.shapes:
        if isinstance(shape, Disc):
            circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
            lines.append(np.array([shape.x_m, shape.y_m]) + shape.radius_m * circle)
            continue
        half_w = (shape.columns + 1) * shape.square_m / 2
        half_h = (shape.rows + 1) * shape.square_m / 2
        for i in range(shape.columns + 2):
            x = shape.x_m - half_w + i * shape.square_m
            lines.append(np.array([[x, shape.y_m - half_h], [x, shape.y_m + half_h]]))
        for i in range(shape.rows + 2):
            y = shape.y_m - half_h + i * shape.square_m
            lines.append(np.array([[shape.x_m - half_w, y], [shape.x_m + half_w, y]]))
    return lines
