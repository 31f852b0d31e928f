"""A picture on the wall behind the sheet, as a Mitsuba shape."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from roundel.render.assets.meshes import bitmap
from roundel.scenes.assets.files import read_inside
from roundel.scenes.assets.pictures import decode, names_of, to_linear
from roundel.scenes.errors import DataError
from roundel.scenes.surroundings.bodies import Picture


def wall_shape(mi: Any, folder: Path, picture: Picture, half_m: float) -> Any:
    """A wall that reaches `half_m` to each side, with the picture in its middle, mirrored beyond its edges.

    Raises
    ------
    DataError
        If the picture cannot be read any more.
    """
    try:
        name = f"{picture.folder}/{names_of(folder, picture.folder, picture.digest)[picture.index]}"
        texture, height_by_width = _texture(mi.variant(), folder, name, picture.digest)
    except (ValueError, IndexError) as error:
        raise DataError(f"world.pictures: {error}; put the pictures beside the study") from error
    half = np.array([half_m, half_m, 0.0])
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half
    pose = picture.camera_from_picture
    props = mi.Properties()
    props["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": texture})
    made = mi.Mesh("wall", 4, 2, props, False, True)
    # v runs downward from the picture's top row.
    size = np.array([picture.width_m, -picture.width_m * height_by_width])
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = (square @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32).ravel()
    parameters["vertex_texcoords"] = (square[:, :2] / size + 0.5).astype(np.float32).ravel()
    parameters["faces"] = np.array([0, 1, 2, 0, 2, 3], dtype=np.uint32)
    parameters.update()
    return made


@lru_cache(maxsize=2)
def _texture(variant: str, folder: Path, name: str, digest: str) -> tuple[Any, float]:
    import mitsuba as mi

    encoded = decode(name, read_inside(folder, name))
    texture = mi.load_dict(bitmap(mi, to_linear(encoded), wrap_mode="mirror"))
    return texture, encoded.shape[0] / encoded.shape[1]
