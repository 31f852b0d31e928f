"""Geometry of lamps, shared by renderer and truth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.marker import Sheet
from roundel.scenes.study.light_section import AreaLampSection, Lamp, LightSection, SpotLampSection

if TYPE_CHECKING:
    from roundel.scenes.world.frame import Frame

Array = NDArray[np.float64]

# Luminance weights of linear red, green and blue (ITU-R BT.709), as used by Mitsuba.
LUMINANCE = (0.212671, 0.715160, 0.072169)


def camera_from_level(frame: Frame) -> Array:
    """Pose (4, 4) of the frame that a sky and a map are given in: X right, Y down, Z forward.

    The camera's own, unless a scene around it says which way is up.
    """
    around = frame.surroundings
    return np.eye(4) if around is None or around.camera_from_level is None else around.camera_from_level


def luminance_of(colour: ArrayLike) -> float:
    """Luminance of a light's red, green and blue as seen by a sensor without colour filters; 1 for white."""
    return float(np.dot(LUMINANCE, np.asarray(colour, dtype=np.float64)))


def facing(position_m: ArrayLike, aim_m: ArrayLike) -> Array:
    """Pose (4, 4) of a lamp: origin at `position_m`, Z toward `aim_m`, X and Y along the sides of its square.

    The same axes as Mitsuba's `look_at` with the camera's vertical as the up vector.

    Raises
    ------
    ValueError
        If the lamp is at the point it aims at.
    """
    position = np.asarray(position_m, dtype=np.float64)
    toward = np.asarray(aim_m, dtype=np.float64) - position
    distance = np.linalg.norm(toward)
    if distance < 1e-6:
        raise ValueError("is at the point it faces; move it")
    toward = toward / distance
    # Any vector that is not along the line of sight can be the up vector of the square.
    up = np.array([0.0, -1.0, 0.0]) if abs(toward[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    side = np.cross(up, toward)
    side /= np.linalg.norm(side)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([side, np.cross(toward, side), toward], axis=-1)
    pose[:3, 3] = position
    return pose


def camera_from_lamp(lamp: Lamp, camera_from_sheet: Array) -> Array:
    """Pose (4, 4) of a lamp in the camera frame: it faces the marker's centre, or the point a spotlight aims at."""
    aim = [lamp.aim_x_m, lamp.aim_y_m, 0.0] if isinstance(lamp, SpotLampSection) else [0.0, 0.0, 0.0]
    return facing(lamp.position_m, transform_points(camera_from_sheet, aim))


def irradiance_of(lamp: Lamp, camera_from_sheet: Array, points_sheet: ArrayLike) -> Array:
    """Irradiance (n,) of points (n, 3) of the print under one unoccluded lamp; an area lamp is treated as distant.

    Accurate enough to weight lamps against one another and to check whether they reach the print at all. Point light:
    E = I cos / d^2; a small area: I = L A cos of the angle at the lamp.
    """
    pose = camera_from_lamp(lamp, camera_from_sheet)
    points = transform_points(camera_from_sheet, points_sheet)
    toward = pose[:3, 3] - points
    distance = np.maximum(np.linalg.norm(toward, axis=-1), 1e-6)
    at_print = np.maximum(toward @ camera_from_sheet[:3, 2] / distance, 0.0)
    at_lamp = -toward @ pose[:3, 2] / distance
    if isinstance(lamp, AreaLampSection):
        intensity = lamp.radiance * lamp.size_m**2 * np.maximum(at_lamp, 0.0)
    elif isinstance(lamp, SpotLampSection):
        # The intensity falls off linearly with the angle, from the beam to the cutoff (Mitsuba's `spot`).
        angle = np.degrees(np.arccos(np.clip(at_lamp, -1.0, 1.0)))
        width = max(lamp.cutoff_deg - lamp.beam_deg, 1e-9)
        intensity = lamp.intensity * np.clip((lamp.cutoff_deg - angle) / width, 0.0, 1.0)
    else:
        intensity = np.full(len(points), lamp.intensity)
    return np.asarray(luminance_of(lamp.colour) * intensity * at_print / distance**2, dtype=np.float64)


def check_light(light: LightSection, sheet: Sheet, camera_from_sheet: Array) -> None:
    """Check that some light can reach the print.

    Raises
    ------
    ValueError
        If a lamp is at the point it aims at, or the image would be black.
    """
    steps = np.linspace(0.0, 1.0, 9)
    (x0, y0), (x1, y1) = sheet.low_m, sheet.high_m
    x, y = np.meshgrid(x0 + (x1 - x0) * steps, y0 + (y1 - y0) * steps)
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    lit = False
    for i, lamp in enumerate(light.lamps):
        try:
            lit |= bool(irradiance_of(lamp, camera_from_sheet, points).max() > 0)
        except ValueError as error:
            raise ValueError(f"lamps.{i}: {error}") from error
    if light.sky is not None:
        lit |= light.sky.scale > 0
    elif light.map is not None:
        lit |= light.map.scale > 0
    else:
        lit |= light.environment * luminance_of(light.environment_colour) > 0
    if not lit:
        raise ValueError(
            "lamps: no light reaches the print; add an environment, or a lamp on the printed side that shines on it"
        )
