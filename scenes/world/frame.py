"""Frame i of a study, a pure function of (study, i): all values drawn, all objects placed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import THIN_LENS_DEG, Camera, folds_inside_image, sees_through_thin_lens
from roundel.scenes.camera.motion import Motion, image_of, pose_at
from roundel.scenes.errors import StudyError
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.marker import Part, Sheet
from roundel.scenes.markers.surfaces import lifted, tangent_frame
from roundel.scenes.study.sampling import draw, frame_count, frames_per_level, stream
from roundel.scenes.study.schema import GroupSection, put_level
from roundel.scenes.study.study import Study, validated
from roundel.scenes.surroundings.bodies import Surroundings
from roundel.scenes.surroundings.places import surroundings_of
from roundel.scenes.surroundings.sheet_place import SheetPlace
from roundel.scenes.world.cameras import camera_of, motion_of
from roundel.scenes.world.further_sheets import PlacedSheet, further_sheets
from roundel.scenes.world.lamps import check_light
from roundel.scenes.world.occluders import check_occluders
from roundel.scenes.world.own_world import is_own, own_world
from roundel.scenes.world.placement import Fail, border_points, check_in_view, part_outline, placed
from roundel.scenes.world.sheets import sheet_of


@dataclass(frozen=True)
class Frame:
    """One frame: everything that rendering and truth need, with all values drawn.

    `settings` is the group's section with every distribution replaced by the frame's value; `camera_from_sheet` is the
    pose at time 0 of `motion`; files named by the study are relative to `folder`. `sensor_seed` is the same for a whole
    group: the pixels' fixed pattern does not change between frames. `drawn` has the drawn values, by dotted key.
    `others` are the further sheets; `first` is the study's own sheet if this frame is the view of another, see `views`.
    """

    frame_id: int
    group: str
    index: int
    level: float | str | None
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
    others: tuple[PlacedSheet, ...] = ()
    first: PlacedSheet | None = None

    @property
    def on_wall(self) -> bool:
        """Whether the sheet is one flat print on an endless wall; otherwise it is a body among others."""
        return self.surroundings is None and not self.others and self.sheet.curve is None

    @property
    def camera_from_first(self) -> NDArray[np.float64]:
        """Pose of the study's own sheet, to which lamps and occluders refer."""
        return self.camera_from_sheet if self.first is None else self.first.camera_from_sheet

    def views(self) -> tuple[Frame, ...]:
        """The frame once for each of its sheets: with that as `sheet`, and all other sheets as `others`."""
        if not self.others:
            return (self,)
        sheets = (PlacedSheet(self.settings.marker, self.sheet, self.camera_from_sheet), *self.others)
        return (self, *(self._view(sheets, k) for k in range(1, len(sheets))))

    def _view(self, sheets: tuple[PlacedSheet, ...], k: int) -> Frame:
        own = sheets[k]
        return replace(
            self,
            settings=self.settings.model_copy(update={"marker": own.marker}),
            sheet=own.sheet,
            camera_from_sheet=own.camera_from_sheet,
            others=sheets[:k] + sheets[k + 1 :],
            first=sheets[0],
        )

    def part_centre_m(self, part: Part) -> NDArray[np.float64]:
        """Centre (3,) of a part in the sheet's frame."""
        return lifted(self.sheet.curve, part.x_m, part.y_m)

    def part_time_s(self, part: Part) -> float:
        """Mid-exposure of the row that images the part's centre, in seconds after that of the first part."""
        _, time = image_of(self.camera, self.motion, self.camera_from_sheet, [self.part_centre_m(part)])
        return float(time[0])

    def camera_from_part(self, part: Part, after_s: float = 0.0) -> NDArray[np.float64]:
        """Pose of one part of the sheet, at mid-exposure of its own centre row (the pose of record) or later.

        Of a bent sheet it is that of the tangent plane at the part's centre.
        """
        pose = pose_at(self.motion, self.camera_from_sheet, np.array(self.part_time_s(part) + after_s))
        if self.sheet.curve is not None:
            return np.asarray(pose @ tangent_frame(self.sheet.curve, part.x_m, part.y_m), dtype=np.float64)
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


