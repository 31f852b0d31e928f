"""Light transport on an unoccluded sheet in closed form, without ray intersection.

A frame is plain if a matte sheet is lit by a sky and lamps, with nothing in between, or a glossy one under a uniform
sky (`roundel.render.scene.gloss`). The hit of a ray with the plane is then one division. A sky illuminates the whole
plane uniformly, so its irradiance is computed once. A lamp is a luminous hole in a constant sky, sampled over its area
(Shirley, Wang and Zimmerman 1996) minus the sky's radiance. All other frames use Mitsuba's integrators, and tests
compare the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.scene import ink
from roundel.render.scene.gloss import Gloss, gloss_of, glossy_light
from roundel.render.scene.lights import environment_of, in_colour, unit_of
from roundel.render.scene.sheets import WALL_DISTANCES
from roundel.scenes.camera.model import project, ray_direction
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.study.light_section import AreaLampSection, PointLampSection
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.lamps import camera_from_lamp, luminance_of

# A lamp this close to the image may be visible through blur and motion; it then uses Mitsuba's integrators.
_MARGIN_PX = 64.0

# The wall counts as filling the picture if it does so with a margin of a tenth of its half side.
_ROOM = 0.9

_SKY_SAMPLES_BASE2 = 17

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Lamp:
    """Values of a lamp: position, half sides, direction it faces, area (0 for a point), and emitted light."""

    place: Any
    half_x: Any
    half_y: Any
    normal: Any
    area: Any
    light: Any


@dataclass(frozen=True)
class PlainScene:
    """A sheet in front of a wall under sky and lamps, as values of the tracer.

    `sky` is the constant sky's radiance, `lit` the radiance that a white plane reflects of its sky; `beyond` is the
    emitter that rays hit past the wall's end, None if they all hit the wall or the sky is constant. `gloss` is None on
    a matte sheet.
    """

    texture: Any
    normal: Any
    origin: Any
    half: Any
    sky: Any
    lit: Any
    beyond: Any
    lamps: tuple[Lamp, ...]
    gloss: Gloss | None = None


def _lamp_is_seen(frame: Frame, lamp: AreaLampSection) -> bool:
    x, y = (a.ravel() for a in np.meshgrid(*2 * [np.linspace(-0.5, 0.5, 9) * lamp.size_m]))
    pose = camera_from_lamp(lamp, frame.camera_from_sheet)
    points = transform_points(pose, np.column_stack([x, y, np.zeros_like(x)]))
    px = project(frame.camera, points)
    size = np.array([frame.camera.width_px, frame.camera.height_px])
    # NaN: behind the camera, or outside the lens's field.
    return bool(np.any(np.all((px > -_MARGIN_PX) & (px < size + _MARGIN_PX), axis=-1)))


def is_plain(frame: Frame) -> bool:
    """Whether a frame's light transport has the closed form."""
    light = frame.settings.light
    is_matte, is_uniform = frame.settings.marker.surface.kind == "matte", light.map is None and light.sky is None
    areas = [lamp for lamp in light.lamps if isinstance(lamp, AreaLampSection)]
    return (
        frame.on_wall
        and (is_matte or is_uniform)
        and frame.settings.render.bounces == 1
        and not frame.settings.occluders
        and all(isinstance(lamp, AreaLampSection | PointLampSection) for lamp in light.lamps)
        # Two lamps may occlude each other, or one a point light.
        and not (areas and len(light.lamps) > 1)
        # A lamp in front of a non-uniform sky would hide varying radiance.
        and not (areas and not is_uniform)
        and not any(_lamp_is_seen(frame, lamp) for lamp in areas)
    )


def plain_scene(dr: Any, mi: Any, frame: Frame) -> PlainScene:
    """The values of a plain frame."""

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
    light, surface = frame.settings.light, frame.settings.marker.surface
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
        None if surface.kind == "matte" else gloss_of(mi, surface, texture),
    )


def _reflected(dr: Any, mi: Any, emitter: Any, normal: Array) -> Any:
    """Radiance that a white matte plane reflects of a distant emitter: irradiance over pi, uniform over the plane."""
    from scipy.stats import qmc

    # Points of a fixed low-discrepancy sequence: with a hundred thousand the error is 1e-4, the same in every pixel.
    points = qmc.Sobol(2, scramble=True, rng=np.random.default_rng(0)).random_base2(_SKY_SAMPLES_BASE2)
    at = mi.Point2f(points.T.astype(np.float32))
    where = dr.zeros(mi.SurfaceInteraction3f, len(points))
    towards, weight = emitter.sample_direction(where, at)
    facing = mi.Vector3f(*(dr.opaque(mi.Float, float(v)) for v in normal))
    mean = [dr.mean(channel) for channel in weight * dr.maximum(dr.dot(towards.d, facing), 0.0)]
    dr.eval(mean)
    return mi.Spectrum(*mean) * dr.inv_pi


def _wall_fills(frame: Frame) -> bool:
    """Whether the camera sees only sheet and wall, with a margin."""
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


def distance_to_plane(dr: Any, scene: PlainScene, ray: Any) -> Any:
    """Distance (Float) along unit rays to the plane of sheet and wall, metres; 0 where it is not hit."""
    distance, _, on_plane, _, _ = _landing(dr, scene, ray)
    return dr.select(on_plane, distance, 0.0)


def _landing(dr: Any, scene: PlainScene, ray: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Where rays meet the plane: distance, point, whether it is on the plane, and its coordinates there, metres."""
    distance = dr.dot(scene.origin - ray.o, scene.normal) / dr.dot(ray.d, scene.normal)
    hit = ray.o + ray.d * distance
    x, y = scene.texture.in_plane(hit)
    return distance, hit, (distance > 0) & (dr.abs(x) < scene.half) & (dr.abs(y) < scene.half), x, y


def trace(dr: Any, mi: Any, scene: PlainScene, sampler: Any, ray: Any) -> tuple[Any, list[tuple[Any, Any, Any]]]:
    """Radiance along rays.

    Returns
    -------
    radiance : Spectrum
    sheets : list of (Bool, Float, Float)
        Whether the plane of the sheet is hit, and the position on it, metres.
    """
    _, hit, on_plane, x, y = _landing(dr, scene, ray)
    # One face of the plane is printed; the other reflects nothing.
    printed = dr.dot(ray.d, scene.normal) < 0
    reflectance = scene.texture.reflectance_at(x, y)
    if scene.gloss is None:
        reflected = _arriving(dr, mi, scene, sampler, hit) * reflectance
    else:
        reflected = glossy_light(
            dr, mi, scene.gloss, scene.normal, scene.sky, scene.lamps, reflectance, sampler, hit, ray
        )
    radiance = dr.select(on_plane, dr.select(printed, reflected, mi.Spectrum(0.0)), _past_the_wall(dr, mi, scene, ray))
    return radiance, [(on_plane, x, y)]


def _arriving(dr: Any, mi: Any, scene: PlainScene, sampler: Any, hit: Any) -> Any:
    """Radiance (Spectrum) that a white matte plane would reflect."""
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
        # The back of a lamp is black and hides the sky, like its front.
        shown = dr.select(facing > 0, lamp.light, mi.Spectrum(0.0)) - scene.sky
        arriving = arriving + shown * (geometry * dr.inv_pi)
    return arriving
