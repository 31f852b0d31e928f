"""Which ellipses are the same contour, found by a grid of their centres instead of by comparing all pairs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]

_CELL_PX = 16.0


class EllipseIndex:
    """Ellipses by the cell of their centre, each with a sign: contours of opposite polarity are never the same."""

    def __init__(self) -> None:
        self._cells: dict[tuple[int, int], list[tuple[float, Array]]] = {}

    def add(self, ellipse: Array, sign: float = 0.0) -> None:
        """Add an ellipse (5,)."""
        self._cells.setdefault(_cell(ellipse), []).append((sign, ellipse))

    def has(self, ellipse: Array, tolerance_px: float, sign: float = 0.0) -> bool:
        """Whether an ellipse of this sign agrees with this one within the tolerance; sign 0 agrees with both."""
        column, row = _cell(ellipse)
        reach = math.ceil(tolerance_px / _CELL_PX)
        for i in range(column - reach, column + reach + 1):
            for j in range(row - reach, row + reach + 1):
                for other_sign, other in self._cells.get((i, j), ()):
                    if sign * other_sign >= 0.0 and alike(ellipse, other, tolerance_px):
                        return True
        return False


def _cell(ellipse: Array) -> tuple[int, int]:
    return math.floor(ellipse[0] / _CELL_PX), math.floor(ellipse[1] / _CELL_PX)


@compiled
def alike(one: Array, other: Array, tolerance_px: float) -> bool:
    """Whether two ellipses (5,) are the same contour: their extreme points agree within the tolerance."""
    most = max(abs(one[0] - other[0]), abs(one[1] - other[1]))
    for k in range(4):
        most = max(most, abs(half_width(one, 45.0 * k) - half_width(other, 45.0 * k)))
    return bool(most <= tolerance_px)


@compiled
def half_width(ellipse: Array, direction_deg: float) -> float:
    """Half of the ellipse's extent in a direction; those in x, y and the diagonals distinguish concentric ellipses."""
    angle = math.radians(direction_deg - ellipse[4])
    return math.hypot(ellipse[2] * math.cos(angle), ellipse[3] * math.sin(angle))
