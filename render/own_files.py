"""What only Mitsuba can say of a study's files: asked before the first frame is rendered.

Whether a Mitsuba scene loads and shows the marker, and whether an environment map holds light. Other files are checked
where the study is read and its frames are placed, without Mitsuba.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from roundel.render.backend import DEFAULT_BACKEND, start, variant_of
from roundel.scenes.errors import DataError
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import Frame, sheet_places
from roundel.scenes.world.own_world import sight_lines


def check_files(study: Study, frame: Frame, backend: str = DEFAULT_BACKEND) -> None:
    """Refuse a frame whose map or Mitsuba scene cannot be read, or whose Mitsuba scene hides the marker.

    Raises
    ------
    StudyError
    """
    light_map = frame.settings.light.map
    if light_map is not None and light_map.sha256 is not None:
        try:
            _check_map(variant_of(frame, backend), str(frame.folder / light_map.file), light_map.sha256)
        except DataError as error:
            raise study.error(f"light.map.file: {error}", frame.group, "light", "map", "file") from error
    if frame.settings.world.is_xml and frame.surroundings is not None:
        try:
            _check_scene(frame, backend)
        except (DataError, ValueError) as error:
            message = f"world.scene: {error} (frame {frame.index} of group {frame.group})"
            raise study.error(message, frame.group, "world", "scene") from error


@lru_cache(maxsize=8)
def _check_map(variant: str, path: str, sha256: str) -> None:
    start(variant)
    from roundel.render.scene.light_map import read_map

    read_map(path, sha256)


def _check_scene(frame: Frame, backend: str) -> None:
    assert frame.surroundings is not None
    own = frame.surroundings.scene
    assert own is not None
    mi = start(variant_of(frame, backend))
    from roundel.render.assets.xml_scene import hidden_in

    scene_from_sheet = np.linalg.inv(own.camera_from_scene) @ frame.camera_from_sheet
    for eye, points in sight_lines(frame, sheet_places(frame), scene_from_sheet):
        hidden = hidden_in(mi, frame.folder, own, eye, points)
        if hidden:
            names = ", ".join(repr(name) for name in hidden)
            raise ValueError(f"the marker is hidden by {names}; move the anchor, or narrow the pose")