def _drawn(study: Study, name: str, index: int, level: float | str | None) -> tuple[GroupSection, dict[str, float]]:
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

    numbers = draw(group, study.seed, group.paired_with or name, index)
    for key, value in numbers.items():
        put(key, value)
    if group.sweep is not None and level is not None:
        try:
            put_level(raw, group.sweep.path, level)
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


def frames_of(study: Study, frames: range | None = None) -> Iterator[Frame]:
    """All frames, or those of a range, in order."""
    for name, ids in group_ranges(study).items():
        low, high = (
            (ids.start, ids.stop) if frames is None else (max(ids.start, frames.start), min(ids.stop, frames.stop))
        )
        for frame_id in range(low, high):
            yield _frame(study, name, frame_id, frame_id - ids.start)


def _frame(study: Study, name: str, frame_id: int, position: int) -> Frame:
    group = study.groups[name]
    step, index = divmod(position, frames_per_level(group))
    level = group.sweep.levels[step] if group.sweep else None
    settings, drawn = _drawn(study, name, index, level)

    def fail(message: str, *keys: str | int) -> StudyError:
        return study.error(f"{message} (frame {index} of group {name})", name, *keys)

    camera = _camera(settings, fail)
    drawn_as = group.paired_with or name
    # Values do not depend on the level of a sweep, so that paired frames differ only in the swept key.
    noise_seed, ray_seed, sheet_seed = (
        int(stream(study.seed, drawn_as, purpose, index).generate_state(1)[0]) for purpose in (1, 2, 4)
    )
    try:
        sheet = sheet_of(settings.marker, sheet_seed)
    except ValueError as error:
        raise fail(str(error), "marker") from error
    pixel, camera_from_sheet = placed(settings.pose, camera, sheet, fail)
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
        int(stream(study.seed, drawn_as, 3).generate_state(1)[0]),
        sheet_seed,
        drawn,
        study.path.parent,
    )
    for part in sheet.parts:
        check_in_view(frame, part, fail)
    if settings.markers.any:
        own = PlacedSheet(settings.marker, sheet, camera_from_sheet)
        others = further_sheets(
            settings, group.pose, own, camera, lambda k: stream(study.seed, drawn_as, 6, index, k), fail
        )
        frame = replace(frame, others=others)
        for view in frame.views()[1:]:
            for part in view.sheet.parts:
                check_in_view(view, part, fail)
    if settings.mode == "images" and (settings.world.kind != "plain" or is_own(settings.world)):
        try:
            frame = replace(frame, surroundings=_surroundings(frame, stream(study.seed, drawn_as, 5, index)))
        except ValueError as error:
            dot = "." if is_own(settings.world) else ": "
            raise fail(f"world{dot}{error}", "world") from error
    for check, key in ((_check_occluders, "occluders"), (_check_light, "light")):
        try:
            check(frame)
        except ValueError as error:
            raise fail(f"{key}.{error}", key) from error
    return frame


def sheet_places(frame: Frame) -> list[SheetPlace]:
    """The sheets as the world around them sees them; the study's own first."""
    return [
        SheetPlace(
            view.camera_from_sheet,
            transform_points(view.camera_from_sheet, border_points(view.sheet)),
            transform_points(
                view.camera_from_sheet, np.concatenate([part_outline(view.sheet, p, 32) for p in view.sheet.parts])
            ),
            frame.settings.world.sheet_thickness_m,
            view.sheet.curve,
        )
        for view in frame.views()
    ]


def _surroundings(frame: Frame, seed: np.random.SeedSequence) -> Surroundings:
    """The world around the sheet, from a stream of random numbers of its own: it changes no pose."""
    world, places, rng = frame.settings.world, sheet_places(frame), np.random.default_rng(seed)
    if is_own(world):
        return own_world(frame, places, rng)
    return surroundings_of(world.kind, places, world.objects, rng)


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


def _check_occluders(frame: Frame) -> None:
    check_occluders(frame.settings.occluders, frame.camera, frame.camera_from_sheet)


def _check_light(frame: Frame) -> None:
    if frame.settings.mode == "images":
        check_light(frame.settings.light, frame.sheet, frame.camera_from_sheet)
