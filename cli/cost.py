"""Cost of a study before rendering: frames, time, disk, as orders of magnitude."""

from __future__ import annotations

from collections.abc import Callable

from roundel.scenes.study.sampling import cells_of
from roundel.scenes.study.study import Study
from roundel.scenes.world.frame import Frame, frame_of, frames_of, group_ranges, total_frames

# On two cores: rays in closed form, rays by Mitsuba's integrators, encoding and measuring a frame (benchmarks/).
_PLAIN_RAYS_A_SECOND = 17e6
_RAYS_A_SECOND = 4e6
# Paths in a world, and how many a pixel takes there on average at the default background error.
_PATHS_A_SECOND = 1.3e6
_PATHS_A_PIXEL = 12
_SECONDS_A_FRAME = 0.4

# Average rays per pixel of the edge band, pilot included; the real number depends on the pilot, which is not run here.
_RAYS_A_BAND_PIXEL = 200
_PNG_BYTES_A_PIXEL = 0.6
_EXR_BYTES_A_PIXEL = 4.0
_MASKS_BYTES_A_PIXEL = 1.2


def _images_of(study: Study) -> dict[str, int]:
    return {n: len(ids) for n, ids in group_ranges(study).items() if study.groups[n].mode == "images"}


def disk_bytes(study: Study) -> float:
    """Approximate bytes on disk."""
    total = 0.0
    for name, count in _images_of(study).items():
        group = study.groups[name]
        sensor = group.sensor
        numbers = 3 if sensor.mosaic != "none" and sensor.deliver == "colour" else 1
        pixel = _PNG_BYTES_A_PIXEL * numbers * (1 if sensor.bits == 8 else 2)
        if group.render.keeps_depth:
            pixel += _EXR_BYTES_A_PIXEL if group.render.radiance else _MASKS_BYTES_A_PIXEL
        total += count * group.camera.width_px * group.camera.height_px * pixel
    return total


def _rays(frame: Frame) -> float:
    """Approximate number of rays of a frame."""
    from roundel.render.rays.sample_allocation import sample_map

    plan, render = sample_map(frame), frame.settings.render
    band = int(plan.edge.sum()) * (_RAYS_A_BAND_PIXEL if render.target_error else render.band_samples)
    smooth = max(render.samples, _PATHS_A_PIXEL) if frame.surroundings is not None else render.samples
    return float(plan.edge.size * smooth + band)


def _rays_a_second(frame: Frame) -> float:
    from roundel.render.scene.transport import is_plain

    if frame.surroundings is not None:
        return _PATHS_A_SECOND
    return _PLAIN_RAYS_A_SECOND if is_plain(frame) else _RAYS_A_SECOND


def cost_of(study: Study, progress: Callable[[int, int], None] | None = None) -> list[str]:
    """Lines with frames, time and disk space; samples every frame, so that invalid ones are found early."""
    lines = []
    seconds = 0.0
    ranges = group_ranges(study)
    total = total_frames(study)
    for done, _ in enumerate(frames_of(study), start=1):
        if progress:
            progress(done, total)
    for name, ids in ranges.items():
        group = study.groups[name]
        text = f"group {name}: {len(ids)} frames"
        if cells_of(group) > 1:
            text += f" in {cells_of(group)} cells"
        if group.sweep:
            text += f", {len(group.sweep.levels)} levels of {group.sweep.key}"
        if group.mode == "images":
            # A few evenly spaced frames represent all.
            some = sorted({ids[i * (len(ids) - 1) // 4] for i in range(5)})
            frames = [frame_of(study, i) for i in some]
            rays = [_rays(frame) for frame in frames]
            speeds = [_rays_a_second(frame) for frame in frames]
            tracing = sum(n / speed for n, speed in zip(rays, speeds, strict=True)) / len(some)
            seconds += len(ids) * (tracing + _SECONDS_A_FRAME)
            text += f", some {sum(rays) / len(some) / 1e6:.1f} million rays each"
        else:
            text += ", points only"
        lines.append(text)
    lines.append(
        f"about {seconds / 60:.1f} minutes of rendering on two cores, {disk_bytes(study) / 1e9:.2f} GB on disk"
    )
    return lines
