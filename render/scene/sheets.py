"""Sheets as Mitsuba shapes: flat ones, bent ones, and the wall behind them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from roundel.render.scene import ink
from roundel.render.scene.materials import placed_opaquely, surface
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.surfaces import lifted, normals, strips
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.placement import border_points

# The wall extends this many marker distances to each side; beyond it the environment is visible.
WALL_DISTANCES = 4.0
# A wall behind sheets that are not printed on it: this far behind the lowest point of a bent one, or this much farther
# than the farthest of several.
_BEHIND_M, _FARTHER = 0.002, 1.15
_BELOW_M = 2e-6


@dataclass(frozen=True)
class BuiltSheet:
    """A sheet's ink, and a pointer to its shape that is no constant of the kernel."""

    texture: Any
    shape: Any
    pointer: Any


def built_sheet(mi: Any, view: Frame, name: str = "sheet") -> BuiltSheet:
    """The printed face of a view's sheet: a rectangle, or strips of paper if it is bent."""
    import drjit as dr

    texture = painted(mi, view)
    made = _strips(mi, view, texture, name) if view.sheet.curve is not None else _rectangle(mi, view, texture)
    # The pointer differs between frames; the kernel must not.
    pointer = mi.ShapePtr(made)
    dr.make_opaque(pointer)
    return BuiltSheet(texture, made, pointer)


def painted(mi: Any, view: Frame) -> Any:
    """The ink of a view's sheet."""
    texture = mi.load_dict({"type": ink.NAME})
    texture.paint(view.sheet, view.camera_from_sheet)
    return texture


def placed_sheet(mi: Any, view: Frame) -> tuple[Any, list[float]]:
    """Transform to the middle of a flat sheet, and its half sides."""
    (x0, y0), (x1, y1) = view.sheet.low_m, view.sheet.high_m
    placed = mi.ScalarTransform4f(view.camera_from_sheet) @ mi.ScalarTransform4f().translate(
        [(x0 + x1) / 2, (y0 + y1) / 2, 0.0]
    )
    return placed, [(x1 - x0) / 2, (y1 - y0) / 2]


def paper_body(mi: Any, view: Frame, thickness_m: float) -> dict[str, Any]:
    """The body of a flat sheet's paper, as an entry of a scene.

    It ends just below the printed face: two surfaces in one plane would hide each other by chance.
    """
    placed, half = placed_sheet(mi, view)
    thick = thickness_m / 2
    return {
        "type": "cube",
        "to_world": placed
        @ mi.ScalarTransform4f().translate([0.0, 0.0, -thick - _BELOW_M])
        @ mi.ScalarTransform4f().scale([*half, max(thick - _BELOW_M, 1e-5)]),
        "bsdf": {"type": "diffuse", "reflectance": view.sheet.paper},
    }


def _rectangle(mi: Any, view: Frame, texture: Any) -> Any:
    placed, half = placed_sheet(mi, view)
    return placed_opaquely(
        mi,
        {
            "type": "rectangle",
            "to_world": placed @ mi.ScalarTransform4f().scale([*half, 1.0]),
            "print": surface(view.settings.marker.surface, texture),
        },
    )


def _strips(mi: Any, view: Frame, texture: Any, name: str) -> Any:
    """Strips of paper, printed on both sides: the back of a wave would be black otherwise."""
    curve = view.sheet.curve
    assert curve is not None
    paper, faces = strips(curve, view.sheet.low_m, view.sheet.high_m)
    rotation, origin = view.camera_from_sheet[:3, :3], view.camera_from_sheet[:3, 3]
    props = mi.Properties()
    props["bsdf"] = mi.load_dict({"type": "twosided", "front": surface(view.settings.marker.surface, texture)})
    made = mi.Mesh(name, len(paper), len(faces), props, True, True)
    parameters = mi.traverse(made)
    for key, values in (
        ("vertex_positions", lifted(curve, paper[:, 0], paper[:, 1]) @ rotation.T + origin),
        ("vertex_normals", normals(curve, paper[:, 0], paper[:, 1]) @ rotation.T),
        ("vertex_texcoords", paper),
    ):
        parameters[key] = values.astype(np.float32).ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    parameters.update()
    return made


def wall_around(mi: Any, frame: Frame, texture: Any) -> Any:
    """The endless wall that a single flat sheet is printed on, sheet and wall in one plane."""
    half = WALL_DISTANCES * float(np.linalg.norm(frame.camera_from_sheet[:3, 3]))
    return placed_opaquely(
        mi,
        {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(frame.camera_from_sheet) @ mi.ScalarTransform4f().scale([half, half, 1.0]),
            "print": surface(frame.settings.marker.surface, texture),
        },
    )


def wall_behind(mi: Any, frame: Frame) -> Any:
    """The wall behind a bent sheet, parallel to it; behind several it faces the camera."""
    if frame.others:
        corners = [transform_points(v.camera_from_sheet, border_points(v.sheet)) for v in frame.views()]
        far = _FARTHER * float(np.concatenate(corners)[:, 2].max())
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[2, 3] = far
    else:
        pose = frame.camera_from_sheet.copy()
        lowest = float(border_points(frame.sheet)[:, 2].min())
        pose[:3, 3] += (lowest - _BEHIND_M) * pose[:3, 2]
    half = WALL_DISTANCES * float(np.linalg.norm(pose[:3, 3]))
    return placed_opaquely(
        mi,
        {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(pose) @ mi.ScalarTransform4f().scale([half, half, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": frame.sheet.wall},
        },
    )
