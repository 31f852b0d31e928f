"""Meshes of a user's scene: glTF, GLB, OBJ and PLY, read by trimesh into plain arrays."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.assets.files import digest_of, read_inside, sha256_of, sibling
from roundel.scenes.assets.pictures import to_linear
from roundel.scenes.assets.references import gltf_references, obj_references, text_of

Array = NDArray[np.float64]

MESHES = (".glb", ".gltf", ".obj", ".ply")
MOST_FACES = 500_000
_GREY = (0.5, 0.5, 0.5)


@dataclass(frozen=True, eq=False)
class Look:
    """How a mesh reflects; colours are linear.

    Attributes
    ----------
    colour : (r, g, b)
        Factor on the texture or the vertices' colours, or the colour itself.
    texture : (H, W, 3) array of uint8, optional
        sRGB, top row first.
    vertex_colours : (n, 3) array, optional
    metallic, roughness : float, optional
        Of glTF's metallic-roughness model; None: matte.
    metallic_roughness : (H, W, 2) array of uint8, optional
        Factors on the two, linear.
    """

    colour: tuple[float, float, float] = _GREY
    texture: NDArray[np.uint8] | None = None
    vertex_colours: Array | None = None
    metallic: float | None = None
    roughness: float | None = None
    metallic_roughness: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class UserMesh:
    """One mesh in the scene's frame, in the file's unit.

    `vertices` (n, 3); `faces` (m, 3); `normals` (n, 3) or None for flat faces; `uv` (n, 2) or None, v downward from the
    texture's top row.
    """

    name: str
    vertices: Array
    faces: NDArray[np.int64]
    normals: Array | None = None
    uv: Array | None = None
    look: Look = field(default_factory=Look)


def mesh_checksums(folder: Path, name: str) -> dict[str, str]:
    """sha256 of a mesh file and of every file that it refers to, by their names relative to the study.

    Raises
    ------
    ValueError
        If one is missing, outside the folder, too large or corrupt.
    """
    data, others = _contents(folder, name)
    found = {name: sha256_of(data)}
    return found | {sibling(name, reference): sha256_of(blob) for reference, blob in sorted(others.items())}


def _contents(folder: Path, name: str) -> tuple[bytes, dict[str, bytes]]:
    data = read_inside(folder, name)

    def read(reference: str) -> bytes:
        if "://" in reference or reference.startswith("data:"):
            raise ValueError(f"{name}: refers to {reference[:60]}; put that file beside it")
        return read_inside(folder, sibling(name, reference))

    ending = PurePosixPath(name).suffix.lower()
    if ending in (".glb", ".gltf"):
        return data, gltf_references(name, data, read)
    if ending == ".obj":
        return data, obj_references(data, read)
    return data, {}


@lru_cache(maxsize=2)
def load_meshes(folder: Path, name: str, digest: str) -> tuple[UserMesh, ...]:
    """The meshes of a file; a process reads a file once.

    Parameters
    ----------
    folder : path
        Of the study.
    name : str
        Of the file, relative to it.
    digest : str
        `digest_of` the checksums of the file and of those it refers to.

    Raises
    ------
    ValueError
        If the file is corrupt or changed, has no faces, too many, or vertices that are not finite.
    """
    data, others = _contents(folder, name)
    read_now = {name: sha256_of(data)} | {sibling(name, key): sha256_of(blob) for key, blob in others.items()}
    if digest_of(read_now) != digest:
        raise ValueError(f"{name}: it, or a file that it refers to, was changed; restore it, or read the study again")
    scene = _read(name, data, others)
    meshes = []
    faces = 0
    for node in sorted(scene.graph.nodes_geometry):
        transform, key = scene.graph[node]
        geometry = scene.geometry[key]
        count = len(getattr(geometry, "faces", ()))
        if count == 0:
            continue  # lines and points
        faces += count
        if faces > MOST_FACES:
            raise ValueError(f"{name}: more than {MOST_FACES:,} faces; simplify the scene")
        meshes.append(_mesh(name, str(key), geometry, np.asarray(transform, dtype=np.float64)))
    if not meshes:
        raise ValueError(f"{name}: has no faces; export triangles")
    return tuple(meshes)


def _read(name: str, data: bytes, others: Mapping[str, bytes]) -> Any:
    import trimesh

    # trimesh logs what it mends or skips; what matters was checked before.
    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        kind = PurePosixPath(name).suffix.lower().removeprefix(".")
        if kind == "obj":
            # For other encodings than UTF-8 trimesh needs one more library.
            data = text_of(data).encode()
            others = {key: text_of(b).encode() if key.lower().endswith(".mtl") else b for key, b in others.items()}
        return trimesh.load_scene(BytesIO(data), file_type=kind, resolver=dict(others), process=False)
    except Exception as error:
        raise ValueError(f"{name}: cannot be read as a mesh ({type(error).__name__}); export it again") from error
    finally:
        log.setLevel(level)


def faces_in(name: str, data: bytes) -> int:
    """Number of faces of a PLY or OBJ file that another reader will load.

    Raises
    ------
    ValueError
        If it is corrupt, or its faces or vertices are not sound.
    """
    found = [(str(key), g) for key, g in _read(name, data, {}).geometry.items() if len(getattr(g, "faces", ())) > 0]
    if not found:
        raise ValueError(f"{name}: has no faces; export triangles")
    return sum(len(_sound(name, key, geometry)[1]) for key, geometry in found)


def _sound(file: str, name: str, geometry: Any) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces, all finite and all there."""
    vertices, faces = np.asarray(geometry.vertices, dtype=np.float64), np.asarray(geometry.faces, dtype=np.int64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"{file}: {name} has faces without vertices; repair the mesh")
    if not np.isfinite(vertices).all():
        raise ValueError(f"{file}: {name} has vertices that are not finite numbers; repair the mesh")
    return vertices, faces


