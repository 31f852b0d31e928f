"""Frame i of a study, a pure function of (study, i): all values drawn, all objects placed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import (
    THIN_LENS_DEG,
    Camera,
    folds_inside_image,
    ray_direction,
    sees_through_thin_lens,
)
from roundel.scenes.camera.motion import Motion, image_of, pose_at
from roundel.scenes.errors import StudyError
from roundel.scenes.geometry.conic import circle_points_m
from roundel.scenes.geometry.pose import camera_from_marker_of, minimal_rotation, normal_of, transform_points
from roundel.scenes.markers.marker import Part, Sheet
from roundel.scenes.study.sampling import draw, frame_count, frames_per_level, stream
from roundel.scenes.study.schema import GroupSection, PoseSection
from roundel.scenes.study.study import Study, validated
from roundel.scenes.surroundings.bodies import Surroundings
from roundel.scenes.surroundings.places import surroundings_of
from roundel.scenes.surroundings.sheet_place import SheetPlace
from roundel.scenes.world.cameras import camera_of, motion_of
from roundel.scenes.world.lamps import check_light
from roundel.scenes.world.occluders import check_occluders
from roundel.scenes.world.sheets import sheet_of

# Makes the error of a frame from a message and the key path in the study.
Fail = Callable[..., StudyError]


@dataclass(frozen=True)
class Frame:
    """One frame: everything that rendering and truth need, with all values drawn.

    `settings` is the group's section with every distribution replaced by the frame's value; `camera_from_sheet` is the
    pose at time 0 of `motion`; files named by the study are relative to `folder`. `sensor_seed` is the same for a whole
    group: the pixels' fixed pattern does not change between frames. `drawn` has the drawn values, by dotted key.
    """

    frame_id: int
    group: str
    index: int
    level: float | None
    settings: GroupSection
    camera: Camera
    motion: Motion
    sheet: Sheet
    camera_from_sheet: NDArray[np.float64]
    noise_seed: int
    ray_seed: int
    sensor_seed: int
    sheet_seed: int
    drawn: dict[str, float]
    folder: Path
    surroundings: Surroundings | None = None

    def part_time_s(self, part: Part) -> float:
        """Mid-exposure of the row that images the part's centre, in seconds after that of the first part."""
        _, time = image_of(self.camera, self.motion, self.camera_from_sheet, [[part.x_m, part.y_m, 0.0]])
        return float(time[0])

    def camera_from_part(self, part: Part, after_s: float = 0.0) -> NDArray[np.float64]:
        """Pose of one part of the sheet, at mid-exposure of its own centre row (the pose of record) or later."""
        pose = pose_at(self.motion, self.camera_from_sheet, np.array(self.part_time_s(part) + after_s))
        pose[:3, 3] = transform_points(pose, [part.x_m, part.y_m, 0.0])
        return pose


def total_frames(study: Study) -> int:
    """Total number of frames of a study, over all groups."""
    return sum(_count(study, name) for name in study.groups)


def _count(study: Study, name: str) -> int:
    try:
        return frame_count(study.groups[name])
    except ValueError as error:
        raise study.error(f"frames: {error}", name, "frames") from error


def group_ranges(study: Study) -> dict[str, range]:
    """Frame ids of each group; groups are numbered in the order of the study."""
    ranges, start = {}, 0
    for name in study.groups:
        ranges[name] = range(start, start + _count(study, name))
        start = ranges[name].stop
    return ranges


