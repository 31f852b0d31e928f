"""From a frame to linear radiance: rays, light transport, mean and variance of each pixel.

Each pixel is estimated by 8 independently stratified replicates. Their scatter is the variance of the estimate; the
scatter of single stratified samples would overstate it (five times at an edge).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout.radiance import REPLICATES
from roundel.render.depth import Distance, depth_plane
from roundel.render.rays.rays import Optics, colour_index, optics_of, shoot
from roundel.render.rays.sample_allocation import sample_map
from roundel.render.rays.samples import GROUP, STRATIFIED, counts_of
from roundel.render.scene.scene import build_scene, distance_to_surface, trace_built
from roundel.render.scene.transport import distance_to_plane, is_plain, plain_scene, trace
from roundel.scenes.markers.marker import Part
from roundel.scenes.study.sensor_section import filters_of
from roundel.scenes.world.frame import Frame

# Rays traced at once: about 50 MB per million.
_CHUNK = 4_000_000

# If fewer pixels than this fraction need other counts, they are rendered twice instead of being skipped first.
_FEW = 0.05

# Streams of random numbers: the pilot and the picture must use different ones.
_PILOT, _PICTURE = 0, 1
_PATHS = 0x5BD1E995

Array32 = NDArray[np.float32]

# From a sampler and rays: radiance, and for each sheet whether it is hit, and the position (x, y) on it, metres.
Traced = tuple[Any, list[tuple[Any, Any, Any]]]
Tracer = Callable[[Any, Any], Traced]
# A part, and the index of its sheet.
Placed = tuple[int, Part]


@dataclass(frozen=True)
class _Shot:
    """A frame, ready for tracing."""

    dr: Any
    mi: Any
    frame: Frame
    optics: Optics
    tracer: Tracer


@dataclass(frozen=True)
class Radiance:
    """Linear radiance of a frame, each array (H, W) float32.

    `variance` is of the Monte-Carlo estimate `mean`; `coverage[marker_id]` is the fraction of the pixel in which the
    marker's print is seen; `depth_m` is that of `roundel.render.depth`, None if the study keeps none.
    """

    mean: Array32
    variance: Array32
    coverage: dict[int, Array32]
    depth_m: Array32 | None = None


def render_radiance(mi: Any, frame: Frame) -> Radiance:
    """Render a frame, each pixel with as many rays as its target error needs."""
    import drjit as dr

    tracer, distance = _tracers(dr, mi, frame)
    shot = _Shot(dr, mi, frame, optics_of(dr, mi, frame), tracer)
    depth = depth_plane(dr, mi, frame, shot.optics, distance) if frame.settings.render.keeps_depth else None
    parts = tuple((i, part) for i, view in enumerate(frame.views()) for part in view.sheet.parts)

    def estimate(pixels: NDArray[np.int64], samples: int, purpose: int, what: tuple[Placed, ...] = parts) -> Array32:
        # Each sample count has its own stream of random numbers.
        seed = (frame.ray_seed ^ (0x9E3779B9 * (2 * samples + purpose))) & 0xFFFFFFFF
        return _estimate(shot, pixels, samples, seed, what)

    plan = sample_map(frame)
    samples = counts_of(frame, plan, lambda pixels, count: estimate(pixels, count, _PILOT, ())[:2])
    fewest = frame.settings.render.samples
    if frame.surroundings is not None:
        planes = _in_groups(samples, lambda pixels, count: estimate(pixels, count, _PICTURE))
        # Waves have another size each time: Dr.Jit would keep memory for all of them.
        dr.flush_malloc_cache()
        return _shaped(frame, parts, planes, depth)
    special = np.flatnonzero(samples != fewest)
    # Rendering a few extra pixels costs less than selecting all others.
    everywhere = len(special) < _FEW * len(samples)
    pixels = np.arange(len(samples)) if everywhere else np.flatnonzero(samples == fewest)
    planes = estimate(pixels, fewest, _PICTURE)
    if not everywhere:
        some, planes = planes, np.zeros((2 + len(parts), len(samples)), dtype=np.float32)
        planes[:, pixels] = some
    for count in np.unique(samples[special]):
        pixels = special[samples[special] == count]
        planes[:, pixels] = estimate(pixels, int(count), _PICTURE)
    return _shaped(frame, parts, planes, depth)


def _in_groups(samples: NDArray[np.int64], estimate: Callable[[NDArray[np.int64], int], Array32]) -> Array32:
    """Estimates of all pixels of a world: fewer than 64 rays as several independent estimates of 4 rays each.

    A launch in a world takes a tenth of a second beside its rays: all small counts share one, and its kernel.
    """
    few = samples < STRATIFIED
    pixels, repeats = np.flatnonzero(few), samples[few] // GROUP
    some = estimate(np.repeat(pixels, repeats), GROUP)
    planes = np.zeros((len(some), len(samples)), dtype=np.float32)
    if len(pixels):
        planes[:, pixels] = np.add.reduceat(some, np.cumsum(repeats) - repeats, axis=1) / repeats
        # The variance of a mean of independent estimates.
        planes[1, pixels] /= repeats
    for count in np.unique(samples[~few]):
        pixels = np.flatnonzero(samples == count)
        planes[:, pixels] = estimate(pixels, int(count))
    return planes


def _shaped(frame: Frame, parts: tuple[Placed, ...], planes: Array32, depth: Array32 | None) -> Radiance:
    shaped = planes.reshape(len(planes), frame.camera.height_px, frame.camera.width_px)
    coverage = {part.marker_id: shaped[2 + i] for i, (_, part) in enumerate(parts)}
    return Radiance(shaped[0], shaped[1], coverage, depth)


def _tracers(dr: Any, mi: Any, frame: Frame) -> tuple[Tracer, Distance]:
    if is_plain(frame):
        plain = plain_scene(dr, mi, frame)
        return lambda sampler, ray: trace(dr, mi, plain, sampler, ray), lambda ray: distance_to_plane(dr, plain, ray)
    built = build_scene(mi, frame)
    return lambda sampler, ray: trace_built(built, sampler, ray), lambda ray: distance_to_surface(built, ray)


def _multijitter_count(samples: int) -> int:
    """The next count with two similar factors, as multi-jittering needs (1024 / 8 = 128 becomes 132)."""
    side = math.isqrt(samples)
    return side * math.ceil(samples / side)


def _estimate(shot: _Shot, pixels: NDArray[np.int64], samples: int, seed: int, parts: tuple[Placed, ...]) -> Array32:
    """Estimates (2 + parts, n) for n pixels: mean, variance, coverage of each part."""
    replicates = min(REPLICATES, samples)
    per_replicate = _multijitter_count(samples // replicates)
    per_chunk = max(1, _CHUNK // (per_replicate * replicates))
    out = []
    for i, start in enumerate(range(0, len(pixels), per_chunk)):
        chunk = pixels[start : start + per_chunk]
        out.append(_chunk(shot, chunk, (replicates, per_replicate), (seed + i) & 0xFFFFFFFF, parts))
    if len(out) == 1:
        return out[0]
    return np.concatenate(out, axis=1) if out else np.zeros((2 + len(parts), 0), dtype=np.float32)


def _chunk(
    shot: _Shot, pixels: NDArray[np.int64], counts: tuple[int, int], seed: int, parts: tuple[Placed, ...]
) -> Array32:
    """Estimates from so many replicates of so many rays each."""
    dr, mi, frame = shot.dr, shot.mi, shot.frame
    replicates, per_replicate = counts
    samples = per_replicate * replicates
    rays = len(pixels) * samples
    # A single sample cannot be stratified.
    kind = "multijitter" if per_replicate > 1 else "independent"
    sampler = mi.load_dict({"type": kind, "sample_count": per_replicate})
    sampler.set_samples_per_wavefront(per_replicate)
    sampler.seed(dr.opaque(mi.UInt32, seed), rays)

    entry = dr.arange(mi.UInt32, rays) // dr.opaque(mi.UInt32, samples)
    index = dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), entry)
    width = dr.opaque(mi.UInt32, frame.camera.width_px)
    row = index // width
    column = index - row * width
    ray, weight = shoot(dr, mi, shot.optics, column, row, sampler)
    radiance, sheets = shot.tracer(_path_sampler(shot, sampler, seed, rays), ray)
    quantities = [_through_filter(dr, mi, frame, radiance, column, row) * weight]
    for which, part in parts:
        on_sheet, x_m, y_m = sheets[which]
        quantities.append(mi.Float(_covers(dr, mi, part, x_m, y_m) & on_sheet))
    # Evaluated together; otherwise each sum would trace all rays again.
    dr.eval(quantities)
    mean, *others = (dr.block_sum(q, samples) / samples for q in quantities)
    scatter = dr.block_sum(quantities[0], per_replicate) / per_replicate - dr.repeat(mean, replicates)
    variance = dr.block_sum(dr.square(scatter), replicates) / (replicates * (replicates - 1))
    return np.stack([np.array(plane, dtype=np.float32) for plane in (mean, variance, *others)])


def _path_sampler(shot: _Shot, sampler: Any, seed: int, rays: int) -> Any:
    """The random numbers of a ray's further way: stratified ones in a plain frame.

    A path in a world takes dozens, whose stratification costs more time than it saves noise (measured).
    """
    if shot.frame.surroundings is None:
        return sampler
    plain = shot.mi.load_dict({"type": "independent", "sample_count": 1})
    plain.seed(shot.dr.opaque(shot.mi.UInt32, seed ^ _PATHS), rays)
    return plain


def _through_filter(dr: Any, mi: Any, frame: Frame, radiance: Any, column: Any, row: Any) -> Any:
    """The radiance that passes a pixel's own colour filter."""
    mosaic = frame.settings.sensor.mosaic
    if len(radiance) == 1:
        return radiance[0]
    if mosaic == "none":
        return mi.luminance(radiance)
    colour = colour_index(mi, dr, mi.UInt32(filters_of(mosaic)), column, row)
    return dr.select(colour == 0, radiance[0], dr.select(colour == 1, radiance[1], radiance[2]))


def _covers(dr: Any, mi: Any, part: Part, x_m: Any, y_m: Any) -> Any:
    """Whether points of the sheet's plane are on a part's print."""
    x, y = x_m - dr.opaque(mi.Float, part.x_m), y_m - dr.opaque(mi.Float, part.y_m)
    half_w, half_h = (dr.opaque(mi.Float, v) for v in part.half_size_m())
    if part.radius_m is not None:
        return x * x + y * y < half_w * half_w
    return (dr.abs(x) < half_w) & (dr.abs(y) < half_h)