def _mesh(file: str, name: str, geometry: Any, transform: Array) -> UserMesh:
    vertices, faces = _sound(file, name, geometry)
    vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
    normals = None
    # Only normals of the file: without, glTF asks for flat faces (section 3.7.2.1).
    if "vertex_normals" in geometry._cache.cache:
        turned = np.asarray(geometry.vertex_normals, dtype=np.float64) @ np.linalg.pinv(transform[:3, :3])
        length = np.linalg.norm(turned, axis=1, keepdims=True)
        if np.isfinite(turned).all() and length.min() > 0:
            normals = turned / length
    visual = geometry.visual
    if visual.kind == "face":
        # A vertex for each corner of a face, so that it can have the face's colour.
        colours = np.repeat(np.asarray(visual.face_colors)[:, :3], 3, axis=0)
        look = Look((1.0, 1.0, 1.0), vertex_colours=to_linear(colours).astype(np.float64))
        return UserMesh(
            name, vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), None, None, look
        )
    uv = None
    if getattr(visual, "uv", None) is not None and len(visual.uv) == len(vertices):
        uv = np.asarray(visual.uv, dtype=np.float64)[:, :2] * [1.0, -1.0] + [0.0, 1.0]
        if not np.isfinite(uv).all():
            raise ValueError(f"{file}: {name} has texture coordinates that are not finite numbers; repair the mesh")
    return UserMesh(name, vertices, faces, normals, uv, _look(file, visual, uv is not None))


def _look(file: str, visual: Any, has_uv: bool) -> Look:
    if visual.kind == "vertex":
        written = np.asarray(visual.vertex_colors)[:, :3]
        # glTF's are linear (section 3.9.2), those of other formats are as displayed.
        is_gltf = file.lower().endswith((".glb", ".gltf"))
        return Look(
            (1.0, 1.0, 1.0), vertex_colours=(written / 255 if is_gltf else to_linear(written)).astype(np.float64)
        )
    made = getattr(visual, "material", None)
    if made is None:
        return Look()
    if hasattr(made, "baseColorFactor"):
        metal = None if made.metallicFactor is None else float(made.metallicFactor)
        rough = None if made.roughnessFactor is None else float(made.roughnessFactor)
        both = _pixels(file, made.metallicRoughnessTexture) if has_uv else None
        return Look(
            _factor(made.baseColorFactor),
            _pixels(file, made.baseColorTexture) if has_uv else None,
            # The defaults of glTF are 1 and 1.
            metallic=1.0 if metal is None else metal,
            roughness=1.0 if rough is None else rough,
            metallic_roughness=None if both is None else np.ascontiguousarray(both[..., [2, 1]]),
        )
    picture = _pixels(file, getattr(made, "image", None)) if has_uv else None
    return Look(_factor(getattr(made, "diffuse", None)), picture)


def _factor(colour: Any) -> tuple[float, float, float]:
    """Linear red, green and blue; trimesh keeps factors in bytes."""
    if colour is None:
        return (1.0, 1.0, 1.0)
    red, green, blue = (float(v) / 255 for v in np.asarray(colour, dtype=np.float64)[:3])
    return (red, green, blue)


def _pixels(file: str, image: Any) -> NDArray[np.uint8] | None:
    if image is None:
        return None
    try:
        return np.asarray(image.convert("RGB"))
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        raise ValueError(f"{file}: a texture is truncated or corrupt; export it again") from error
