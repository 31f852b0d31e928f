"""Samples per pixel: few where the image is smooth, many where it has structure.

The images of the print's edges are known in closed form. A pilot of few rays determines how many rays a pixel there
needs: its variance, smoothed over neighbours, is compared with the target error. Pilots are discarded: reusing rays
that determined the sample count would bias the mean.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, uniform_filter

from roundel.datasets.layout.radiance import REPLICATES
from roundel.render.rays.sample_allocation import SampleMap, window_of
from roundel.render.scene.transport import is_plain
from roundel.scenes.camera.airy import spread_px
from roundel.scenes.markers.marker import is_smooth
from roundel.scenes.world.frame import Frame

PILOT_SAMPLES = 64
_LATTICE = 2
# A world is noisy everywhere and alike over neighbours; its pilot is as dear as its picture.
_WORLD_LATTICE = 5
_LATTICE_SAMPLES = 8

# Factors on the error allowed at the border of the sheet and in smooth areas, which are not marker edges.
_BORDER_FACTOR, _SMOOTH_FACTOR = 4.0, 2.0
_MOST_SMOOTH, _WORLD_MOST = 128, 64

# Counts are rounded up to 8, 16, 24, 32, 48, 64, 96 and so on, all with 8 replicates.
_TIERS = 8 * np.unique([1] + [m * 2**k for k in range(13) for m in (2, 3)])
# In a world every count is a launch of several kernels: multiples of 4 below 64, which share one, and powers of two.
GROUP, STRATIFIED = 4, 64
_WORLD_TIERS = np.concatenate([np.arange(GROUP, STRATIFIED, GROUP), STRATIFIED * 2 ** np.arange(11)])

Estimate = Callable[[NDArray[np.int64], int], NDArray[np.float32]]


def _has_structure(frame: Frame) -> bool:
    """Whether a frame may vary or be noisy away from the print's edges; the pilot then covers the whole frame."""
    rough = not is_smooth(frame.sheet) or frame.settings.marker.surface.kind != "matte"
    barrel = np.isfinite(frame.camera.barrel_radius_m)
    return rough or barrel or not is_plain(frame) or spread_px(frame.camera)[1] > frame.settings.render.band_px


def _tier(samples: NDArray[np.float64], tiers: NDArray[np.int64] = _TIERS) -> NDArray[np.int64]:
    """Counts rounded up to the next tier."""
    return np.asarray(tiers[np.minimum(np.searchsorted(tiers, samples), len(tiers) - 1)], dtype=np.int64)


def counts_of(frame: Frame, plan: SampleMap, estimate: Estimate) -> NDArray[np.int64]:
    """Rays per pixel, (H * W,).

    Parameters
    ----------
    frame : Frame
    plan : SampleMap
    estimate : callable
        Function from pixels (n,) and a sample count to the pilot's means and variances (2, n).
    """
    render, camera = frame.settings.render, frame.camera
    shape = camera.height_px, camera.width_px
    most = render.band_samples
    tiers = _TIERS if frame.surroundings is None else _WORLD_TIERS
    counts = np.full(shape, _fewest(frame), dtype=np.int64)
    if render.target_error == 0:
        counts[plan.border] = max(render.samples, most // 16)
        counts[plan.edge] = max(render.samples, most)
        return counts.ravel()
    near = plan.edge | plan.border
    pixels = np.flatnonzero(near)
    if len(pixels) == 0 and not _has_structure(frame):
        return counts.ravel()
    window = window_of(near, 1)
    inside = near[window]
    pilot = np.zeros((2, *inside.shape))
    pilot[:, inside] = estimate(pixels, PILOT_SAMPLES)
    white = float(np.quantile(pilot[0][inside], 0.98)) if len(pixels) else 0.0
    target2 = (render.target_error * white) ** 2
    if target2 > 0:
        # A variance from 8 replicates is imprecise; smooth it over neighbours on the edge whose variance is not zero.
        varies = uniform_filter((pilot[1] > 0).astype(np.float64), 3)
        steady = np.maximum(pilot[1], uniform_filter(pilot[1], 3) / np.maximum(varies, 1 / 9))
        # Stratified over the pixel alone, an edge's variance falls with power 3/2; over more dimensions, with 1.
        rays_are_plain = camera.aperture_radius_m == 0 and not frame.motion.moves
        power = 2 / 3 if rays_are_plain else 1.0
        for mask, factor in ((plan.edge, 1.0), (plan.border, _BORDER_FACTOR)):
            wanted = PILOT_SAMPLES * (steady[mask[window]] / (target2 * factor**2)) ** power
            counts[mask] = np.clip(
                _tier(wanted, tiers), max(render.samples, min(PILOT_SAMPLES, most)), max(render.samples, most)
            )
        if _has_structure(frame):
            elsewhere = _elsewhere(frame, estimate, _smooth_target(frame) * white, white)
            counts = np.where(near, counts, np.maximum(counts, elsewhere))
    return counts.ravel()


def _fewest(frame: Frame) -> int:
    """Rays of a smooth pixel: `render.samples`; in a world a group, if the study asks for no more than the least."""
    samples = frame.settings.render.samples
    return GROUP if frame.surroundings is not None and samples == REPLICATES else samples


def _smooth_target(frame: Frame) -> float:
    """Standard error wanted away from edges, as a fraction of white."""
    render = frame.settings.render
    if frame.surroundings is not None:
        return float(render.background_error)
    return _SMOOTH_FACTOR * float(render.target_error)


def _elsewhere(frame: Frame, estimate: Estimate, target: float, white: float) -> NDArray[np.int64]:
    """Counts (H, W) from a thin pilot of the whole frame: shadows, highlights, clutter, the noise of a map."""
    height, width = frame.camera.height_px, frame.camera.width_px
    fewest = _fewest(frame)
    step = _WORLD_LATTICE if frame.surroundings is not None else _LATTICE
    rows, columns = np.arange(0, height, step), np.arange(0, width, step)
    pixels = (rows[:, None] * width + columns).ravel()
    means, variances = estimate(pixels, _LATTICE_SAMPLES).reshape(2, len(rows), len(columns)).astype(np.float64)
    # One sample per replicate: smooth over the lattice, then dilate, so that no edge is missed between pilots.
    if frame.surroundings is None:
        variance = maximum_filter(uniform_filter(variances, 3), 3)
        counts = np.minimum(_tier(_LATTICE_SAMPLES * variance / target**2), max(_MOST_SMOOTH, fewest))
    else:
        # Rare bright paths make a variance of eight rays uncertain: it is the mean over 25 of them that is wanted. What
        # is brighter than white may have the same noise relative to its own radiance: a sensor is saturated there.
        bright = np.maximum(uniform_filter(means, 3) / white, 1.0)
        ratio = uniform_filter(variances / (target * bright) ** 2, 5)
        counts = np.minimum(_tier(_LATTICE_SAMPLES * ratio, _WORLD_TIERS), max(_WORLD_MOST, fewest))
    return np.repeat(np.repeat(counts, step, axis=0), step, axis=1)[:height, :width]
