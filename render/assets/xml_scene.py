"""A Mitsuba XML scene, loaded once and moved for each frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.assets.decoding import two_threads
from roundel.scenes.assets.files import digest_of
from roundel.scenes.assets.meshes import MOST_FACES
from roundel.scenes.assets.mitsuba_xml import xml_checksums, xml_text
from roundel.scenes.errors import DataError, first_line
from roundel.scenes.surroundings.bodies import UserScene

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Thing:
    """A shape or emitter of the scene, with what is moved: vertices and normals, or a transform, or a position."""

    made: Any
    vertices: Array | None = None
    normals: Array | None = None
    to_world: Array | None = None
    position: Array | None = None


def xml_shapes(mi: Any, folder: Path, own: UserScene) -> dict[str, Any]:
    """Shapes and emitters of a scene where the frame has them, as entries of a Mitsuba scene.

    Raises
    ------
    DataError
        If Mitsuba refuses the scene, or a file was changed.
    """
    import drjit as dr

    unit = np.diag([own.unit_m, own.unit_m, own.unit_m, 1.0])
    pose = own.camera_from_scene @ unit
    things = _things(mi.variant(), folder, own.file, own.digest)
    for thing in things:
        parameters = mi.traverse(thing.made)
        if thing.vertices is not None:
            placed = thing.vertices @ pose[:3, :3].T + pose[:3, 3]
            parameters["vertex_positions"] = placed.astype(np.float32).ravel()
        if thing.normals is not None:
            parameters["vertex_normals"] = (thing.normals @ own.camera_from_scene[:3, :3].T).astype(np.float32).ravel()
        if thing.to_world is not None:
            # Opaque to the tracer, so that frames share one kernel.
            place = type(parameters["to_world"])(mi.ScalarTransform4f(pose @ thing.to_world))
            dr.make_opaque(place)
            parameters["to_world"] = place
        if thing.position is not None:
            parameters["position"] = mi.Point3f(*(pose[:3, :3] @ thing.position + pose[:3, 3]))
        parameters.update()
    return {f"own_{i}": thing.made for i, thing in enumerate(things)}


def _loaded(mi: Any, folder: Path, own_file: str, digest: str) -> Any:
    try:
        if digest_of(xml_checksums(folder, own_file)) != digest:
            raise ValueError(f"{own_file}: it, or a file that it refers to, was changed; restore it")
        with two_threads():
            # One after the other: an exception in a thread of its own ends the process (Mitsuba 3.9.1).
            return mi.load_string(xml_text(folder, own_file), parallel=False, optimize=False)
    except ValueError as error:
        raise DataError(str(error)) from error
    except (RuntimeError, MemoryError) as error:
        raise DataError(f"{own_file}: Mitsuba refuses it: {first_line(error)}") from error


@lru_cache(maxsize=2)
def _things(variant: str, folder: Path, file: str, digest: str) -> tuple[_Thing, ...]:
    import mitsuba as mi

    scene = _loaded(mi, folder, file, digest)
    found = []
    faces = 0
    for shape in scene.shapes():
        parameters = mi.traverse(shape)
        if "vertex_positions" not in parameters:
            found.append(_Thing(shape, to_world=_matrix(parameters["to_world"])))
            continue
        vertices = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
        faces += len(parameters["faces"]) // 3
        if faces > MOST_FACES:
            raise DataError(f"{file}: more than {MOST_FACES:,} faces; simplify the scene")
        if not np.isfinite(vertices).all():
            raise DataError(f"{file}: {shape.id()} has vertices that are not finite numbers; repair the mesh")
        normals = np.array(parameters["vertex_normals"], dtype=np.float64).reshape(-1, 3)
        found.append(_Thing(shape, vertices, normals if len(normals) else None))
    for emitter in scene.emitters():
        if mi.has_flag(emitter.flags(), mi.EmitterFlags.Surface):
            continue  # it belongs to a shape, with which it moves
        parameters = mi.traverse(emitter)
        if "position" in parameters:
            found.append(_Thing(emitter, position=np.array(parameters["position"], dtype=np.float64).ravel()))
        elif "to_world" in parameters:
            found.append(_Thing(emitter, to_world=_matrix(parameters["to_world"])))
        else:
            found.append(_Thing(emitter))
    return tuple(found)


def _matrix(transform: Any) -> Array:
    return np.array(transform.matrix, dtype=np.float64).reshape(4, 4)


def hidden_in(mi: Any, folder: Path, own: UserScene, eye: Array, points: Array) -> list[str]:
    """Names of the shapes that hide any of the points (n, 3) from an eye (3,), both in the scene's frame and unit.

    Raises
    ------
    DataError
        As `xml_shapes`.
    """
    import drjit as dr

    scene = _still(mi.variant(), folder, own.file, own.digest)
    toward = np.asarray(points - eye, dtype=np.float32)
    # A segment has length 1 and ends just before the print.
    ray = mi.Ray3f(mi.Point3f(*(np.full(len(toward), v, dtype=np.float32) for v in eye)), mi.Vector3f(*toward.T))
    ray.maxt = mi.Float(1.0)
    hit = scene.ray_intersect(ray)
    return [s.id() for s in scene.shapes() if bool(dr.any(hit.is_valid() & (hit.shape == mi.ShapePtr(s))))]


@lru_cache(maxsize=2)
def _still(variant: str, folder: Path, file: str, digest: str) -> Any:
    import mitsuba as mi

    _things(variant, folder, file, digest)  # its checks
    return _loaded(mi, folder, file, digest)
