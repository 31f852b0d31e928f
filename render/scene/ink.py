"""The ink plugin: a Mitsuba texture that evaluates a sheet's shapes analytically, ray by ray.

There are no texels and no tessellation: the reflectance of a point follows from the same inequalities as in
`roundel.scenes.markers.ink_pattern.reflectance_at`. The plugin reads the hit point, not the texture coordinates, so
that a large wall does not reduce the precision on the marker.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.scene.ink_shapes import clutter_of, cover_of, grain_of
from roundel.scenes.markers.marker import Sheet

NAME = "roundel_ink"


def register_ink(mi: Any) -> None:
    """Register the plugin with the current variant."""
    import drjit as dr

    class Ink(mi.Texture):  # type: ignore[misc]
        """Reflectance of a printed sheet in front of a wall. Call `paint` before use."""

        def __init__(self, props: Any) -> None:
            mi.Texture.__init__(self, props)

        def paint(self, sheet: Sheet, camera_from_sheet: NDArray[np.float64]) -> None:
            """Set the sheet. Every number is opaque to the tracer, so that frames share one kernel."""

            def number(value: float) -> Any:
                return dr.opaque(mi.Float, value)

            x_axis, y_axis, origin = (camera_from_sheet[:3, i] for i in (0, 1, 3))
            self.x_axis = [number(v) for v in x_axis]
            self.y_axis = [number(v) for v in y_axis]
            self.origin = [number(v) for v in origin]
            self.bent = sheet.curve is not None
            self.low, self.high = [number(v) for v in sheet.low_m], [number(v) for v in sheet.high_m]
            self.paper, self.wall = number(sheet.paper), number(sheet.wall)
            self.soft = sheet.edge_softness_m > 0
            self.shapes = [(cover_of(mi, s, sheet.edge_softness_m), number(s.reflectance)) for s in sheet.shapes]
            self.grain = (grain_of(mi, sheet.grain_m, sheet.seed), number(sheet.grain)) if sheet.grain > 0 else None
            clutter = sheet.clutter
            self.clutter = (clutter_of(mi, clutter, sheet.seed), number(clutter.contrast)) if clutter else None

        def on_paper(self, si: Any) -> tuple[Any, Any]:
            """Coordinates on the paper, metres, of hit points; a bent sheet has them as its texture coordinates."""
            return (si.uv.x, si.uv.y) if self.bent else self.in_plane(si.p)

        def in_plane(self, point: Any) -> tuple[Any, Any]:
            """Coordinates in the sheet's plane, metres, of points on it."""
            d = [point.x - self.origin[0], point.y - self.origin[1], point.z - self.origin[2]]
            x = d[0] * self.x_axis[0] + d[1] * self.x_axis[1] + d[2] * self.x_axis[2]
            y = d[0] * self.y_axis[0] + d[1] * self.y_axis[1] + d[2] * self.y_axis[2]
            return x, y

        def reflectance(self, point: Any) -> Any:
            """Reflectance at points of the world, which lie in a flat sheet's plane."""
            return self.reflectance_at(*self.in_plane(point))

        def reflectance_at(self, x: Any, y: Any) -> Any:
            """Reflectance at points of the sheet's plane, metres."""
            value = self.paper
            for cover, reflectance in self.shapes:
                covered = cover(x, y)
                if self.soft:
                    value = (1 - covered) * value + covered * reflectance
                else:
                    value = dr.select(covered, reflectance, value)
            if self.grain is not None:
                grain, amount = self.grain
                value = dr.clip(value * (1 + amount * grain(x, y)), 0, 1)
            wall = self.wall
            if self.clutter is not None:
                clutter, contrast = self.clutter
                inside, level = clutter(x, y)
                wall = dr.select(inside, dr.clip(wall + contrast * level, 0, 1), wall)
            on_sheet = (x > self.low[0]) & (x < self.high[0]) & (y > self.low[1]) & (y < self.high[1])
            return dr.select(on_sheet, value, wall)

        def eval(self, si: Any, active: Any = True) -> Any:
            return mi.UnpolarizedSpectrum(self.reflectance_at(*self.on_paper(si)))

        def eval_1(self, si: Any, active: Any = True) -> Any:
            return self.reflectance_at(*self.on_paper(si))

        def mean(self) -> Any:
            return self.paper

        def is_spatially_varying(self) -> bool:
            return True

        def to_string(self) -> str:
            return f"{NAME}[{len(self.shapes)} shapes]"

    mi.register_texture(NAME, Ink)
