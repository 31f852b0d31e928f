"""Materials for Mitsuba: the print under its gloss, and the occluders."""

from __future__ import annotations

from typing import Any

import numpy as np

from roundel.scenes.study.light_section import OccluderSection
from roundel.scenes.study.marker_section import SurfaceSection
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.occluders import occluder_plate


def surface(section: SurfaceSection, texture: Any) -> dict[str, Any]:
    """The BSDF of print and wall; `texture` is the reflectance of ink and paper.

    `plastic` lets light into the ink through a rough dielectric boundary and out again: a print under varnish.
    `laminate` is a base with a clear film on it (Burley 2012): the film's highlight is added to that of the base.
    """
    if section.kind == "plastic":
        return {
            "type": "roughplastic",
            "distribution": "ggx",
            "alpha": section.roughness,
            "int_ior": section.ior,
            "diffuse_reflectance": texture,
            # Light reflected inside the varnish takes on the ink's tone at each reflection.
            "nonlinear": True,
        }
    if section.kind == "laminate":
        return {
            "type": "principled",
            "base_color": texture,
            "roughness": float(np.sqrt(section.roughness)),  # its GGX alpha is the square
            "eta": section.ior,
            # A sharper lobe inside the first: its alpha is 0.1 at gloss 0 and 0.001 at gloss 1.
            "clearcoat": 1.0,
            "clearcoat_gloss": float(np.clip((0.1 - section.roughness / 4) / 0.099, 0.0, 1.0)),
        }
    return {"type": "diffuse", "reflectance": texture}


def placed_opaquely(mi: Any, shape: dict[str, Any]) -> Any:
    """A Mitsuba shape whose position is not a constant of the kernel, so that frames share one kernel."""
    import drjit as dr

    made = mi.load_dict(shape)
    parameters = mi.traverse(made)
    place = parameters["to_world"]
    dr.make_opaque(place)
    parameters["to_world"] = place
    parameters.update()
    return made


def occluders(mi: Any, frame: Frame) -> dict[str, Any]:
    """The occluders of a frame, as entries of a Mitsuba scene: matte on both sides."""
    return {f"occluder_{i}": _occluder(mi, frame, section) for i, section in enumerate(frame.settings.occluders)}


def _occluder(mi: Any, frame: Frame, section: OccluderSection) -> Any:
    plate = occluder_plate(section)
    placed = mi.ScalarTransform4f(frame.camera_from_sheet @ plate.sheet_from_plate)
    shape = {
        "type": "disk" if plate.is_round else "rectangle",
        "to_world": placed @ mi.ScalarTransform4f().scale([plate.half_width_m, plate.half_height_m, 1.0]),
        "matter": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": section.reflectance}},
    }
    return placed_opaquely(mi, shape)
