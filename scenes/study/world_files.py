"""Files that a world names: checked when the study is read, and recorded by their checksums."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from roundel.scenes.assets.anchor import top_m
from roundel.scenes.assets.files import check_recorded, digest_of, inside
from roundel.scenes.assets.meshes import load_meshes, mesh_checksums
from roundel.scenes.assets.mitsuba_xml import read_xml, xml_checksums
from roundel.scenes.assets.pictures import folder_digest
from roundel.scenes.study.world_section import WorldSection


def recorded(folder: Path, world: WorldSection) -> dict[str, Any]:
    """Keys of the world that reading its files fills in: checksums, and the place of the sheet if it has none.

    Without the files, what the study recorded stands, as for the study inside a dataset.

    Raises
    ------
    ValueError
        If a file is missing, outside the study's folder, too large, corrupt, or not the recorded one; the message
        starts with the key.
    """
    if world.scene is not None:
        try:
            return _scene(folder, world, world.scene)
        except ValueError as error:
            raise ValueError(f"scene: {error}") from error
    if world.pictures is not None:
        try:
            return _pictures(folder, world, world.pictures)
        except ValueError as error:
            raise ValueError(f"pictures: {error}") from error
    return {}


def _scene(folder: Path, world: WorldSection, scene: str) -> dict[str, Any]:
    if world.checksums is not None and world.anchor is not None and not inside(folder, scene).exists():
        return {}
    checksums = xml_checksums(folder, scene) if world.is_xml else mesh_checksums(folder, scene)
    check_recorded(checksums, world.checksums, "checksums")
    found: dict[str, Any] = {"checksums": checksums}
    if world.is_xml:
        return found
    meshes = load_meshes(folder, scene, digest_of(checksums))
    if world.anchor is None:
        top = top_m(meshes, world.unit_m or 1.0, 2 if world.vertical == "z" else 1)
        found["anchor"] = {"position_m": [float(v) for v in top]}
    return found


def _pictures(folder: Path, world: WorldSection, pictures: str) -> dict[str, Any]:
    if world.pictures_sha256 is not None and world.pictures_count and not inside(folder, pictures).exists():
        return {}
    digest, count = folder_digest(folder, pictures)
    if world.pictures_sha256 not in (None, digest):
        raise ValueError(f"{pictures}: are not the recorded pictures; restore them, or remove pictures_sha256")
    return {"pictures_sha256": digest, "pictures_count": count}


def has_own_lights(folder: Path, world: WorldSection) -> bool:
    """Whether a scene, whose checksums are recorded, brings lights; false without its file."""
    if world.scene is None or not world.is_xml or not inside(folder, world.scene).exists():
        return False
    return _has_lights(folder, world.scene, digest_of(world.checksums or {}))


@lru_cache(maxsize=4)
def _has_lights(folder: Path, scene: str, digest: str) -> bool:
    """Read once, not for each frame; another content has another digest."""
    return read_xml(folder, scene).has_lights
