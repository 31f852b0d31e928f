"""Bodies, panels and the sheet of a world as Mitsuba shapes."""

from __future__ import annotations

from typing import Any

import numpy as np

from roundel.render.scene.lights import in_colour, spectrum
from roundel.render.scene.materials import placed_opaquely
from roundel.render.scene.meshes import mesh_of
from roundel.render.scene.textures import TILE_M, texture
from roundel.scenes.surroundings.bodies import Body, Material, Panel, Surroundings, frame_on
from roundel.scenes.world.lamps import LUMINANCE

_GREY = (0.5, 0.5, 0.5)
WITNESSES = (
    Material("matte", _GREY),
    Material("plaster", _GREY),
    Material("plastic", _GREY),
    Material("wood", _GREY, 0.25),
    Material("metal", _GREY),
    Material("glass", _GREY),
)


def material(mi: Any, made: Material) -> dict[str, Any]:
    """The BSDF of a material; texture coordinates count tiles."""
    colour: Any = _bitmap(mi, made) if made.kind in TILE_M else spectrum(mi, 1.0, list(made.colour))
    if made.kind == "metal":
        return {"type": "roughconductor", "material": "none", "alpha": made.roughness, "specular_reflectance": colour}
    if made.kind == "glass":
        # Thin: light passes straight on. What a solid of glass focuses, a path finds too rarely.
        return {"type": "thindielectric", "int_ior": 1.5, "ext_ior": 1.0}
    if made.kind == "plastic" or (made.kind == "wood" and made.roughness < 0.35):
        return {"type": "roughplastic", "distribution": "ggx", "alpha": made.roughness, "diffuse_reflectance": colour}
    return {"type": "diffuse", "reflectance": colour}


def _bitmap(mi: Any, made: Material) -> dict[str, Any]:
    tile = texture(made.kind, made.colour, made.seed)
    if not in_colour(mi):
        tile = np.ascontiguousarray((tile @ np.asarray(LUMINANCE, dtype=np.float32))[..., None])
    return {"type": "bitmap", "bitmap": mi.Bitmap(tile), "raw": True}


def shape_of(mi: Any, name: str, body: Body) -> Any:
    """A body as a Mitsuba mesh."""
    mesh = mesh_of(body)
    rotation, origin = body.camera_from_body[:3, :3], body.camera_from_body[:3, 3]
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(material(mi, body.material))
    made = mi.Mesh(name, len(mesh.vertices), len(mesh.faces), props, True, True)
    tile_m = TILE_M.get(body.material.kind, 1.0)
    parameters = mi.traverse(made)
    for key, values in (
        ("vertex_positions", mesh.vertices @ rotation.T + origin),
        ("vertex_normals", mesh.normals @ rotation.T),
        ("vertex_texcoords", mesh.uv_m / tile_m),
    ):
        parameters[key] = values.astype(np.float32).ravel()
    parameters["faces"] = mesh.faces.astype(np.uint32).ravel()
    parameters.update()
    return made


def panel_shape(mi: Any, panel: Panel) -> Any:
    """An area light: bright on the side of its Z, black on the other."""
    return placed_opaquely(
        mi,
        {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(panel.camera_from_panel)
            @ mi.ScalarTransform4f().scale([*panel.half_m, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": spectrum(mi, panel.radiance, list(panel.colour))},
        },
    )


def ambient_of(mi: Any, around: Surroundings, sky: Any) -> Any:
    """A rough mean of the radiance around (Spectrum): of a room with panels, else of a uniform sky (r, g, b).

    A closed room of reflectance a half has the flux of its panels over pi times its surface.
    """
    import drjit as dr

    mean = np.asarray(sky, dtype=np.float64)
    if around.panels and around.bodies:
        flux = sum((4 * p.half_m[0] * p.half_m[1] * p.radiance * np.asarray(p.colour) for p in around.panels), 0 * mean)
        corners = np.stack(np.meshgrid(*3 * [[-1.0, 1.0]]), axis=-1).reshape(-1, 3)
        points = [np.zeros((1, 3))]
        for body in around.bodies:
            points.append((corners * body.half_m) @ body.camera_from_body[:3, :3].T + body.camera_from_body[:3, 3])
        size = np.ptp(np.concatenate(points) @ np.stack([*frame_on(around.up, 0.0), around.up]).T, axis=0)
        mean = flux / (2 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0]))
    # Opaque even if 0: Dr.Jit gives a constant the size of its first use, which is not that of the next.
    if in_colour(mi):
        return mi.Spectrum(*(dr.opaque(mi.Float, float(c)) for c in mean))
    return mi.Spectrum(dr.opaque(mi.Float, float(mean @ np.asarray(LUMINANCE))))
