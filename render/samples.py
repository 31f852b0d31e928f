"""Which pixels get how many rays: few where the image is smooth, many where it has structure.

Where the print's edges are imaged is known in closed form. How many rays a pixel there needs, a pilot of few rays
tells: its variance, smoothed over neighbours, against the target error. Pilots are thrown away: a count that was
decided by the very rays it counts would bias the mean.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, uniform_filter

from roundel.render.transport import is_plain
from roundel.scenes.airy import REACH, spread_px
from roundel.scenes.camera import project
from roundel.scenes.frame import Frame
from roundel.scenes.marker import is_smooth
from roundel.scenes.motion import pose_at
from roundel.scenes.outlines import edge_reach_m, outlines
from roundel.scenes.truth import defocus_radius_px

# Points along an edge stand this close, so that no pixel it crosses is left out.
_STEP_PX = 0.4

# Poses an edge is drawn at while it moves less than this from one to the next.
_MOTION_STEP_PX = 0.5
_MOST_POSES = 257

PILOT_SAMPLES = 64
_LATTICE = 2
_LATTICE_SAMPLES = 8

# The border of the sheet is no marker, and a smooth area no edge: they may err this much more.
_BORDER_FACTOR, _SMOOTH_FACTOR = 4.0, 2.0
_MOST_SMOOTH = 128

# Of the Airy pattern's light 5 % falls beyond this x: the pilot of the whole frame sees to the rest.
_AIRY_CORE = 12.7

# Counts are rounded up to these.
_TIERS = np.array(sorted({8 * m * 2**k for k in range(14) for m in (1, 1.5) if 8 * m * 2**k % 8 == 0}), dtype=np.int64)

Estimate = Callable[[NDArray[np.int64], int], NDArray[np.float32]]


@dataclass(frozen=True)
class SampleMap:
    """Masks (H, W): pixels near the print's edges, and near the border of the sheet."""

    edge: NDArray[np.bool_]
    border: NDArray[np.bool_]


def _dense(lines: list[NDArray[np.float64]], frame: Frame) -> NDArray[np.float64]:
    """Polylines of the sheet, densified so that their image has a point every `_STEP_PX`, as points of the sheet."""
    pose = frame.camera_from_sheet
    a, b = np.concatenate([line[:-1] for line in lines]), np.concatenate([line[1:] for line in lines])
    nearest = np.minimum(a @ pose[2, :2], b @ pose[2, :2]) + pose[2, 3]
    length_px = np.linalg.norm(b - a, axis=1) * frame.camera.K[0, 0] / np.maximum(nearest, 1e-3)
    steps = np.clip(np.ceil(length_px / _STEP_PX), 1, 20_000).astype(np.int64)
    # All stretches at once, as a board of tags has thousands: number of the stretch, and of the step within it.
    which = np.repeat(np.arange(len(a)), steps)
    step = np.arange(len(which)) - np.repeat(np.cumsum(steps) - steps, steps)
    flat = a[which] + (step / steps[which])[:, None] * (b - a)[which]
    return np.column_stack([flat, np.zeros(len(flat))])


