"""Markers as exact ink: circles, squares, bars, cells and sectors in the plane of the print, in metres.

Marker frame: X right, Y up, Z out of the printed face; the origin is the circle's centre, or the board's.
A sheet has one or more parts (a disc, a chessboard beside it); each part has its own row in the truth. Part 0 is at the
sheet's origin, whose pose is the one set by the study. `scenes.world.sheets` makes sheets from sections,
`scenes.markers.ink_pattern` defines their reflectance, `scenes.markers.outlines` their edges.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.markers.surfaces import Curve


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


@dataclass(frozen=True)
class Bar:
    """A filled rectangle: `length_m` along +X turned by `turn_deg` toward +Y, `width_m` across."""

    x_m: float
    y_m: float
    length_m: float
    width_m: float
    turn_deg: float
    reflectance: float


@dataclass(frozen=True)
class Cells:
    """A grid of square tags centred at (x_m, y_m), each of `side` by `side` cells, `pitch_m` from tag to tag.

    `ink` has one byte per cell, 1 or 0, in the order (tag row, tag column, cell row, cell column), rows from the top.
    """

    x_m: float
    y_m: float
    columns: int
    rows: int
    pitch_m: float
    tag_m: float
    side: int
    ink: bytes
    reflectance: float

    @property
    def cell_m(self) -> float:
        """Side of a cell."""
        return self.tag_m / self.side

    def span_m(self) -> tuple[float, float]:
        """Width and height, from the first tag's border to that of the last."""
        return (self.columns - 1) * self.pitch_m + self.tag_m, (self.rows - 1) * self.pitch_m + self.tag_m

    def table(self) -> NDArray[np.uint8]:
        """The cells as (rows, columns, side, side)."""
        return np.frombuffer(self.ink, dtype=np.uint8).reshape(self.rows, self.columns, self.side, self.side)


@dataclass(frozen=True)
class Sectors:
    """Cells on rings: `rings` by `sectors` of them between two radii about (x_m, y_m).

    `ink` has one byte per cell, 1 or 0, ring by ring from the inside; sectors run from +X clockwise as seen by a reader
    of the print, like angles in an image.
    """

    x_m: float
    y_m: float
    inner_m: float
    outer_m: float
    rings: int
    sectors: int
    ink: bytes
    reflectance: float

    @property
    def ring_m(self) -> float:
        """Width of a ring."""
        return (self.outer_m - self.inner_m) / self.rings

    def table(self) -> NDArray[np.uint8]:
        """The cells as (rings, sectors)."""
        return np.frombuffer(self.ink, dtype=np.uint8).reshape(self.rings, self.sectors)


Shape = Disc | Checker | Bar | Cells | Sectors


@dataclass(frozen=True)
class Part:
    """A part of a sheet, which has one row in the truth; it is centred at (x_m, y_m) of the sheet.

    `size_m` is the width and height of a print that is not a circle. `inked` is whether the circle is an edge of the
    ink; that of a dot code only encloses its dots, and has no contrast.
    """

    marker_id: int
    kind: str
    x_m: float
    y_m: float
    radius_m: float | None
    layout: dict[str, Any] = field(default_factory=dict)
    size_m: tuple[float, float] | None = None
    inked: bool = True

    def half_size_m(self) -> tuple[float, float]:
        """Half the width and height of the print."""
        if self.radius_m is not None:
            return self.radius_m, self.radius_m
        assert self.size_m is not None
        return self.size_m[0] / 2, self.size_m[1] / 2


@dataclass(frozen=True)
class Clutter:
    """Discs and squares on the wall, one per cell of `cell_m`, with reflectances within `contrast` of the wall's."""

    cell_m: float
    contrast: float


@dataclass(frozen=True)
class Sheet:
    """A printed sheet in front of a wall: shapes are painted in order; the wall is outside `low_m` .. `high_m`.

    Attributes
    ----------
    low_m, high_m : (float, float)
    paper, wall : float
        Reflectances.
    shapes : tuple of Shape
    parts : tuple of Part
    edge_softness_m : float
        Full width of the linear ramp across every edge of the ink, centred on it.
    grain, grain_m : float
        RMS variation of the print's reflectance as a fraction of it, and the size of a grain.
    clutter : Clutter or None
    seed : int
        Seed of grain and clutter, 0 to 2^32 - 1.
    curve : Curve or None
        How the paper is bent; None if it is flat.
    """

    low_m: tuple[float, float]
    high_m: tuple[float, float]
    paper: float
    wall: float
    shapes: tuple[Shape, ...]
    parts: tuple[Part, ...]
    edge_softness_m: float = 0.0
    grain: float = 0.0
    grain_m: float = 0.0005
    clutter: Clutter | None = None
    seed: int = 0
    curve: Curve | None = None


def is_smooth(sheet: Sheet) -> bool:
    """Whether sheet and wall each have a constant reflectance between the outlines: no grain, no clutter."""
    return sheet.grain == 0 and sheet.clutter is None