def _drawn(study: Study, name: str, index: int, level: float | None) -> tuple[GroupSection, dict[str, float]]:
    """A group's section with distributions replaced by the values of one frame, and these values by dotted key."""
    group = study.groups[name]
    raw = group.model_dump(exclude_none=True)
    # Count first: a drawn section has no grids left that determine the number of frames per level.
    raw.pop("frames_per_cell", None)
    raw["frames"] = frames_per_level(group)

    def put(key: tuple[Any, ...], value: float) -> None:
        node = raw
        for part in key[:-1]:
            node = node[part]
        node[key[-1]] = value

    numbers = draw(group, study.seed, name, index)
    for key, value in numbers.items():
        put(key, value)
    if group.sweep is not None and level is not None:
        try:
            put(tuple(int(p) if p.isdigit() else p for p in group.sweep.key.split(".")), level)
        except (KeyError, IndexError, TypeError) as error:
            raise study.error(f"sweep.key: no key {group.sweep.key!r} in this group", name, "sweep", "key") from error
    try:
        drawn: GroupSection = validated(GroupSection, raw, study.path, study.marks, name)
    except StudyError as error:
        message = f"{error.reason} (frame {index} of group {name})"
        if group.sweep is not None and error.reason.startswith(f"{group.sweep.key}:"):
            # The wrong value occurs in the file only in the sweep.
            raise study.error(f"sweep: {message}", name, "sweep", "key") from error
        raise StudyError(message, error.path, error.line, error.column) from error
    return drawn, {".".join(str(part) for part in key): value for key, value in numbers.items()}


def frame_of(study: Study, frame_id: int) -> Frame:
    """Frame `frame_id` of a study.

    Raises
    ------
    StudyError
        If the frame is impossible: a marker behind the camera or outside the image, a focus inside the focal length.
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
    settings, drawn = _drawn(study, name, index, level)

    def fail(message: str, *keys: str) -> StudyError:
        return study.error(f"{message} (frame {index} of group {name})", name, *keys)

    camera = _camera(settings, fail)
    # Values do not depend on the level of a sweep, so that paired frames differ only in the swept key.
    noise_seed, ray_seed, sheet_seed = (
        int(stream(study.seed, name, purpose, index).generate_state(1)[0]) for purpose in (1, 2, 4)
    )
    try:
        sheet = sheet_of(settings.marker, sheet_seed)
    except ValueError as error:
        raise fail(str(error), "marker") from error
    pixel, camera_from_sheet = _place(settings.pose, camera, sheet, fail)
    try:
        motion = motion_of(settings.motion, camera.height_px, float(pixel[1]))
    except ValueError as error:
        raise fail(f"motion.{error}", "motion", "exposure_s") from error
    frame = Frame(
        frame_id,
        name,
        index,
        level,
        settings,
        camera,
        motion,
        sheet,
        camera_from_sheet,
        noise_seed,
        ray_seed,
        int(stream(study.seed, name, 3).generate_state(1)[0]),
        sheet_seed,
        drawn,
        study.path.parent,
    )
    for part in sheet.parts:
        _check_in_view(frame, part, fail)
    if settings.world.kind != "plain" and settings.mode == "images":
        try:
            frame = replace(frame, surroundings=_surroundings(frame, stream(study.seed, name, 5, index)))
        except ValueError as error:
            raise fail(f"world: {error}", "world") from error
    for check, key in ((_check_occluders, "occluders"), (_check_light, "light")):
        try:
            check(frame)
        except ValueError as error:
            raise fail(f"{key}.{error}", key) from error
    return frame


def _surroundings(frame: Frame, seed: np.random.SeedSequence) -> Surroundings:
    """The world around the sheet, from a stream of random numbers of its own: it changes no pose."""
    (x0, y0), (x1, y1) = frame.sheet.low_m, frame.sheet.high_m
    corners = np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])
    outlines = np.concatenate([part_outline_in_sheet(part, 32) for part in frame.sheet.parts])
    world = frame.settings.world
    place = SheetPlace(
        frame.camera_from_sheet,
        transform_points(frame.camera_from_sheet, corners),
        transform_points(frame.camera_from_sheet, outlines),
        world.sheet_thickness_m,
    )
    return surroundings_of(world.kind, place, world.objects, np.random.default_rng(seed))


def _camera(settings: GroupSection, fail: Fail) -> Camera:
    """The camera of a frame; refused if its lens has no inverse."""
    try:
        camera = camera_of(settings.camera, settings.sensor.fill_factor)
    except ValueError as error:
        raise fail(f"camera: {error}", "camera") from error
    if folds_inside_image(camera):
        raise fail(
            "camera.distortion: folds inside the image and has no inverse; use smaller coefficients",
            "camera",
            "distortion",
        )
    if camera.aperture_radius_m > 0 and not sees_through_thin_lens(camera):
        raise fail(
            f"camera: a thin lens cannot focus rays at 90 degrees from its axis, and this fisheye sees beyond "
            f"{THIN_LENS_DEG:g}; remove its aperture, or increase the focal length",
            "camera",
        )
    return camera


def _place(
    pose: PoseSection, camera: Camera, sheet: Sheet, fail: Fail
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Image (2,) of the marker's centre in pixels, and pose (4, 4) of the sheet at time 0."""
    first = sheet.parts[0]
    if pose.distance_m is not None:
        distance_m = pose.distance_m
    elif first.radius_m is None or pose.distance_D is None:
        raise fail("pose.distance_D: a board has no diameter; give distance_m", "pose", "distance_D")
    else:
        distance_m = pose.distance_D * 2 * first.radius_m
    normal = normal_of(pose.tilt_deg, pose.azimuth_deg)
    pixel = camera.K[:2, 2] + [pose.offset_x_px, pose.offset_y_px]
    ray = ray_direction(camera, pixel)
    if pose.tilt_from == "line_of_sight":
        normal = minimal_rotation([0.0, 0.0, 1.0], ray) @ normal
    centre_m = distance_m * ray
    camera_from_sheet = camera_from_marker_of(normal, centre_m, pose.roll_deg)
    low, high = -0.5, np.array([camera.width_px, camera.height_px]) - 0.5
    if not (np.all(pixel >= low) and np.all(pixel <= high)):
        raise fail("pose.offset_x_px, offset_y_px: the marker's centre lies outside the image", "pose", "offset_x_px")
    return pixel, camera_from_sheet


