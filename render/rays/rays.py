"""From pixels to rays, in one pass: pixel aperture, diffraction, distortion, thin lens, shutter and motion.

World coordinates are the camera frame at time 0 (OpenCV's: x right, y down, z forward), and image positions are
OpenCV's: the centre of the top-left pixel is (0, 0). The rays are passed to Mitsuba's scene directly, so that its own
pixel coordinates, which start at pixel corners, are never used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from roundel.render.rays.undistort import directions, lens_numbers, undistorted
from roundel.scenes.camera.airy import effective_radius_m, radius_table
from roundel.scenes.camera.motion import adjoint
from roundel.scenes.study.sensor_section import filters_of
from roundel.scenes.world.frame import Frame

# Number of entries of the inverse encircled energy: 0.02 % of the light is between two entries.
_AIRY_ENTRIES = 4096


@dataclass(frozen=True)
class Optics:
    """A frame's camera and motion as values of the tracer.

    Every value is opaque to it, so that frames share kernels; only which values are None affects the kernel.
    """

    fx: Any
    fy: Any
    skew: Any
    cx: Any
    cy: Any
    side: Any
    model: str
    distortion: tuple[Any, ...]
    aperture: Any
    focus: Any
    blades: Any
    blade_turn: Any
    airy_x2: Any
    airy_scale: Any
    wavelengths: Any
    mosaic: Any
    shrinkage: Any
    vignetting: bool
    barrel: Any
    barrel_length: Any
    exposure_s: Any
    row_s: Any
    centre_row: Any
    camera_twist: Any
    sheet_twist: Any


def optics_of(dr: Any, mi: Any, frame: Frame) -> Optics:
    """The values of a frame's rays."""
    camera, motion = frame.camera, frame.motion
    k = camera.K

    def number(value: float) -> Any:
        return dr.opaque(mi.Float, float(value))

    def numbers(values: Any) -> list[Any]:
        return [number(v) for v in values]

    lens, diffracts, barrel = (
        camera.aperture_radius_m > 0,
        bool(camera.wavelengths_m),
        math.isfinite(camera.barrel_radius_m),
    )
    has_mosaic = frame.settings.sensor.mosaic != "none"
    in_colours = has_mosaic and len(camera.wavelengths_m) == 3
    cell = filters_of(frame.settings.sensor.mosaic) if has_mosaic else ()
    scale = 1 / (2 * np.pi * effective_radius_m(camera)) if diffracts else 0.0
    # Pass only what is used: an unused table would still change the kernel.
    return Optics(
        fx=number(k[0, 0]),
        fy=number(k[1, 1]),
        skew=number(k[0, 1]),
        cx=number(k[0, 2]),
        cy=number(k[1, 2]),
        side=number(camera.pixel_side),
        model=camera.distortion_model,
        distortion=tuple(numbers(lens_numbers(camera))),
        aperture=number(camera.aperture_radius_m) if lens else None,
        focus=number(camera.focus_distance_m) if lens else None,
        blades=number(camera.blades) if lens and camera.blades else None,
        blade_turn=number(math.radians(camera.blade_turn_deg)) if lens and camera.blades else None,
        airy_x2=mi.Float(radius_table(_AIRY_ENTRIES + 1).astype(np.float32)) if diffracts else None,
        airy_scale=number(scale) if diffracts else None,
        wavelengths=mi.Float(np.array(camera.wavelengths_m, dtype=np.float32)) if diffracts else None,
        mosaic=mi.UInt32(cell) if in_colours else None,
        shrinkage=mi.Float(1 / np.array(camera.magnification, dtype=np.float32)[list(cell)])
        if camera.magnification
        else None,
        vignetting=camera.natural_vignetting,
        barrel=number(camera.barrel_radius_m) if lens and barrel else None,
        barrel_length=number(camera.barrel_length_m) if lens and barrel else None,
        exposure_s=number(motion.exposure_s) if motion.moves else None,
        row_s=number(motion.row_s) if motion.moves else None,
        centre_row=number(motion.centre_row_px) if motion.moves else None,
        camera_twist=numbers(motion.camera_twist) if np.any(motion.camera_twist) else None,
        sheet_twist=numbers(adjoint(frame.camera_from_sheet, -motion.marker_twist))
        if np.any(motion.marker_twist)
        else None,
    )


