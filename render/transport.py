"""Light on a plain sheet, in closed form: no search for what a ray meets, and no noise but the lamps' own.

A frame is plain when a matte sheet stands under a constant sky and lamps, with nothing between. A ray then meets the
plane by one division; the sky gives reflectance times radiance, exactly; a lamp is a hole in the sky that shines, and
is sampled over its area (Shirley, Wang and Zimmerman 1996) with the sky's radiance taken off. Every other frame goes
through Mitsuba's integrators, and the tests hold the two against each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from roundel.render import ink
from roundel.render.lights import in_colour
from roundel.render.scene import WALL_DISTANCES
from roundel.scenes.camera import project
from roundel.scenes.frame import Frame
from roundel.scenes.lamps import camera_from_lamp, luminance_of
from roundel.scenes.light_section import AreaLampSection, PointLampSection
from roundel.scenes.pose import transform_points

# A lamp this near to the image may be seen in it, through blur and motion: it then goes the general way.
_MARGIN_PX = 64.0


@dataclass(frozen=True)
class Lamp:
    """A lamp's numbers: where it is, half its sides, where it faces, its area (0 for a point), and its light."""

    place: Any
    half_x: Any
    half_y: Any
    normal: Any
    area: Any
    light: Any


@dataclass(frozen=True)
class PlainScene:
    """A sheet before a wall under sky and lamps, as numbers of the tracer."""

    texture: Any
    normal: Any
    origin: Any
    half: Any
    sky: Any
    lamps: tuple[Lamp, ...]


def _lamp_is_seen(frame: Frame, lamp: AreaLampSection) -> bool:
    x, y = (a.ravel() for a in np.meshgrid(*2 * [np.linspace(-0.5, 0.5, 9) * lamp.size_m]))
    pose = camera_from_lamp(lamp, frame.camera_from_sheet)
    points = transform_points(pose, np.column_stack([x, y, np.zeros_like(x)]))
    px = project(frame.camera, points)
    size = np.array([frame.camera.width_px, frame.camera.height_px])
    # NaN is behind the camera, or beyond what the lens images.
    return bool(np.any(np.all((px > -_MARGIN_PX) & (px < size + _MARGIN_PX), axis=-1)))


def is_plain(frame: Frame) -> bool:
    """Whether a frame's light has the closed form."""
    light = frame.settings.light
    areas = [lamp for lamp in light.lamps if isinstance(lamp, AreaLampSection)]
    return (
        frame.settings.marker.surface.kind == "matte"
        and frame.settings.render.bounces == 1
        and not frame.settings.occluders
        and light.map is None
        and light.sky is None
        and all(isinstance(lamp, AreaLampSection | PointLampSection) for lamp in light.lamps)
        # Two lamps may stand in each other's light, or one in a point's.
        and not (areas and len(light.lamps) > 1)
        and not any(_lamp_is_seen(frame, lamp) for lamp in areas)
    )


def plain_scene(dr: Any, mi: Any, frame: Frame) -> PlainScene:
    """The numbers of a plain frame."""

    def number(value: float) -> Any:
        return dr.opaque(mi.Float, float(value))

    def point(values: Any) -> Any:
        return mi.Point3f(*(number(v) for v in values))

    def spectrum(colour: Any, scale: float) -> Any:
        if in_colour(mi):
            return mi.Spectrum(*(number(c * scale) for c in colour))
        return mi.Spectrum(number(luminance_of(colour) * scale))

    texture = mi.load_dict({"type": ink.NAME})
    texture.paint(frame.sheet, frame.camera_from_sheet)
    aim = frame.camera_from_sheet[:3, 3]
    lamps = []
    for lamp in frame.settings.light.lamps:
        pose = camera_from_lamp(lamp, frame.camera_from_sheet)
        half = lamp.size_m / 2 if isinstance(lamp, AreaLampSection) else 0.0
        strength = lamp.radiance if isinstance(lamp, AreaLampSection) else lamp.intensity
        lamps.append(
            Lamp(
                point(pose[:3, 3]),
                mi.Vector3f(point(half * pose[:3, 0])),
                mi.Vector3f(point(half * pose[:3, 1])),
                mi.Vector3f(point(pose[:3, 2])),
                number(4 * half * half) if half else None,
                spectrum(lamp.colour, strength),
            )
        )
    light = frame.settings.light
    return PlainScene(
        texture,
        mi.Vector3f(point(frame.camera_from_sheet[:3, 2])),
        point(aim),
        number(WALL_DISTANCES * float(np.linalg.norm(aim))),
        spectrum(light.environment_colour, light.environment),
        tuple(lamps),
    )


def trace(dr: Any, mi: Any, scene: PlainScene, sampler: Any, ray: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Radiance along rays.

    Returns
    -------
    radiance : Spectrum
    depth : Float
        Z of the point met, metres.
    on_plane : Bool
        Whether the plane of the sheet is met.
    x, y : Float
        Where on it, metres.
    """
    distance = dr.dot(scene.origin - ray.o, scene.normal) / dr.dot(ray.d, scene.normal)
    hit = ray.o + ray.d * distance
    x, y = scene.texture.in_plane(hit)
    # One face of the plane is printed; the other reflects nothing.
    on_plane = (distance > 0) & (dr.abs(x) < scene.half) & (dr.abs(y) < scene.half)
    printed = dr.dot(ray.d, scene.normal) < 0
    arriving = scene.sky
    for lamp in scene.lamps:
        if lamp.area is None:
            toward = lamp.place - hit
            r2 = dr.squared_norm(toward)
            cosine = dr.maximum(dr.dot(scene.normal, toward), 0.0) * dr.rsqrt(r2)
            arriving = arriving + lamp.light * (cosine / r2 * dr.inv_pi)
            continue
        at = sampler.next_2d()
        toward = lamp.place + (2 * at.x - 1) * lamp.half_x + (2 * at.y - 1) * lamp.half_y - hit
        r2 = dr.squared_norm(toward)
        facing = -dr.dot(lamp.normal, toward)
        geometry = dr.maximum(dr.dot(scene.normal, toward), 0.0) * dr.abs(facing) / dr.square(r2) * lamp.area
        # The back of a lamp is black, and hides the sky like its front.
        shown = dr.select(facing > 0, lamp.light, mi.Spectrum(0.0)) - scene.sky
        arriving = arriving + shown * (geometry * dr.inv_pi)
    reflected = arriving * scene.texture.reflectance_at(x, y)
    radiance = dr.select(on_plane, dr.select(printed, reflected, mi.Spectrum(0.0)), scene.sky)
    return radiance, hit.z, on_plane, x, y
