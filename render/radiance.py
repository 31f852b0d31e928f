"""A frame to linear radiance: our own rays, Mitsuba's light transport, mean and variance a pixel.

Each pixel is estimated by 8 independently stratified replicates. Their scatter is the variance of the estimate; the
scatter of single stratified samples would overstate it (five times at an edge).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.samples import sample_map
from roundel.render.scene import build_scene
from roundel.scenes.frame import Frame

REPLICATES = 8

# Rays in flight at once: some 50 MB a million.
_CHUNK = 4_000_000

Array32 = NDArray[np.float32]


@dataclass(frozen=True)
class Radiance:
    """Linear radiance of a frame, each array (H, W) float32.

    `variance` is of the Monte-Carlo estimate `mean`; `depth_m` is Z (not the distance along the ray), 0 where nothing
    is hit; `coverage[marker_id]` is the fraction of the pixel that the marker's print covers.
    """

    mean: Array32
    variance: Array32
    depth_m: Array32
    coverage: dict[int, Array32]


def render_radiance(mi: Any, frame: Frame) -> Radiance:
    """Render a frame: the bands of the edges with many samples a pixel, what is left with few."""
    built = build_scene(mi, frame)
    height, width = frame.camera.height_px, frame.camera.width_px
    samples = sample_map(frame).ravel()
    planes = np.zeros((3 + len(frame.sheet.parts), height * width), dtype=np.float32)
    for i, count in enumerate(np.unique(samples)):
        pixels = np.flatnonzero(samples == count)
        # Each kind of pixel has a stream of random numbers of its own.
        seed = (frame.ray_seed ^ (0x9E3779B9 * i)) & 0xFFFFFFFF
        planes[:, pixels] = _trace(mi, frame, built, pixels, int(count), seed)
    shaped = planes.reshape(len(planes), height, width)
    coverage = {part.marker_id: shaped[3 + i] for i, part in enumerate(frame.sheet.parts)}
    return Radiance(shaped[0], shaped[1], shaped[2], coverage)


def _trace(
    mi: Any, frame: Frame, built: tuple[Any, Any, Any], pixels: NDArray[np.int64], samples: int, seed: int
) -> Array32:
    """Estimates (3 + parts, n) for n pixels: mean, variance, depth, coverage of each part."""
    per_chunk = max(1, _CHUNK // samples)
    chunks = [pixels[i : i + per_chunk] for i in range(0, len(pixels), per_chunk)]
    out = [_trace_chunk(mi, frame, built, chunk, samples, (seed + i) & 0xFFFFFFFF) for i, chunk in enumerate(chunks)]
    return np.concatenate(out, axis=1)


def _multijitter_count(samples: int) -> int:
    """The next count that is a grid of two near factors, as multi-jittering needs (1024 / 8 = 128 becomes 132)."""
    side = math.isqrt(samples)
    return side * math.ceil(samples / side)


def _trace_chunk(
    mi: Any, frame: Frame, built: tuple[Any, Any, Any], pixels: NDArray[np.int64], samples: int, seed: int
) -> Array32:
    import drjit as dr

    scene, integrator, sensor = built
    per_replicate = _multijitter_count(samples // REPLICATES)
    samples = per_replicate * REPLICATES
    rays = len(pixels) * samples
    sampler = mi.load_dict({"type": "multijitter", "sample_count": per_replicate})
    sampler.set_samples_per_wavefront(per_replicate)
    sampler.seed(dr.opaque(mi.UInt32, seed), rays)

    entry = dr.arange(mi.UInt32, rays) // samples
    index = dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), entry)
    width = dr.opaque(mi.UInt32, frame.camera.width_px)
    row = index // width
    column = index - row * width
    jitter = sampler.next_2d()
    aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    # A pixel reaches half a pixel to each side of its centre, which stands at whole numbers.
    ray = mi.RayDifferential3f(
        sensor.rays(mi.Float(column) + (jitter.x - 0.5), mi.Float(row) + (jitter.y - 0.5), mi.Float(0.0), aperture)
    )
    value, _, _ = integrator.sample(scene, sampler, ray)
    hit = scene.ray_intersect(ray)
    on_plane = hit.is_valid()
    quantities = [value[0], dr.select(on_plane, hit.p.z, 0.0)]
    quantities += [mi.Float(_covers(dr, mi, frame, part, hit) & on_plane) for part in frame.sheet.parts]
    # Evaluated together: left to itself each sum would trace all the rays again.
    dr.eval(quantities)
    mean, *others = (dr.block_sum(q, samples) / samples for q in quantities)
    scatter = dr.block_sum(quantities[0], per_replicate) / per_replicate - dr.repeat(mean, REPLICATES)
    variance = dr.block_sum(dr.square(scatter), REPLICATES) / (REPLICATES * (REPLICATES - 1))
    return np.stack([np.array(plane, dtype=np.float32) for plane in (mean, variance, *others)])


def _covers(dr: Any, mi: Any, frame: Frame, part: Any, hit: Any) -> Any:
    """Whether a hit point lies within a part's print."""
    pose = frame.camera_from_part(part)
    x_axis, y_axis, origin = ([dr.opaque(mi.Float, float(v)) for v in pose[:3, i]] for i in (0, 1, 3))
    d = [hit.p.x - origin[0], hit.p.y - origin[1], hit.p.z - origin[2]]
    x = d[0] * x_axis[0] + d[1] * x_axis[1] + d[2] * x_axis[2]
    y = d[0] * y_axis[0] + d[1] * y_axis[1] + d[2] * y_axis[2]
    half_w, half_h = (dr.opaque(mi.Float, v) for v in part.half_size_m())
    if part.radius_m is not None:
        return x * x + y * y < half_w * half_w
    return (dr.abs(x) < half_w) & (dr.abs(y) < half_h)