def colour_index(mi: Any, dr: Any, table: Any, column: Any, row: Any) -> Any:
    """Colour of each pixel's filter: 0 red, 1 green, 2 blue."""
    return dr.gather(mi.UInt32, table, _place_in_cell(column, row))


def _place_in_cell(column: Any, row: Any) -> Any:
    """Number of each pixel in its cell of a mosaic, row by row."""
    return (row & 1) * 2 + (column & 1)


def _airy_offset(dr: Any, mi: Any, optics: Optics, sampler: Any, column: Any, row: Any) -> tuple[Any, Any]:
    """An offset in normalised image coordinates, drawn from the Airy pattern of the ray's wavelength."""
    at = sampler.next_2d()
    place = at.x * _AIRY_ENTRIES
    low = dr.minimum(mi.UInt32(place), _AIRY_ENTRIES - 1)
    a, b = (dr.gather(mi.Float, optics.airy_x2, low + i) for i in (0, 1))
    x = dr.sqrt(a + (b - a) * (place - mi.Float(low)))
    count = dr.width(optics.wavelengths)
    if optics.mosaic is not None:
        which = colour_index(mi, dr, optics.mosaic, column, row)
    elif count > 1:
        which = dr.minimum(mi.UInt32(sampler.next_1d() * count), count - 1)
    else:
        which = dr.zeros(mi.UInt32, dr.width(place))
    alpha = x * optics.airy_scale * dr.gather(mi.Float, optics.wavelengths, which)
    sine, cosine = dr.sincos(dr.two_pi * at.y)
    return alpha * cosine, alpha * sine


def _lens_point(dr: Any, mi: Any, optics: Optics, sample: Any) -> Any:
    """A point of the aperture, uniform by area."""
    if optics.blades is None:
        return optics.aperture * mi.warp.square_to_uniform_disk_concentric(sample)
    # The polygon is split into triangles at its centre: the first number selects one, its remainder places the point.
    place = sample.x * optics.blades
    corner = dr.floor(dr.minimum(place, optics.blades - 1e-3))
    step = dr.two_pi / optics.blades
    s0, c0 = dr.sincos(optics.blade_turn + corner * step)
    s1, c1 = dr.sincos(optics.blade_turn + (corner + 1) * step)
    reach, across = optics.aperture * dr.sqrt(sample.y), place - corner
    return mi.Point2f(reach * (c0 + (c1 - c0) * across), reach * (s0 + (s1 - s0) * across))


def _moved(dr: Any, mi: Any, twist: list[Any], time: Any, point: Any, direction: Any) -> tuple[Any, Any]:
    """A ray after `time` seconds of a constant twist: the closed form of `scenes.camera.motion.exp_twist`."""
    v, w = mi.Vector3f(*twist[:3]) * time, mi.Vector3f(*twist[3:]) * time
    a2 = dr.squared_norm(w)
    # Series: no cancellation at small angles, and exact in float32 up to one radian, which no exposure reaches.
    first = 1 + a2 * (-1 / 6 + a2 * (1 / 120 + a2 * (-1 / 5040 + a2 / 362880)))
    second = 0.5 + a2 * (-1 / 24 + a2 * (1 / 720 + a2 * (-1 / 40320 + a2 / 3628800)))
    third = 1 / 6 + a2 * (-1 / 120 + a2 * (1 / 5040 + a2 * (-1 / 362880 + a2 / 39916800)))

    def turned(x: Any) -> Any:
        once = dr.cross(w, x)
        return x + first * once + second * dr.cross(w, once)

    once = dr.cross(w, v)
    shift = v + second * once + third * dr.cross(w, once)
    return mi.Point3f(turned(mi.Vector3f(point)) + shift), turned(direction)


def _mid_exposure(mi: Any, optics: Optics, row: Any) -> Any:
    return (mi.Float(row) - optics.centre_row) * optics.row_s


def _at_time(dr: Any, mi: Any, optics: Optics, time: Any, origin: Any, direction: Any) -> tuple[Any, Any]:
    """A ray of the camera frame at `time`, where the scene was then."""
    for twist in (optics.camera_twist, optics.sheet_twist):
        if twist is not None:
            origin, direction = _moved(dr, mi, twist, time, origin, direction)
    return origin, direction


