"""Frame i of a study: a pure function of (study, i). Every number drawn, every object placed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from roundel.scenes.camera import (
    Camera,
    focal_at_focus_px,
    folds_inside_image,
    normalise,
    principal_point_at_centre,
    project,
    undistort_px,
)
from roundel.scenes.conic import circle_points_m
from roundel.scenes.errors import StudyError
from roundel.scenes.marker import Part, Sheet, sheet_of
from roundel.scenes.pose import camera_from_marker_of, normal_of, transform_points
from roundel.scenes.sampling import draw, frame_count, frames_per_level, stream
from roundel.scenes.schema import CameraSection, GroupSection
from roundel.scenes.study import Study

# Diagonal of the 36 mm x 24 mm frame, which EXIF's 35 mm equivalent compares with (CIPA DCG-001).
DIAGONAL_35MM_MM = float(np.hypot(36.0, 24.0))


@dataclass(frozen=True)
class Frame:
    """One frame: everything that rendering and truth need, all of it decided.

    `settings` is the group's section with every spread replaced by the frame's number.
    """

    frame_id: int
    group: str
    index: int
    level: float | None
    settings: GroupSection
    camera: Camera
    sheet: Sheet
    camera_from_sheet: NDArray[np.float64]
    noise_seed: int
    ray_seed: int

    def camera_from_part(self, part: Part) -> NDArray[np.float64]:
        """Pose of one part of the sheet."""
        pose = self.camera_from_sheet.copy()
        pose[:3, 3] = transform_points(self.camera_from_sheet, [part.x_m, part.y_m, 0.0])
        return pose


def total_frames(study: Study) -> int:
    """Number of frames of a study, over all groups."""
    return sum(_count(study, name) for name in study.groups)


def _count(study: Study, name: str) -> int:
    try:
        return frame_count(study.groups[name])
    except ValueError as error:
        raise study.error(f"frames: {error}", name, "frames") from error


def group_ranges(study: Study) -> dict[str, range]:
    """Frame ids of each group: groups follow one another in the order of the study."""
    ranges, start = {}, 0
    for name in study.groups:
        ranges[name] = range(start, start + _count(study, name))
        start = ranges[name].stop
    return ranges


def camera_of(section: CameraSection) -> Camera:
    """The camera that a section with all spreads drawn describes."""
    focus_m = section.focus_m if section.focus_m is not None else float("inf")
    focal_px: float
    focal_mm, pitch_um = section.focal_mm, section.pixel_pitch_um
    if focal_mm is not None and pitch_um is not None:
        focal_px = focal_at_focus_px(focal_mm, focus_m, pitch_um)
    else:
        assert section.focal_px is not None  # the schema wants one or the other
        focal_px = section.focal_px
    cx, cy = principal_point_at_centre(section.width_px, section.height_px)
    cx = section.principal_point_x_px if section.principal_point_x_px is not None else cx
    cy = section.principal_point_y_px if section.principal_point_y_px is not None else cy
    aperture_m = 0.0
    if section.f_number is not None and focal_mm is not None:
        aperture_m = focal_mm * 1e-3 / section.f_number / 2
    elif section.aperture_mm is not None:
        aperture_m = section.aperture_mm * 1e-3 / 2
    # A phone writes whole millimetres, by the diagonal.
    diagonal_px = float(np.hypot(section.width_px, section.height_px))
    written = float(max(1, round(focal_px * DIAGONAL_35MM_MM / diagonal_px)))
    return Camera(
        section.width_px,
        section.height_px,
        np.array([[focal_px, 0.0, cx], [0.0, focal_px, cy], [0.0, 0.0, 1.0]]),
        tuple(section.distortion),
        aperture_m,
        focus_m,
        section.focal_35mm_mm if section.focal_35mm_mm is not None else written,
    )


def _drawn(study: Study, name: str, index: int, level: float | None) -> GroupSection:
    group = study.groups[name]
    raw = group.model_dump(exclude_none=True)

    def put(key: tuple[Any, ...], value: float) -> None:
        node = raw
        for part in key[:-1]:
            node = node[part]
        node[key[-1]] = value

    for key, value in draw(group, study.seed, name, index).items():
        put(key, value)
    if group.sweep is not None and level is not None:
        try:
            put(tuple(int(p) if p.isdigit() else p for p in group.sweep.key.split(".")), level)
        except (KeyError, IndexError, TypeError) as error:
            raise study.error(f"sweep.key: no key {group.sweep.key!r} in this group", name, "sweep", "key") from error
    try:
        return GroupSection.model_validate(raw)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        keys = [str(p) for p in first["loc"]]
        raise study.error(f"{'.'.join(keys)}: {first['msg']} (frame {index} of group {name})", name, *keys) from error


def frame_of(study: Study, frame_id: int) -> Frame:
    """Frame `frame_id` of a study.

    Raises
    ------
    StudyError
        If the frame cannot be: a marker behind the camera or outside the image, a focus inside the lens.
    IndexError
        If the study has no such frame.
    """
    for name, ids in group_ranges(study).items():
        if frame_id in ids:
            return _frame(study, name, frame_id, frame_id - ids.start)
    raise IndexError(f"no frame {frame_id}; the study has {total_frames(study)}")


def frames_of(study: Study) -> Iterator[Frame]:
    """All frames, in order."""
    for name, ids in group_ranges(study).items():
        for frame_id in ids:
            yield _frame(study, name, frame_id, frame_id - ids.start)


def _frame(study: Study, name: str, frame_id: int, position: int) -> Frame:
    group = study.groups[name]
    step, index = divmod(position, frames_per_level(group))
    level = group.sweep.levels[step] if group.sweep else None
    settings = _drawn(study, name, index, level)

    def fail(message: str, *keys: str) -> StudyError:
        return study.error(f"{message} (frame {index} of group {name})", name, *keys)

    try:
        camera = camera_of(settings.camera)
    except ValueError as error:
        raise fail(f"camera: {error}", "camera") from error
    if folds_inside_image(camera):
        raise fail(
            "camera.distortion: folds inside the image and has no inverse; use smaller coefficients",
            "camera",
            "distortion",
        )
    try:
        sheet = sheet_of(settings.marker)
    except ValueError as error:
        raise fail(str(error), "marker") from error
    pose = settings.pose
    first = sheet.parts[0]
    if pose.distance_m is not None:
        distance_m = pose.distance_m
    elif first.radius_m is None or pose.distance_D is None:
        raise fail("pose.distance_D: a chessboard has no diameter; give distance_m", "pose", "distance_D")
    else:
        distance_m = pose.distance_D * 2 * first.radius_m
    normal = normal_of(pose.tilt_deg, pose.azimuth_deg)
    pixel = camera.K[:2, 2] + [pose.offset_x_px, pose.offset_y_px]
    sight = np.append(normalise(camera, undistort_px(camera, pixel)), 1.0)
    centre_m = distance_m * sight / np.linalg.norm(sight)
    camera_from_sheet = camera_from_marker_of(normal, centre_m, pose.roll_deg)
    low, high = -0.5, np.array([camera.width_px, camera.height_px]) - 0.5
    if not (np.all(pixel >= low) and np.all(pixel <= high)):
        raise fail("pose.offset_x_px, offset_y_px: the marker's centre lies outside the image", "pose", "offset_x_px")
    # The same numbers whatever the level of a sweep: paired frames differ in the swept key alone.
    noise_seed, ray_seed = (int(stream(study.seed, name, purpose, index).generate_state(1)[0]) for purpose in (1, 2))
    frame = Frame(frame_id, name, index, level, settings, camera, sheet, camera_from_sheet, noise_seed, ray_seed)
    for part in sheet.parts:
        _check_in_view(frame, part, fail)
    return frame


def part_outline_m(frame: Frame, part: Part, count: int) -> NDArray[np.float64]:
    """Outline of a part (n, 3) in the camera frame: a circle, or the rectangle round a board."""
    pose = frame.camera_from_part(part)
    if part.radius_m is not None:
        return circle_points_m(pose, part.radius_m, count)
    w, h = part.half_size_m()
    corners = np.array([[-w, -h], [w, -h], [w, h], [-w, h]])
    along = np.linspace(0, 1, max(count // 4, 2), endpoint=False)[:, None]
    sides = [corners[i] + along * (corners[(i + 1) % 4] - corners[i]) for i in range(4)]
    flat = np.concatenate(sides)
    return transform_points(pose, np.column_stack([flat, np.zeros(len(flat))]))


def _check_in_view(frame: Frame, part: Part, fail: Any) -> None:
    pose = frame.camera_from_part(part)
    outline = part_outline_m(frame, part, 64)
    if outline[:, 2].min() <= 0:
        raise fail(f"pose: marker {part.marker_id} reaches behind the camera; move it away or tilt it less", "pose")
    if pose[:3, 2] @ pose[:3, 3] >= 0:
        raise fail(f"pose: marker {part.marker_id} shows its back to the camera; tilt it less", "pose", "tilt_deg")
    pixels = project(frame.camera, outline)
    inside = np.all((pixels >= -0.5) & (pixels <= [frame.camera.width_px - 0.5, frame.camera.height_px - 0.5]), axis=1)
    if not inside.any():
        raise fail(f"pose: the outline of marker {part.marker_id} lies outside the image", "pose")