def _check_occluders(frame: Frame) -> None:
    check_occluders(frame.settings.occluders, frame.camera, frame.camera_from_sheet)


def _check_light(frame: Frame) -> None:
    if frame.settings.mode == "images":
        check_light(frame.settings.light, frame.sheet, frame.camera_from_sheet)


def part_outline_in_sheet(part: Part, count: int) -> NDArray[np.float64]:
    """Outline of a part (n, 3) in the sheet's frame: a circle, or the rectangle around a board."""
    centre = np.array([part.x_m, part.y_m, 0.0])
    if part.radius_m is not None:
        placed = np.eye(4)
        placed[:3, 3] = centre
        return circle_points_m(placed, part.radius_m, count)
    w, h = part.half_size_m()
    corners = np.array([[-w, -h], [w, -h], [w, h], [-w, h]])
    along = np.linspace(0, 1, max(count // 4, 2), endpoint=False)[:, None]
    sides = [corners[i] + along * (corners[(i + 1) % 4] - corners[i]) for i in range(4)]
    flat = np.concatenate(sides)
    return np.asarray(centre + np.column_stack([flat, np.zeros(len(flat))]), dtype=np.float64)


def _check_in_view(frame: Frame, part: Part, fail: Fail) -> None:
    pose = frame.camera_from_part(part)
    in_sheet = part_outline_in_sheet(part, 64)
    outline = transform_points(frame.camera_from_sheet, in_sheet)
    if outline[:, 2].min() <= 0:
        raise fail(f"pose: marker {part.marker_id} reaches behind the camera; move it away or tilt it less", "pose")
    if pose[:3, 2] @ pose[:3, 3] >= 0:
        raise fail(f"pose: marker {part.marker_id} faces away from the camera; tilt it less", "pose", "tilt_deg")
    pixels, _ = image_of(frame.camera, frame.motion, frame.camera_from_sheet, in_sheet)
    if np.isnan(pixels).any() and frame.motion.row_s > 0:
        raise fail(
            f"motion: marker {part.marker_id} outruns the rolling shutter, or leaves the camera's view; reduce "
            "readout_s or the velocity",
            "motion",
        )
    inside = np.all((pixels >= -0.5) & (pixels <= [frame.camera.width_px - 0.5, frame.camera.height_px - 0.5]), axis=1)
    if not inside.any():
        raise fail(f"pose: the outline of marker {part.marker_id} lies outside the image", "pose")
