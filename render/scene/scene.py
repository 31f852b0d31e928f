"""A frame as a Mitsuba scene: one plane with sheet and wall, lights, and occluders.

World coordinates are the camera frame at time 0. Every frame can be rendered this way; plain frames are faster in
closed form (`roundel.render.scene.transport`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from roundel.render.assets.meshes import mesh_shapes
from roundel.render.assets.picture import wall_shape
from roundel.render.assets.xml_scene import xml_shapes
from roundel.render.scene.bodies import WITNESSES, ambient_of, panel_shape, shape_of
from roundel.render.scene.direct import DirectLight, direct_light, direct_radiance, has_direct_light
from roundel.render.scene.lights import emitters, unit_of, world_sky
from roundel.render.scene.materials import occluders
from roundel.render.scene.paths import Lit, first_landing, follow
from roundel.render.scene.sheets import (
    WALL_DISTANCES,
    BuiltSheet,
    built_sheet,
    painted,
    paper_body,
    wall_around,
    wall_behind,
)
from roundel.scenes.surroundings.bodies import Body, Surroundings
from roundel.scenes.world.frame import Frame

# With more emitters than this, one is chosen for each look instead of all in turn.
_MOST_LOOKED_FOR = 9
# Reflections between light and camera in a world, if the study does not ask for more.
WORLD_BOUNCES = 4
# One small body of each material is in every world, far under its ground: the kernel then is the same in all of them.
_OUT_OF_SIGHT_M = 60.0


@dataclass(frozen=True)
class Built:
    """A frame as Mitsuba objects.

    `sheets` are in the order of the frame's views; of a single flat one on a wall, the shape is both. `unit` is the
    radiance that equals 1 in the scene. In a world with few lamps `lit` is what paths of up to `bounces` reflections go
    through, instead of the integrator.
    """

    mi: Any
    scene: Any
    integrator: Any
    sheets: tuple[BuiltSheet, ...]
    unit: Any
    lit: Lit | None = None
    bounces: int = 0
    direct: DirectLight | None = None


def build_scene(mi: Any, frame: Frame) -> Built:
    """Assemble a frame.

    Raises
    ------
    DataError
        If its environment map cannot be read.
    UsageError
        If it has a sky and the current variant has no colours.
    """
    import drjit as dr

    if frame.surroundings is not None:
        return _world(mi, frame, frame.surroundings)
    if frame.on_wall:
        texture = painted(mi, frame)
        plane = wall_around(mi, frame, texture)
        pointer = mi.ShapePtr(plane)
        dr.make_opaque(pointer)
        shapes, sheets = {"plane": plane}, [BuiltSheet(texture, plane, pointer)]
    else:
        sheets = [built_sheet(mi, view, f"sheet_{i}") for i, view in enumerate(frame.views())]
        shapes = {f"sheet_{i}": built.shape for i, built in enumerate(sheets)} | {"wall": wall_behind(mi, frame)}
    scene = mi.load_dict({"type": "scene", **shapes, **occluders(mi, frame), **emitters(mi, frame)})
    unit = dr.opaque(mi.Float, unit_of(frame))
    if has_direct_light(frame):
        return Built(mi, scene, None, tuple(sheets), unit, direct=direct_light(mi, scene))
    return Built(mi, scene, mi.load_dict(_integrator(frame)), tuple(sheets), unit)


def _world(mi: Any, frame: Frame, around: Surroundings) -> Built:
    """The sheets as bodies among others."""
    import drjit as dr

    sheets = [built_sheet(mi, view, f"sheet_{i}") for i, view in enumerate(frame.views())]
    shapes = {"plane" if i == 0 else f"sheet_{i}": built.shape for i, built in enumerate(sheets)}
    for i, view in enumerate(frame.views()):
        if view.sheet.curve is None:
            shapes["paper" if i == 0 else f"paper_{i}"] = paper_body(mi, view, around.sheet_thickness_m)
    things: dict[str, Any] = {}
    for i, body in enumerate(around.bodies):
        things[f"body_{i}"] = shape_of(mi, f"body_{i}", body)
    # A user's scene has materials of its own.
    for i, made in enumerate(WITNESSES if around.bodies else ()):
        place = np.eye(4)
        place[:3, 3] = frame.camera_from_sheet[:3, 3] - _OUT_OF_SIGHT_M * around.up
        things[f"witness_{i}"] = shape_of(mi, f"witness_{i}", Body("box", place, np.full(3, 1e-3), made))
    for i, panel in enumerate(around.panels):
        things[f"panel_{i}"] = panel_shape(mi, panel)
    things |= world_sky(mi, around) | _own(mi, frame, around)
    scene = mi.load_dict({"type": "scene", **shapes, **things, **occluders(mi, frame)})
    bounces = max(frame.settings.render.bounces, WORLD_BOUNCES)
    unit = dr.opaque(mi.Float, unit_of(frame) if around.is_lit_by_the_study else 1.0)
    lights = tuple(scene.emitters())
    if len(lights) > _MOST_LOOKED_FOR:
        integrator = mi.load_dict({"type": "path", "max_depth": bounces + 1, "rr_depth": bounces + 2})
        return Built(mi, scene, integrator, tuple(sheets), unit)
    # What a user's scene is made of is not known here.
    panes = around.scene is not None or any(body.material.kind == "glass" for body in around.bodies)
    light = frame.settings.light
    uniform = around.is_lit_by_the_study and light.map is None and light.sky is None
    sky = light.environment * np.asarray(light.environment_colour) if uniform else np.zeros(3)
    lit = Lit(mi, scene, lights, ambient_of(mi, around, sky), panes)
    return Built(mi, scene, None, tuple(sheets), unit, lit, bounces)


def _own(mi: Any, frame: Frame, around: Surroundings) -> dict[str, Any]:
    """The user's own scene or picture, with the study's lights where it has none."""
    found: dict[str, Any] = {}
    if around.scene is not None:
        shapes = xml_shapes if frame.settings.world.is_xml else mesh_shapes
        found |= shapes(mi, frame.folder, around.scene)
    if around.picture is not None:
        half = WALL_DISTANCES * float(np.linalg.norm(around.picture.camera_from_picture[:3, 3]))
        found["wall"] = wall_shape(mi, frame.folder, around.picture, half)
    return found | (emitters(mi, frame) if around.is_lit_by_the_study else {})


def distance_to_surface(built: Built, ray: Any) -> Any:
    """Distance (Float) along unit rays to the first surface of any kind, metres; 0 where there is none."""
    import drjit as dr

    met = built.scene.ray_intersect_preliminary(ray, coherent=True)
    return dr.select(met.is_valid(), met.t, 0.0)


def trace_built(built: Built, sampler: Any, ray: Any) -> tuple[Any, list[tuple[Any, Any, Any]]]:
    """Radiance along rays, by one of Mitsuba's integrators, or in a world by `roundel.render.scene.paths`.

    Returns
    -------
    radiance : Spectrum
    sheets : list of (Bool, Float, Float)
        For each sheet whether the first hit is its print (or the wall that it is printed on), not an object in front of
        it, and the position x, y on its paper, metres.
    """
    import drjit as dr

    if built.direct is not None:
        radiance, hit = direct_radiance(built.mi, built.scene, built.direct, sampler, ray)
        return radiance * built.unit, _seen(built, hit)
    if built.lit is None:
        radiance, _, _ = built.integrator.sample(built.scene, sampler, ray)
        return radiance * built.unit, _seen(built, built.scene.ray_intersect(ray))
    first = first_landing(built.lit, sampler, ray)
    seen = _seen(built, first.hit)
    # With the first wave: later, all rays would be traced again.
    dr.schedule(seen)
    return follow(built.lit, first, built.bounces) * built.unit, seen


def _seen(built: Built, hit: Any) -> list[tuple[Any, Any, Any]]:
    """For each sheet, whether it is what rays meet first, and where on its paper."""
    valid = hit.is_valid()
    return [(valid & (hit.shape == sheet.pointer), *sheet.texture.on_paper(hit)) for sheet in built.sheets]


def _integrator(frame: Frame) -> dict[str, Any]:
    light, bounces = frame.settings.light, frame.settings.render.bounces
    is_matte = all(view.settings.marker.surface.kind == "matte" for view in frame.views())
    if bounces > 1:
        # Every path has its full length: Russian roulette would add noise.
        return {"type": "path", "max_depth": bounces + 1, "rr_depth": bounces + 2}
    if light.sky is not None and not light.lamps:
        # Several emitter samples suit sun and sky best: the same error in a quarter of the time (measured). With a
        # point light or spotlight only one is valid: with more, Mitsuba 3.9.1 counts such a lamp once per sample.
        return {"type": "direct", "emitter_samples": 4, "bsdf_samples": 0 if is_matte else 1}
    # Every reflected ray hits a constant environment; sampling it as an emitter would only add noise.
    only_constant = not light.lamps and light.map is None
    return {"type": "direct", "emitter_samples": 0 if only_constant else 1, "bsdf_samples": 1}
