"""Light transport on a plain sheet in closed form, without ray intersection.

A frame is plain when a matte sheet stands under a sky and lamps, with nothing between. A ray then meets the plane by
one division. A sky lights all of the plane alike, so that its irradiance is worked out once; a lamp is a hole in a
constant sky that shines, and is sampled over its area (Shirley, Wang and Zimmerman 1996) with the sky's radiance taken
off. Every other frame goes through Mitsuba's integrators, and the tests hold the two against each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.scene import ink
from roundel.render.scene.lights import environment_of, in_colour, unit_of
from roundel.render.scene.scene import WALL_DISTANCES
from roundel.scenes.camera.model import project, ray_direction
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.study.light_section import AreaLampSection, PointLampSection
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.lamps import camera_from_lamp, luminance_of

# A lamp this near to the image may be seen in it, through blur and motion: it then goes the general way.
_MARGIN_PX = 64.0

# The wall is taken to fill the picture if it does so with a tenth of its half side to spare.
_ROOM = 0.9

_SKY_SAMPLES_BASE2 = 17

Array = NDArray[np.float64]


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
    """A sheet before a wall under sky and lamps, as numbers of the tracer.

    `sky` is the constant sky's radiance, `lit` what a white plane reflects of its sky; `beyond` is the emitter that
    rays see past the wall's end, None if they all meet the wall or the sky is constant.
    """

    texture: Any
    normal: Any
    origin: Any
    half: Any
    sky: Any
    lit: Any
    beyond: Any
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
        frame.surroundings is None
        and frame.settings.marker.surface.kind == "matte"
        and frame.settings.render.bounces == 1
        and not frame.settings.occluders
        and all(isinstance(lamp, AreaLampSection | PointLampSection) for lamp in light.lamps)
        # Two lamps may stand in each other's light, or one in a point's.
        and not (areas and len(light.lamps) > 1)
        # A lamp before a sky that is not even would be a hole of many brightnesses.
        and not (areas and (light.map is not None or light.sky is not None))
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
    if light.map is None and light.sky is None:
        sky = lit = spectrum(light.environment_colour, light.environment)
        beyond = None
    else:
        sky, emitter, unit = mi.Spectrum(0.0), environment_of(mi, frame), number(unit_of(frame))
        lit = _reflected(dr, mi, emitter, frame.camera_from_sheet[:3, 2]) * unit
        beyond = None if _wall_fills(frame) else (emitter, unit)
    return PlainScene(
        texture,
        mi.Vector3f(point(frame.camera_from_sheet[:3, 2])),
        point(aim),
        number(WALL_DISTANCES * float(np.linalg.norm(aim))),
        sky,
        lit,
        beyond,
        tuple(lamps),
    )


def _reflected(dr: Any, mi: Any, emitter: Any, normal: Array) -> Any:
    """What a white matte plane reflects of a distant emitter: its irradiance over pi, the same all over the plane."""
    from scipy.stats import qmc

    # Even points of a fixed sequence: a hundred thousand of them leave 1e-4 of it, the same in every pixel.
    points = qmc.Sobol(2, scramble=True, rng=np.random.default_rng(0)).random_base2(_SKY_SAMPLES_BASE2)
    at = mi.Point2f(points.T.astype(np.float32))
    where = dr.zeros(mi.SurfaceInteraction3f, len(points))
    towards, weight = emitter.sample_direction(where, at)
    facing = mi.Vector3f(*(dr.opaque(mi.Float, float(v)) for v in normal))
    mean = [dr.mean(channel) for channel in weight * dr.maximum(dr.dot(towards.d, facing), 0.0)]
    dr.eval(mean)
    return mi.Spectrum(*mean) * dr.inv_pi


def _wall_fills(frame: Frame) -> bool:
    """Whether all that the camera sees is sheet or wall, with room to spare."""
    camera, pose = frame.camera, frame.camera_from_sheet
    u, v = np.linspace(-0.5, camera.width_px - 0.5, 33), np.linspace(-0.5, camera.height_px - 0.5, 33)
    rays = ray_direction(camera, np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (pose[:3, 3] @ pose[:3, 2]) / (rays @ pose[:3, 2])
        across = (rays * distance[:, None] - pose[:3, 3]) @ pose[:3, :2]
    half = _ROOM * WALL_DISTANCES * float(np.linalg.norm(pose[:3, 3]))
    return bool(np.all((distance > 0) & (np.abs(across) < half).all(axis=1)))


def _past_the_wall(dr: Any, mi: Any, scene: PlainScene, ray: Any) -> Any:
    if scene.beyond is None:
        return scene.sky
    emitter, unit = scene.beyond
    there = dr.zeros(mi.SurfaceInteraction3f, dr.width(ray.d))
    there.wi = -ray.d
    return emitter.eval(there) * unit


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
    arriving = scene.lit
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
    radiance = dr.select(on_plane, dr.select(printed, reflected, mi.Spectrum(0.0)), _past_the_wall(dr, mi, scene, ray))
    return radiance, hit.z, on_plane, x, y
