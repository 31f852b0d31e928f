"""Sheets in the camera frame: their pose from a study's keys, the outlines of their parts, and what must be in view."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, ray_direction
from roundel.scenes.camera.motion import image_of
from roundel.scenes.errors import StudyError
from roundel.scenes.geometry.conic import circle_points_m
from roundel.scenes.geometry.pose import camera_from_marker_of, minimal_rotation, normal_of, transform_points
from roundel.scenes.markers.marker import Part, Sheet
from roundel.scenes.markers.surfaces import lifted, normals
from roundel.scenes.study.pose_section import PoseSection

if TYPE_CHECKING:
    from roundel.scenes.world.frame import Frame

Array = NDArray[np.float64]

# Points of the sheet's border, side by side, where it is bent or a lens distorts it.
_BORDER_POINTS = 16


class Fail(Protocol):
    """Makes the error of a frame from a message and the key path in the study."""

    def __call__(self, message: str, *keys: str | int) -> StudyError:
        """The error, at its position in the study."""


def placed(
    pose: PoseSection, camera: Camera, sheet: Sheet, fail: Fail, where: tuple[str | int, ...] = ("pose",)
) -> tuple[Array, Array]:
    """Image (2,) of the marker's centre in pixels, and pose (4, 4) of the sheet at time 0.

    Raises
    ------
    StudyError
        If the marker has no diameter to count distances in, or its centre is outside the image.
    """
    first, name = sheet.parts[0], ".".join(map(str, where))
    if pose.distance_m is not None:
        distance_m = pose.distance_m
    elif first.radius_m is None or pose.distance_D is None:
        raise fail(f"{name}.distance_D: a board has no diameter; give distance_m", *where, "distance_D")
    else:
        distance_m = pose.distance_D * 2 * first.radius_m
    normal = normal_of(pose.tilt_deg, pose.azimuth_deg)
    pixel = camera.K[:2, 2] + [pose.offset_x_px, pose.offset_y_px]
    ray = ray_direction(camera, pixel)
    if pose.tilt_from == "line_of_sight":
        normal = minimal_rotation([0.0, 0.0, 1.0], ray) @ normal
    camera_from_sheet = camera_from_marker_of(normal, distance_m * ray, pose.roll_deg)
    low, high = -0.5, np.array([camera.width_px, camera.height_px]) - 0.5
    if not (np.all(pixel >= low) and np.all(pixel <= high)):
        raise fail(
            f"{name}.offset_x_px, offset_y_px: the marker's centre lies outside the image", *where, "offset_x_px"
        )
    return pixel, camera_from_sheet


def part_outline(sheet: Sheet, part: Part, count: int) -> Array:
    """Outline of a part (n, 3) in the sheet's frame: a circle of the paper, or the rectangle around a board."""
    centre = np.array([part.x_m, part.y_m, 0.0])
    if part.radius_m is not None:
        pose = np.eye(4)
        pose[:3, 3] = centre
        points = circle_points_m(pose, part.radius_m, count)
    else:
        w, h = part.half_size_m()
        corners = np.array([[-w, -h], [w, -h], [w, h], [-w, h]])
        along = np.linspace(0, 1, max(count // 4, 2), endpoint=False)[:, None]
        flat = np.concatenate([corners[i] + along * (corners[(i + 1) % 4] - corners[i]) for i in range(4)])
        points = centre + np.column_stack([flat, np.zeros(len(flat))])
    if sheet.curve is not None:
        points = lifted(sheet.curve, points[:, 0], points[:, 1])
    return np.asarray(points, dtype=np.float64)


def border_points(sheet: Sheet) -> Array:
    """Points (n, 3) on the border of the paper, in the sheet's frame; only the four corners of a flat one."""
    (x0, y0), (x1, y1) = sheet.low_m, sheet.high_m
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    if sheet.curve is None:
        return lifted(None, corners[:, 0], corners[:, 1])
    along = np.linspace(0, 1, _BORDER_POINTS, endpoint=False)[:, None]
    sides = np.concatenate([corners[i] + along * (corners[(i + 1) % 4] - corners[i]) for i in range(4)])
    return lifted(sheet.curve, sides[:, 0], sides[:, 1])


def check_in_view(frame: Frame, part: Part, fail: Fail) -> None:
    """Check that a part faces the camera, and that some of it is imaged.

    Raises
    ------
    StudyError
    """
    pose = frame.camera_from_part(part)
    in_sheet = part_outline(frame.sheet, part, 64)
    outline = transform_points(frame.camera_from_sheet, in_sheet)
    if outline[:, 2].min() <= 0:
        raise fail(f"pose: marker {part.marker_id} reaches behind the camera; move it away or tilt it less", "pose")
    if pose[:3, 2] @ pose[:3, 3] >= 0:
        raise fail(f"pose: marker {part.marker_id} faces away from the camera; tilt it less", "pose", "tilt_deg")
    if not faces_camera(frame.sheet, frame.camera_from_sheet, part):
        raise fail(
            f"marker.surface.radius_m: marker {part.marker_id} is bent out of the camera's sight; give a larger radius "
            "or a smaller marker, or tilt it less",
            "marker",
            "surface",
        )
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


def faces_camera(sheet: Sheet, camera_from_sheet: Array, part: Part) -> bool:
    """Whether the printed face looks at the camera all along a part's outline.

    A cylinder then hides nothing of the part; a wave may, so that all of its paper must look there.
    """
    flat = part_outline(replace(sheet, curve=None), part, 64)[:, :2]
    if sheet.curve is not None and sheet.curve.kind == "bent":
        x, y = (np.linspace(low, high, 65) for low, high in zip(sheet.low_m, sheet.high_m, strict=True))
        flat = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = transform_points(camera_from_sheet, lifted(sheet.curve, flat[:, 0], flat[:, 1]))
    outward = normals(sheet.curve, flat[:, 0], flat[:, 1]) @ camera_from_sheet[:3, :3].T
    return bool((np.einsum("ij,ij->i", outward, points) < 0).all())
