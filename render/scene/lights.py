"""Lights of a frame as Mitsuba emitters: constant environment, map, sun and sky, lamps."""

from __future__ import annotations

from typing import Any

import numpy as np

from roundel.render.scene.light_map import map_emitter
from roundel.render.scene.materials import placed_opaquely
from roundel.scenes.errors import UsageError
from roundel.scenes.study.light_section import AreaLampSection, Lamp, PointLampSection, SkySection
from roundel.scenes.surroundings.bodies import Surroundings, frame_on, pose_from_axes
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.lamps import camera_from_lamp, camera_from_level, irradiance_of, luminance_of

# Minimum fraction of the brightest lamp's rays: far from the centre a weak lamp may be the strongest.
_LEAST_SHARE = 0.1
# Mitsuba's sky has z up: x stays, its y is our forward, its z our -y.
_Z_UP = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])


def needs_colour(frame: Frame) -> bool:
    """Whether a frame needs a variant with colours, because it has a mosaic or a sky."""
    sky = frame.settings.light.sky is not None or (
        frame.surroundings is not None and frame.surroundings.sun is not None
    )
    return frame.settings.sensor.mosaic != "none" or sky


def in_colour(mi: Any) -> bool:
    """Whether the current variant has red, green and blue."""
    return int(mi.Spectrum(0.0).shape[0]) == 3


def spectrum(mi: Any, level: float, colour: list[float]) -> Any:
    """A light's strength times its colour; the luminance if the variant has no colours."""
    if in_colour(mi):
        return {"type": "rgb", "value": [level * c for c in colour]}
    return level * luminance_of(colour)


def sun_direction(section: SkySection) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Unit vector toward the sun in the camera frame (x right, y down, z forward)."""
    elevation, azimuth = np.radians([section.sun_elevation_deg, section.sun_azimuth_deg])
    return np.array([np.cos(elevation) * np.sin(azimuth), -np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])


def unit_of(frame: Frame) -> float:
    """The radiance that counts as 1 in a frame's Mitsuba scene.

    Mitsuba's sky has its scale as a constant of the kernel: another scale would recompile the kernel for each frame.
    """
    sky = frame.settings.light.sky
    return float(sky.scale) if sky is not None and sky.scale > 0 else 1.0


def environment_of(mi: Any, frame: Frame) -> Any:
    """Only the map or the sky of a frame, as a Mitsuba emitter."""
    environment = emitters(mi, frame)["environment"]
    return mi.load_dict(environment) if isinstance(environment, dict) else environment


def emitters(mi: Any, frame: Frame) -> dict[str, Any]:
    """The emitters of a frame, as entries of a Mitsuba scene, in its unit of radiance."""
    light = frame.settings.light
    found = {f"lamp_{i}": _lamp(mi, lamp, frame, _share(frame, i)) for i, lamp in enumerate(light.lamps)}
    if light.sky is not None:
        found["environment"] = _sky(mi, light.sky, camera_from_level(frame))
    elif light.map is not None:
        found["environment"] = map_emitter(mi, frame)
    else:
        # Do not sample a constant environment: reflected rays always hit it, without noise.
        weight = {"sampling_weight": 0.0} if light.lamps else {}
        radiance = spectrum(mi, light.environment, light.environment_colour)
        found["environment"] = {"type": "constant", "radiance": radiance, **weight}
    return found


def world_sky(mi: Any, around: Surroundings) -> dict[str, Any]:
    """Sun and sky outdoors; nothing in a room, which is closed."""
    if around.sun is None:
        return {}
    # Mitsuba's sky has z up.
    pose = pose_from_axes(*frame_on(around.up, 0.0), around.up, np.zeros(3))
    sky = {
        "type": "sunsky",
        "to_world": mi.ScalarTransform4f(pose),
        "sun_direction": [float(v) for v in around.sun],
        "turbidity": 3.5,
        "sun_scale": 1.0,
        "sky_scale": 1.0,
    }
    return {"environment": sky}


def _share(frame: Frame, index: int) -> float:
    """Sampling weight of a lamp: its irradiance at the marker's centre, with 1 for the brightest."""
    lamps, pose = frame.settings.light.lamps, frame.camera_from_sheet
    reached = [float(irradiance_of(lamp, pose, np.zeros((1, 3)))[0]) for lamp in lamps]
    return max(reached[index] / max(reached), _LEAST_SHARE) if max(reached) > 0 else 1.0


def _lamp(mi: Any, lamp: Lamp, frame: Frame, share: float) -> Any:
    pose, unit = camera_from_lamp(lamp, frame.camera_from_sheet), unit_of(frame)
    placed = mi.ScalarTransform4f(pose)
    if isinstance(lamp, AreaLampSection):
        square = {
            "type": "rectangle",
            "to_world": placed @ mi.ScalarTransform4f().scale(lamp.size_m / 2),
            # The lamp itself does not reflect light.
            "print": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {
                "type": "area",
                "radiance": spectrum(mi, lamp.radiance / unit, lamp.colour),
                "sampling_weight": share,
            },
        }
        return placed_opaquely(mi, square)
    intensity = spectrum(mi, lamp.intensity / unit, lamp.colour)
    if isinstance(lamp, PointLampSection):
        return {"type": "point", "position": list(pose[:3, 3]), "intensity": intensity, "sampling_weight": share}
    return {
        "type": "spot",
        "to_world": placed,
        "intensity": intensity,
        "cutoff_angle": lamp.cutoff_deg,
        "beam_width": lamp.beam_deg,
        "sampling_weight": share,
    }


def _sky(mi: Any, section: SkySection, placed: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, Any]:
    if not in_colour(mi):
        variant = mi.variant()
        raise UsageError(f"light.sky: {variant} does not support colour; render with {variant.replace('mono', 'rgb')}")
    return {
        "type": "sunsky",
        # The sun is given in the world's frame.
        "to_world": mi.ScalarTransform4f(placed @ _Z_UP),
        "sun_direction": (placed[:3, :3] @ sun_direction(section)).tolist(),
        "turbidity": section.turbidity,
        "sun_scale": section.sun,
        "sky_scale": 1.0 if section.scale > 0 else 0.0,
    }
