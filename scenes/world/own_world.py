"""The user's own scene or pictures around the sheet: where they are, and whether the marker is seen in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.assets.anchor import scene_from_sheet
from roundel.scenes.assets.files import digest_of, inside
from roundel.scenes.assets.meshes import load_meshes
from roundel.scenes.assets.pictures import check_picture, names_of
from roundel.scenes.assets.visibility import hidden_by
from roundel.scenes.camera.motion import pose_at
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.study.world_files import has_own_lights
from roundel.scenes.study.world_section import WorldSection
from roundel.scenes.surroundings.bodies import Picture, Surroundings, UserScene, pose_from_axes
from roundel.scenes.surroundings.sheet_place import SheetPlace

if TYPE_CHECKING:
    from roundel.scenes.world.frame import Frame

Array = NDArray[np.float64]

# Points this far before the print are asked for: float64 needs less, and paper that close to a surface is in it.
_BEFORE_M = 1e-5
_RIM = 4
_OUTLINE_POINTS = 32  # of `sheet_places`
# Parts of the way from a marker's centre to its outline.
_RINGS = (0.25, 0.5, 0.75, 1.0)


def is_own(world: WorldSection) -> bool:
    """Whether a world is of the user's own files."""
    return world.kind == "scene" or world.pictures is not None


def own_world(frame: Frame, sheets: Sequence[SheetPlace], rng: np.random.Generator) -> Surroundings:
    """The user's scene, or a wall with a picture, around the sheets; the anchor is that of the first.

    Raises
    ------
    ValueError
        If the scene hides the marker, or the picture is corrupt; the message starts with the key.
    """
    world = frame.settings.world
    if world.pictures is not None:
        return _picture_wall(frame.folder, world, sheets, rng)
    sheet = sheets[0]
    assert world.scene is not None
    assert world.anchor is not None
    normal, up = world.directions()
    pose = scene_from_sheet(world.anchor.position_m, normal, up, sheet.thickness_m)
    # The sheet comes first: its pose in the camera is drawn, and the scene follows it.
    camera_from_scene = sheet.camera_from_sheet @ np.linalg.inv(pose)
    own = UserScene(
        world.scene,
        digest_of(world.checksums or {}),
        camera_from_scene,
        world.unit_m or 1.0,
        has_own_lights(frame.folder, world),
    )
    # Without its file a dataset's frames can still be drawn again; they were checked before they were rendered.
    if not world.is_xml and inside(frame.folder, own.file).exists():
        meshes = load_meshes(frame.folder, own.file, own.digest)
        for eye, points in sight_lines(frame, sheets, pose):
            _check_seen([(name, mask.mean()) for name, mask in hidden_by(meshes, eye, points)])
    # The scene's x, y and z axes seen as right, down and forward.
    level = np.diag([1.0, -1.0, -1.0, 1.0])
    if world.vertical == "z":
        level = pose_from_axes(np.eye(3)[0], -np.eye(3)[2], np.eye(3)[1], np.zeros(3))
    turned = np.eye(4)
    turned[:3, :3] = camera_from_scene[:3, :3]
    camera_from_level = turned @ level
    return Surroundings(
        -camera_from_level[:3, 1],
        "scene",
        sheet_thickness_m=sheet.thickness_m,
        scene=own,
        camera_from_level=camera_from_level,
    )


def _check_seen(hidden: list[tuple[str, float]]) -> None:
    if hidden:
        name, fraction = max(hidden, key=lambda found: found[1])
        raise ValueError(
            f"scene: the marker is hidden by {name!r} ({fraction:.0%} of it); move the anchor, or narrow the pose"
        )


def sight_lines(frame: Frame, sheets: Sequence[SheetPlace], scene_from_sheet: Array) -> list[tuple[Array, Array]]:
    """Where the lens is and what it must see, in the scene's frame and unit: a list of eye (3,) and points (n, 3).

    The points are spread over each marker; of a bent sheet they are its markers' outlines. The eyes are the camera's
    centre and four points of the lens's rim, at the exposure's middle and, if the camera moves, its ends.
    """
    unit = frame.settings.world.unit_m or 1.0
    scene_from_camera = scene_from_sheet @ np.linalg.inv(frame.camera_from_sheet)
    targets = [transform_points(scene_from_camera, _spread(sheet)) / unit for sheet in sheets]
    half, radius = frame.motion.exposure_s / 2, frame.camera.aperture_radius_m
    turn = 2 * np.pi * np.arange(_RIM) / _RIM
    rim = radius * np.stack([np.cos(turn), np.sin(turn), np.zeros(_RIM)], axis=-1)
    lens = np.vstack([np.zeros((1, 3)), rim]) if radius > 0 else np.zeros((1, 3))
    found = []
    for time in (-half, 0.0, half) if frame.motion.moves else (0.0,):
        sheet_from_camera = np.linalg.inv(pose_at(frame.motion, frame.camera_from_sheet, np.array(time)))
        for eye in transform_points(scene_from_sheet @ sheet_from_camera, lens):
            found += [(eye / unit, points) for points in targets]
    return found


def _spread(sheet: SheetPlace) -> Array:
    """Points (n, 3) of a sheet's markers, just before the print, in the camera frame."""
    before = _BEFORE_M * sheet.normal
    if sheet.curve is not None:
        return np.asarray(sheet.seen + before)
    outlines = sheet.seen.reshape(-1, _OUTLINE_POINTS, 3)
    middles = outlines.mean(axis=1, keepdims=True)
    rings = [(middles + ring * (outlines - middles)).reshape(-1, 3) for ring in _RINGS]
    return np.concatenate([middles[:, 0], *rings]) + before


def _picture_wall(
    folder: Path, world: WorldSection, sheets: Sequence[SheetPlace], rng: np.random.Generator
) -> Surroundings:
    assert world.pictures is not None
    assert world.pictures_sha256 is not None  # filled in when the study is read
    assert world.pictures_count is not None
    index = int(rng.integers(world.pictures_count))
    if inside(folder, world.pictures).exists():
        name = f"{world.pictures}/{names_of(folder, world.pictures, world.pictures_sha256)[index]}"
        try:
            check_picture(folder, name, world.pictures_sha256)
        except ValueError as error:
            raise ValueError(f"pictures: {error}") from error
    # Upright as the camera sees it: its up is the camera's, along the wall.
    sheet = sheets[0]
    z = sheet.normal
    y = np.array([0.0, -1.0, 0.0]) + z[1] * z
    y /= np.linalg.norm(y)
    origin = sheet.camera_from_sheet[:3, 3]
    # Behind every sheet.
    lowest = min(float(((other.corners - origin) @ z).min()) for other in sheets)
    origin = origin + (min(lowest, 0.0) - sheet.thickness_m) * z
    picture = Picture(
        world.pictures,
        world.pictures_sha256,
        index,
        pose_from_axes(np.cross(y, z), y, z, origin),
        1.0 if world.picture_m is None else float(world.picture_m),
    )
    return Surroundings(y, "wall", sheet_thickness_m=sheet.thickness_m, picture=picture)
