"""The ink plugin: a Mitsuba texture that evaluates a sheet's shapes analytically, ray by ray.

No texels, no tessellation: whether a ray meets ink is decided by the same inequalities as
`roundel.scenes.marker.reflectance_at`. The plugin reads the hit point, not the texture coordinates, so the wall may be
large without costing the marker any digits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.marker import Disc, Sheet

NAME = "roundel_ink"


def register_ink(mi: Any) -> None:
    """Register the plugin with the current variant."""
    import drjit as dr

    class Ink(mi.Texture):  # type: ignore[misc]
        """Reflectance of a printed sheet before a wall."""

        def __init__(self, props: Any) -> None:
            mi.Texture.__init__(self, props)

        def paint(self, sheet: Sheet, camera_from_sheet: NDArray[np.float64]) -> None:
            """Take the sheet to print. Every number is opaque to the tracer, so that frames share one kernel."""

            def number(value: float) -> Any:
                return dr.opaque(mi.Float, value)

            x_axis, y_axis, origin = (camera_from_sheet[:3, i] for i in (0, 1, 3))
            self.x_axis = [number(v) for v in x_axis]
            self.y_axis = [number(v) for v in y_axis]
            self.origin = [number(v) for v in origin]
            self.low, self.high = [number(v) for v in sheet.low_m], [number(v) for v in sheet.high_m]
            self.paper, self.wall = number(sheet.paper), number(sheet.wall)
            self.shapes: list[tuple[Any, ...]] = []
            for shape in sheet.shapes:
                x, y, reflectance = number(shape.x_m), number(shape.y_m), number(shape.reflectance)
                if isinstance(shape, Disc):
                    self.shapes.append(("disc", x, y, reflectance, number(shape.radius_m)))
                else:
                    counts = number(shape.columns + 1.0), number(shape.rows + 1.0)
                    self.shapes.append(("checker", x, y, reflectance, number(shape.square_m), *counts))

        def in_plane(self, point: Any) -> tuple[Any, Any]:
            """Coordinates in the sheet's plane, metres, of points on it."""
            d = [point.x - self.origin[0], point.y - self.origin[1], point.z - self.origin[2]]
            x = d[0] * self.x_axis[0] + d[1] * self.x_axis[1] + d[2] * self.x_axis[2]
            y = d[0] * self.y_axis[0] + d[1] * self.y_axis[1] + d[2] * self.y_axis[2]
            return x, y

        def _reflectance(self, point: Any) -> Any:
            x, y = self.in_plane(point)
            on_sheet = (x > self.low[0]) & (x < self.high[0]) & (y > self.low[1]) & (y < self.high[1])
            value = dr.select(on_sheet, self.paper, self.wall)
            for kind, sx, sy, reflectance, *numbers in self.shapes:
                u, v = x - sx, y - sy
                if kind == "disc":
                    inside = u * u + v * v < numbers[0] * numbers[0]
                else:
                    square, columns, rows = numbers
                    column = dr.floor(u / square + columns / 2)
                    row = dr.floor(rows / 2 - v / square)
                    on_board = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
                    odd = (mi.Int32(column) + mi.Int32(row)) & 1
                    inside = on_board & (odd == 0)
                value = dr.select(inside, reflectance, value)
            return value

        def eval(self, si: Any, active: Any = True) -> Any:
            return mi.UnpolarizedSpectrum(self._reflectance(si.p))

        def eval_1(self, si: Any, active: Any = True) -> Any:
            return self._reflectance(si.p)

        def mean(self) -> Any:
            return self.paper

        def is_spatially_varying(self) -> bool:
            return True

        def to_string(self) -> str:
            return f"{NAME}[{len(self.shapes)} shapes]"

    mi.register_texture(NAME, Ink)
