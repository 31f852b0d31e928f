"""Meshes of a user's scene as Mitsuba shapes, loaded once and moved for each frame."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.assets.meshes import Look, UserMesh, load_meshes
from roundel.scenes.assets.pictures import to_linear
from roundel.scenes.errors import DataError
from roundel.scenes.surroundings.bodies import UserScene
from roundel.scenes.world.lamps import LUMINANCE

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]


def mesh_shapes(mi: Any, folder: Path, own: UserScene) -> dict[str, Any]:
    """The shapes of a scene's meshes where the frame has them, as entries of a Mitsuba scene.

    Raises
    ------
    DataError
        If the file was changed since the study was read.
    """
    try:
        meshes = load_meshes(folder, own.file, own.digest)
    except ValueError as error:
        raise DataError(str(error)) from error
    rotation, origin = own.camera_from_scene[:3, :3], own.camera_from_scene[:3, 3]
    shapes = _shapes(mi.variant(), folder, own.file, own.digest)
    for mesh, shape in zip(meshes, shapes, strict=True):
        parameters = mi.traverse(shape)
        placed = own.unit_m * mesh.vertices @ rotation.T + origin
        parameters["vertex_positions"] = placed.astype(np.float32).ravel()
        if mesh.normals is not None:
            parameters["vertex_normals"] = (mesh.normals @ rotation.T).astype(np.float32).ravel()
        parameters.update()
    return {f"own_{i}": shape for i, shape in enumerate(shapes)}


@lru_cache(maxsize=2)
def _shapes(variant: str, folder: Path, file: str, digest: str) -> tuple[Any, ...]:
    import mitsuba as mi

    return tuple(_shape(mi, mesh) for mesh in load_meshes(folder, file, digest))


def _shape(mi: Any, mesh: UserMesh) -> Any:
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(_bsdf(mi, mesh.look))
    made = mi.Mesh(mesh.name, len(mesh.vertices), len(mesh.faces), props, mesh.normals is not None, mesh.uv is not None)
    colours = mesh.look.vertex_colours
    if colours is not None:
        made.add_attribute("vertex_color", 3, np.ascontiguousarray(colours, dtype=np.float32).ravel())
    parameters = mi.traverse(made)
    if mesh.uv is not None:
        parameters["vertex_texcoords"] = mesh.uv.astype(np.float32).ravel()
    parameters["faces"] = mesh.faces.astype(np.uint32).ravel()
    parameters.update()
    return made


def _bsdf(mi: Any, look: Look) -> dict[str, Any]:
    """A surface that is the same from both sides: whether a user's faces look outward is not known."""
    colour = _colour(mi, look)
    if look.metallic is None or look.roughness is None:
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}}
    metallic: Any = look.metallic
    # Below this a highlight is a point that paths find too rarely.
    roughness: Any = max(look.roughness, 0.05)
    if look.metallic_roughness is not None:
        both = (
            look.metallic_roughness.astype(np.float32)
            / 255
            * np.array([look.metallic, look.roughness], dtype=np.float32)
        )
        rough = np.maximum(both[..., 1:], 0.05).astype(np.float32)
        metallic, roughness = bitmap(mi, both[..., :1].astype(np.float32)), bitmap(mi, rough)
    # Both models have GGX's alpha as the square of the roughness, and 4 % of reflection from dielectrics.
    glossy = {"type": "principled", "base_color": colour, "metallic": metallic, "roughness": roughness}
    return {"type": "twosided", "bsdf": glossy}


def _colour(mi: Any, look: Look) -> Any:
    if look.vertex_colours is not None:
        return {"type": "mesh_attribute", "name": "vertex_color"}
    if look.texture is not None:
        return bitmap(mi, to_linear(look.texture) * np.array(look.colour, dtype=np.float32))
    if mi.Spectrum(0.0).shape[0] == 3:
        return {"type": "rgb", "value": list(look.colour)}
    return float(np.dot(LUMINANCE, look.colour))


def bitmap(mi: Any, pixels: Array32, **keys: Any) -> dict[str, Any]:
    """A texture of linear values (H, W, 1 or 3), top row first; its luminance where the variant has no colours."""
    if pixels.shape[-1] == 3 and mi.Spectrum(0.0).shape[0] == 1:
        pixels = pixels @ np.array(LUMINANCE, dtype=np.float32)[:, None]
    kept = np.ascontiguousarray(pixels, dtype=np.float16)
    return {"type": "bitmap", "bitmap": mi.Bitmap(kept), "raw": True, "format": "auto", **keys}
