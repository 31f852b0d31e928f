"""A frame as a Mitsuba scene: one plane that carries sheet and wall, an environment, area lights."""

from __future__ import annotations

from typing import Any

import numpy as np

from roundel.render import ink, sensor_rays
from roundel.scenes.frame import Frame

# The wall reaches this many marker distances to each side; beyond it the environment is seen.
WALL_DISTANCES = 4.0


def build_scene(mi: Any, frame: Frame) -> tuple[Any, Any, Any]:
    """Assemble a frame.

    Returns
    -------
    scene, integrator, sensor
        Mitsuba objects; world coordinates are the camera frame.
    """
    texture = mi.load_dict({"type": ink.NAME})
    texture.paint(frame.sheet, frame.camera_from_sheet)
    # The rays are ours and no film develops them; one of the smallest size keeps Mitsuba content.
    film = {"type": "hdrfilm", "width": 1, "height": 1, "pixel_format": "luminance"}
    sensor = mi.load_dict({"type": sensor_rays.NAME, "film": film})
    sensor.look_through(frame.camera)

    half = WALL_DISTANCES * float(np.linalg.norm(frame.camera_from_sheet[:3, 3]))
    to_world = mi.ScalarTransform4f(frame.camera_from_sheet) @ mi.ScalarTransform4f().scale([half, half, 1.0])
    light = frame.settings.light
    objects: dict[str, Any] = {
        "type": "scene",
        "plane": {"type": "rectangle", "to_world": to_world, "print": {"type": "diffuse", "reflectance": texture}},
    }
    for i, lamp in enumerate(light.lamps):
        position = np.array(lamp.position_m, dtype=np.float64)
        aim = frame.camera_from_sheet[:3, 3]
        toward = aim - position
        # Any vector that is not along the line of sight will do as the square's upright.
        up = [0.0, -1.0, 0.0] if abs(toward[1]) < 0.9 * np.linalg.norm(toward) else [0.0, 0.0, 1.0]
        placed = mi.ScalarTransform4f().look_at(origin=position.tolist(), target=aim.tolist(), up=up)
        objects[f"lamp_{i}"] = {
            "type": "rectangle",
            "to_world": placed @ mi.ScalarTransform4f().scale(lamp.size_m / 2),
            "emitter": {"type": "area", "radiance": lamp.radiance},
        }
    # The environment is left to the reflected rays: they always find it, without noise. Lamps are sampled.
    environment: dict[str, Any] = {"type": "constant", "radiance": light.environment}
    if light.lamps:
        environment["sampling_weight"] = 0.0
    objects["environment"] = environment
    samples = {"emitter_samples": 1 if light.lamps else 0, "bsdf_samples": 1}
    integrator = mi.load_dict({"type": "direct", **samples})
    return mi.load_dict(objects), integrator, sensor