def _chief(dr: Any, mi: Any, optics: Optics, x: Any, y: Any) -> Any:
    """Direction that the lens images at normalised image coordinates, by inverting the distortion."""
    if optics.model == "fisheye":
        return directions(dr, mi, optics.distortion, x, y)
    if optics.distortion:
        x, y = undistorted(dr, mi, optics.model, optics.distortion, x, y)
    return mi.Vector3f(x, y, 1.0)


def shoot(dr: Any, mi: Any, optics: Optics, column: Any, row: Any, sampler: Any) -> tuple[Any, Any]:
    """Rays of pixels, and their weights.

    Parameters
    ----------
    column, row : UInt32
        Position of the pixel.
    sampler : Sampler
        Samples pixel, aperture, time, diffraction and wavelength, each stratified.

    Returns
    -------
    ray : RayDifferential3f
    weight : Float
        Weight from natural and mechanical vignetting; 1 without vignetting.
    """
    jitter = sampler.next_2d()
    # A pixel collects light on a square about its centre, which has integer coordinates.
    u = mi.Float(column) + (jitter.x - 0.5) * optics.side
    v = mi.Float(row) + (jitter.y - 0.5) * optics.side
    y = (v - optics.cy) / optics.fy
    x = (u - optics.cx - optics.skew * y) / optics.fx
    if optics.shrinkage is not None:
        # The lens magnifies what the pixel's filter passes; relative to green the pixel is so much nearer to the axis.
        shrunk = dr.gather(mi.Float, optics.shrinkage, _place_in_cell(column, row))
        x, y = x * shrunk, y * shrunk
    if optics.airy_x2 is not None:
        dx, dy = _airy_offset(dr, mi, optics, sampler, column, row)
        x, y = x + dx, y + dy
    chief = _chief(dr, mi, optics, x, y)
    weight = mi.Float(1.0)
    if optics.vignetting:
        weight = weight * dr.square(dr.square(dr.maximum(dr.normalize(chief).z, 0.0)))
    origin = dr.zeros(mi.Point3f, dr.width(x))
    direction = chief
    if optics.aperture is not None:
        lens = _lens_point(dr, mi, optics, sampler.next_2d())
        origin = mi.Point3f(lens.x, lens.y, 0.0)
        direction = chief * (optics.focus / chief.z) - mi.Vector3f(origin)
        if optics.barrel is not None:
            at = mi.Point2f(lens.x, lens.y) + mi.Vector2f(chief.x, chief.y) / chief.z * optics.barrel_length
            weight = dr.select(dr.squared_norm(at) <= dr.square(optics.barrel), weight, 0.0)
    time = mi.Float(0.0)
    if optics.exposure_s is not None:
        time = _mid_exposure(mi, optics, row) + (sampler.next_1d() - 0.5) * optics.exposure_s
        origin, direction = _at_time(dr, mi, optics, time, origin, direction)
    ray = mi.Ray3f(origin, dr.normalize(direction), time, mi.Color0f())
    return mi.RayDifferential3f(ray), weight


def central_ray(dr: Any, mi: Any, optics: Optics, column: Any, row: Any) -> tuple[Any, Any]:
    """The one ray through the centre of each pixel and of the lens, at mid-exposure of the pixel's row.

    Neither aperture, diffraction nor the magnification of a colour: it is the ray of the camera of record.

    Parameters
    ----------
    column, row : UInt32
        Position of the pixel.

    Returns
    -------
    ray : Ray3f
    axial : Float
        Cosine of its angle to the optical axis: Z over the distance along the ray.
    """
    y = (mi.Float(row) - optics.cy) / optics.fy
    x = (mi.Float(column) - optics.cx - optics.skew * y) / optics.fx
    chief = dr.normalize(_chief(dr, mi, optics, x, y))
    origin, direction = dr.zeros(mi.Point3f, dr.width(x)), chief
    if optics.exposure_s is not None:
        origin, direction = _at_time(dr, mi, optics, _mid_exposure(mi, optics, row), origin, direction)
    return mi.Ray3f(origin, direction, mi.Float(0.0), mi.Color0f()), chief.z
