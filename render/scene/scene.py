"""A frame as a Mitsuba scene: one plane with sheet and wall, lights, and occluders.

World coordinates are the camera frame at time 0. Every frame can be rendered this way; plain frames are faster in
closed form (`roundel.render.scene.transport`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from roundel.render.scene import ink
from roundel.render.scene.bodies import WITNESSES, panel_shape, shape_of
from roundel.render.scene.lights import emitters, unit_of, world_sky
from roundel.render.scene.materials import occluders, placed_opaquely, surface
from roundel.render.scene.paths import radiance_along
from roundel.scenes.surroundings.bodies import Body, Surroundings
from roundel.scenes.world.frame import Frame

# The wall extends this many marker distances to each side; beyond it the environment is visible.
WALL_DISTANCES = 4.0
# Reflections between light and camera in a world, if the study does not ask for more.
WORLD_BOUNCES = 4
_BELOW_M = 2e-6
# One small body of each material is in every world, far under its ground: the kernel then is the same in all of them.
_OUT_OF_SIGHT_M = 60.0


@dataclass(frozen=True)
class Built:
    """A frame as Mitsuba objects.

    `texture` is the ink, `plane` points to the shape of sheet and wall, `unit` is the radiance that equals 1 in the
    scene. In a world, `emitters` are sampled one by one.
    """

    mi: Any
    scene: Any
    integrator: Any
    texture: Any
    plane: Any
    unit: Any
    emitters: tuple[Any, ...] = ()


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

    texture = mi.load_dict({"type": ink.NAME})
    texture.paint(frame.sheet, frame.camera_from_sheet)
    if frame.surroundings is not None:
        return _world(mi, frame, frame.surroundings, texture)
    half = WALL_DISTANCES * float(np.linalg.norm(frame.camera_from_sheet[:3, 3]))
    plane = placed_opaquely(
        mi,
        {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(frame.camera_from_sheet) @ mi.ScalarTransform4f().scale([half, half, 1.0]),
            "print": surface(frame.settings.marker.surface, texture),
        },
    )
    scene = mi.load_dict({"type": "scene", "plane": plane, **occluders(mi, frame), **emitters(mi, frame)})
    # The pointer differs between frames; the kernel must not.
    pointer = mi.ShapePtr(plane)
    dr.make_opaque(pointer)
    return Built(mi, scene, mi.load_dict(_integrator(frame)), texture, pointer, dr.opaque(mi.Float, unit_of(frame)))


def _world(mi: Any, frame: Frame, around: Surroundings, texture: Any) -> Built:
    """The sheet as a body among others."""
    import drjit as dr

    (x0, y0), (x1, y1) = frame.sheet.low_m, frame.sheet.high_m
    placed = mi.ScalarTransform4f(frame.camera_from_sheet) @ mi.ScalarTransform4f().translate(
        [(x0 + x1) / 2, (y0 + y1) / 2, 0.0]
    )
    half = [(x1 - x0) / 2, (y1 - y0) / 2]
    plane = placed_opaquely(
        mi,
        {
            "type": "rectangle",
            "to_world": placed @ mi.ScalarTransform4f().scale([*half, 1.0]),
            "print": surface(frame.settings.marker.surface, texture),
        },
    )
    # The paper's body ends just below its face: two surfaces in one plane would hide each other by chance.
    thick = around.sheet_thickness_m / 2
    paper = {
        "type": "cube",
        "to_world": placed
        @ mi.ScalarTransform4f().translate([0.0, 0.0, -thick - _BELOW_M])
        @ mi.ScalarTransform4f().scale([*half, max(thick - _BELOW_M, 1e-5)]),
        "bsdf": {"type": "diffuse", "reflectance": frame.sheet.paper},
    }
    things: dict[str, Any] = {}
    for i, body in enumerate(around.bodies):
        things[f"body_{i}"] = shape_of(mi, f"body_{i}", body)
    for i, made in enumerate(WITNESSES):
        place = np.eye(4)
        place[:3, 3] = frame.camera_from_sheet[:3, 3] - _OUT_OF_SIGHT_M * around.up
        things[f"witness_{i}"] = shape_of(mi, f"witness_{i}", Body("box", place, np.full(3, 1e-3), made))
    for i, panel in enumerate(around.panels):
        things[f"panel_{i}"] = panel_shape(mi, panel)
    things |= world_sky(mi, around)
    scene = mi.load_dict({"type": "scene", "plane": plane, "paper": paper, **things, **occluders(mi, frame)})
    pointer = mi.ShapePtr(plane)
    dr.make_opaque(pointer)
    # The first reflection is `radiance_along`'s own.
    depth = max(frame.settings.render.bounces, WORLD_BOUNCES)
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": depth + 1})
    return Built(mi, scene, integrator, texture, pointer, dr.opaque(mi.Float, 1.0), tuple(scene.emitters()))


def trace_built(built: Built, sampler: Any, ray: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Radiance along rays, by Mitsuba's integrator.

    Returns
    -------
    radiance : Spectrum
    depth : Float
        Z of the first hit, metres.
    on_plane : Bool
        Whether the first hit is the print or the wall, not an object in front of them.
    x, y : Float
        Position on the print's plane, metres.
    """
    if built.emitters:
        radiance, hit = radiance_along(built.mi, built.scene, built.integrator, built.emitters, sampler, ray)
    else:
        radiance, _, _ = built.integrator.sample(built.scene, sampler, ray)
        hit = built.scene.ray_intersect(ray)
    on_plane = hit.is_valid() & (hit.shape == built.plane)
    return radiance * built.unit, hit.p.z, on_plane, *built.texture.in_plane(hit.p)


def _integrator(frame: Frame) -> dict[str, Any]:
    light, bounces = frame.settings.light, frame.settings.render.bounces
    is_matte = frame.settings.marker.surface.kind == "matte"
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