def _exposed(frame: Frame, points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Image positions of sheet points through the exposure, and how far they move from one to the next, in pixels."""
    camera, motion, pose = frame.camera, frame.motion, frame.camera_from_sheet

    def image(time_s: float) -> NDArray[np.float64]:
        at = pose_at(motion, pose, np.array(time_s))
        return project(camera, points_m @ at[:3, :3].T + at[:3, 3])

    if not motion.moves:
        return image(0.0), 0.0
    half = motion.exposure_s / 2
    first, last = motion.row_time_s([0.0, camera.height_px - 1.0])
    begin, end = first - half, last + half
    tick = max(end - begin, 1e-9) * 1e-3
    moved = np.linalg.norm(image(tick) - image(-tick), axis=1)
    speed = float(np.nanmax(moved, initial=0.0)) / (2 * tick)
    count = int(np.clip(np.ceil((end - begin) * speed / _MOTION_STEP_PX) + 1, 2, _MOST_POSES))
    seen = []
    for time in np.linspace(begin, end, count):
        px = image(float(time))
        # Only rows whose shutter is open just then; one step more, for what lies between two poses.
        open_now = np.abs(time - motion.row_time_s(px[:, 1])) <= half + (end - begin) / (count - 1)
        seen.append(px[open_now])
    return np.concatenate(seen), speed * (end - begin) / (count - 1)


def _band(frame: Frame, lines: list[NDArray[np.float64]]) -> NDArray[np.bool_]:
    """Mask (H, W) of the pixels near some edges of the print: dilated by blur, motion and diffraction."""
    camera = frame.camera
    mask = np.zeros((camera.height_px, camera.width_px), dtype=bool)
    pose = frame.camera_from_sheet
    depths, step = [float(pose[2, 3])], 0.0
    dense = _dense(lines, frame)
    depth = dense @ pose[2, :3] + pose[2, 3]
    if np.any(depth > 1e-6):
        depths += [float(depth.max()), float(depth[depth > 1e-6].min())]
        px, step = _exposed(frame, dense[depth > 1e-6])
        # Far outside the image a pixel's number may not fit an integer; it is not needed.
        px = px[np.isfinite(px).all(axis=1) & (np.abs(px) < 1e6).all(axis=1)]
        columns, rows = np.rint(px).astype(np.int64).T
        seen = (columns >= 0) & (columns < camera.width_px) & (rows >= 0) & (rows < camera.height_px)
        mask[rows[seen], columns[seen]] = True
    blur = max(defocus_radius_px(camera, depth) for depth in depths)
    soft = edge_reach_m(frame.sheet) * camera.K[0, 0] / max(min(depths), 1e-3)
    rings = spread_px(camera)[1] * _AIRY_CORE / REACH
    return _dilated(mask, int(np.ceil(frame.settings.render.band_px + blur + soft + rings + step / 2 - 1e-9)))


def _window(mask: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
    """The rows and columns that hold all of a mask, and a margin: markers are small, frames are large."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return slice(0, 0), slice(0, 0)
    return (
        slice(max(rows[0] - margin, 0), rows[-1] + margin + 1),
        slice(max(columns[0] - margin, 0), columns[-1] + margin + 1),
    )


def _dilated(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """A mask widened by a square of `reach` pixels to each side."""
    window = _window(mask, reach)
    mask[window] = maximum_filter(mask[window], 2 * reach + 1) if mask[window].size else False
    return mask


def sample_map(frame: Frame) -> SampleMap:
    """Where a frame's edges are imaged."""
    border, *edges = outlines(frame.sheet)
    edge = _band(frame, edges)
    return SampleMap(edge, _band(frame, [border]) & ~edge)


def _has_structure(frame: Frame) -> bool:
    """Whether a frame may vary, or be noisy, where no edge of the print is: then the pilot looks everywhere."""
    rough = not is_smooth(frame.sheet)
    barrel = np.isfinite(frame.camera.barrel_radius_m)
    return rough or barrel or not is_plain(frame) or spread_px(frame.camera)[1] > frame.settings.render.band_px


def _tier(samples: NDArray[np.float64]) -> NDArray[np.int64]:
    """Counts rounded up to the next tier."""
    return np.asarray(_TIERS[np.minimum(np.searchsorted(_TIERS, samples), len(_TIERS) - 1)], dtype=np.int64)


def counts_of(frame: Frame, plan: SampleMap, estimate: Estimate) -> NDArray[np.int64]:
    """Rays a pixel, (H * W,).

    Parameters
    ----------
    frame : Frame
    plan : SampleMap
    estimate : callable
        From pixels (n,) and a count of samples: the pilot's means and variances (2, n).
    """
    render, camera = frame.settings.render, frame.camera
    shape = camera.height_px, camera.width_px
    most = render.band_samples
    counts = np.full(shape, render.samples, dtype=np.int64)
    if render.target_error == 0:
        counts[plan.border] = max(render.samples, most // 16)
        counts[plan.edge] = max(render.samples, most)
        return counts.ravel()
    near = plan.edge | plan.border
    pixels = np.flatnonzero(near)
    if len(pixels) == 0 and not _has_structure(frame):
        return counts.ravel()
    window = _window(near, 1)
    inside = near[window]
    pilot = np.zeros((2, *inside.shape))
    pilot[:, inside] = estimate(pixels, PILOT_SAMPLES)
    white = float(np.quantile(pilot[0][inside], 0.98)) if len(pixels) else 0.0
    target2 = (render.target_error * white) ** 2
    if target2 > 0:
        # A variance from 8 replicates is a rough one; its neighbours on the edge, those that vary at all, steady it.
        varies = uniform_filter((pilot[1] > 0).astype(np.float64), 3)
        steady = np.maximum(pilot[1], uniform_filter(pilot[1], 3) / np.maximum(varies, 1 / 9))
        # Stratified over the pixel alone, an edge's variance falls with the power 3/2; over more dimensions, with 1.
        rays_are_plain = camera.aperture_radius_m == 0 and not frame.motion.moves
        power = 2 / 3 if rays_are_plain else 1.0
        for mask, factor in ((plan.edge, 1.0), (plan.border, _BORDER_FACTOR)):
            wanted = PILOT_SAMPLES * (steady[mask[window]] / (target2 * factor**2)) ** power
            counts[mask] = np.clip(
                _tier(wanted), max(render.samples, min(PILOT_SAMPLES, most)), max(render.samples, most)
            )
        if _has_structure(frame):
            elsewhere = _elsewhere(frame, estimate, target2)
            counts = np.where(near, counts, np.maximum(counts, elsewhere))
    return counts.ravel()


def _elsewhere(frame: Frame, estimate: Estimate, target2: float) -> NDArray[np.int64]:
    """Counts (H, W) from a thin pilot of the whole frame: shadows, highlights, clutter, the noise of a map."""
    height, width = frame.camera.height_px, frame.camera.width_px
    rows, columns = np.arange(0, height, _LATTICE), np.arange(0, width, _LATTICE)
    pixels = (rows[:, None] * width + columns).ravel()
    _, variances = estimate(pixels, _LATTICE_SAMPLES).reshape(2, len(rows), len(columns)).astype(np.float64)
    # One sample a replicate: smoothed over 5 x 5 of the lattice, then spread, so that no edge falls between two pilots.
    variance = maximum_filter(uniform_filter(variances, 3), 3)
    wanted = _LATTICE_SAMPLES * variance / (target2 * _SMOOTH_FACTOR**2)
    counts = np.minimum(_tier(wanted), max(_MOST_SMOOTH, frame.settings.render.samples))
    return np.repeat(np.repeat(counts, _LATTICE, axis=0), _LATTICE, axis=1)[:height, :width]
