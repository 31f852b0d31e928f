"""Flat occluders in front of the print: what they hide from the camera, in closed form.

An occluder is parallel to the print, in the sheet's frame. An area lamp hides what is behind it, too, and is included.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.study.light_section import AreaLampSection, OccluderSection
from roundel.scenes.study.schema import GroupSection
from roundel.scenes.world.lamps import camera_from_lamp

Array = NDArray[np.float64]

_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
_OUTLINE_POINTS = 128


@dataclass(frozen=True)
class Plate:
    """A flat object in the plane z = 0 of its own frame: a rectangle with these half sides, or its inner ellipse."""

    sheet_from_plate: Array
    half_width_m: float
    half_height_m: float
    is_round: bool


def occluder_plate(occluder: OccluderSection) -> Plate:
    """An occluder with its values drawn; its pose (4, 4) in the sheet's frame is a rotation and a translation."""
    turn = np.radians(occluder.turn_deg)
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[:3, 3] = [occluder.x_m, occluder.y_m, occluder.z_m]
    is_round = occluder.shape == "disc"
    height_m = occluder.width_m if is_round or occluder.height_m is None else occluder.height_m
    return Plate(pose, occluder.width_m / 2, height_m / 2, is_round)


def plates_of(settings: GroupSection, camera_from_sheet: Array) -> tuple[Plate, ...]:
    """Everything that may be between camera and print: the occluders, then the area lamps."""
    plates = [occluder_plate(occluder) for occluder in settings.occluders]
    sheet_from_camera = np.linalg.inv(camera_from_sheet)
    for lamp in settings.light.lamps:
        if isinstance(lamp, AreaLampSection):
            pose = sheet_from_camera @ camera_from_lamp(lamp, camera_from_sheet)
            plates.append(Plate(pose, lamp.size_m / 2, lamp.size_m / 2, False))
    return tuple(plates)


def hidden(plates: Iterable[Plate], camera_from_sheet: Array, points_sheet: ArrayLike) -> NDArray[np.bool_]:
    """Points of the print that are hidden from the camera's centre.

    Parameters
    ----------
    plates : iterable of Plate
    camera_from_sheet : (4, 4) array
    points_sheet : (n, 3) array_like
        In the sheet's frame, metres.

    Returns
    -------
    (n,) array of bool
        True where the segment from the camera's centre to the point meets a plate.
    """
    points = np.asarray(points_sheet, dtype=np.float64)
    eye_sheet = np.linalg.inv(camera_from_sheet)[:3, 3]
    mask = np.zeros(len(points), dtype=bool)
    for plate in plates:
        plate_from_sheet = np.linalg.inv(plate.sheet_from_plate)
        eye, p = transform_points(plate_from_sheet, eye_sheet), transform_points(plate_from_sheet, points)
        # The two ends are on different sides of the plate's plane; a segment in the plane meets nothing.
        crosses = eye[2] * p[:, 2] < 0
        share = eye[2] / np.where(crosses, eye[2] - p[:, 2], 1.0)
        at = (eye + share[:, None] * (p - eye))[:, :2] / [plate.half_width_m, plate.half_height_m]
        inside = (at**2).sum(axis=1) < 1 if plate.is_round else (np.abs(at) < 1).all(axis=1)
        mask |= crosses & inside
    return mask


def occluder_outlines_m(plates: Iterable[Plate], camera_from_sheet: Array) -> list[Array]:
    """Outline of each plate as a closed polyline (n, 3) in the camera frame, metres."""
    turn = np.linspace(0.0, 2 * np.pi, _OUTLINE_POINTS + 1)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    lines = []
    for plate in plates:
        flat = (circle if plate.is_round else _CORNERS) * [plate.half_width_m, plate.half_height_m]
        points = np.column_stack([flat, np.zeros(len(flat))])
        lines.append(transform_points(camera_from_sheet @ plate.sheet_from_plate, points))
    return lines


def check_occluders(occluders: list[OccluderSection], camera: Camera, camera_from_sheet: Array) -> None:
    """Check that every occluder is between the print's plane and the camera.

    Raises
    ------
    ValueError
        If one is farther from the print than the camera.
    """
    camera_height_m = float(np.linalg.inv(camera_from_sheet)[2, 3])
    for i, occluder in enumerate(occluders):
        # The lens extends by its aperture radius to every side of the camera's centre.
        if occluder.z_m >= camera_height_m - camera.aperture_radius_m:
            raise ValueError(
                f"{i}.z_m: {occluder.z_m:g} m above the print is not in front of the camera, which is "
                f"{camera_height_m:.3g} m above it; lower the occluder"
            )
