"""A frame as a Mitsuba scene: one plane with sheet and wall, lights, and occluders.

World coordinates are the camera frame at time 0. Every frame can be rendered this way; plain frames are faster in
closed form (`roundel.render.scene.transport`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from roundel.render.scene import ink
from roundel.render.scene.lights import emitters, unit_of
from roundel.render.scene.materials import occluders, placed_opaquely, surface
from roundel.scenes.world.frame import Frame

# The wall extends this many marker distances to each side; beyond it the environment is visible.
WALL_DISTANCES = 4.0


@dataclass(frozen=True)
class Built:
    """A frame as Mitsuba objects.

    `texture` is the ink, `plane` points to the shape of sheet and wall, `unit` is the radiance that equals 1 in the
    scene.
    """

    scene: Any
    integrator: Any
    texture: Any
    plane: Any
    unit: Any


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
    return Built(scene, mi.load_dict(_integrator(frame)), texture, pointer, dr.opaque(mi.Float, unit_of(frame)))


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
