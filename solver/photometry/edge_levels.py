"""Levels along a contour, apart from any fit: both sides of the edge, and whether the edge overshoots them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.contour_pixels import sector_centres
from roundel.solver.kernels.order_statistics import median

Array = NDArray[np.float64]

_FAR_PX = (4.0, 8.0)  # a sharpening filter's ringing has ended here
_STEP_PX = 0.5
_BLURS = 1.5  # the ringing is beyond this much of the blur
_OVERSHOOT = 0.03  # fraction of the contrast; a blur's edge response never overshoots
_UNDERSHOOT = 0.01  # the darker side's ringing is compressed in linear light
_SIGMAS = 5.0
_FEWEST, _MOST = 24, 64  # sectors
_SATURATED = 254.5 / 255.0  # fraction of the full scale


def side_levels(grey: NDArray[np.float32], edges: EdgePoints) -> tuple[float, float]:
    """Median levels inside and outside a contour, where its edge has ended."""
    inside, outside = _side_levels(grey, edges.ellipse, edges.trusted, *edges.reach_px)
    return (inside, outside) if math.isfinite(inside + outside) else (0.0, edges.contrast_dn)


def clipped_fraction(grey: NDArray[np.float32], edges: EdgePoints, saturation_dn: float) -> float:
    """Fraction of the pixels of a contour's edge, without its plateaus, that are clipped at the top of the range."""
    reach = 2.0 * math.sqrt(edges.blur_px**2 + PIXEL_VARIANCE) + 0.5
    return _clipped_fraction(grey, edges.ellipse, edges.trusted, reach, saturation_dn * _SATURATED)


def overshoots(grey: NDArray[np.float32], edges: EdgePoints) -> bool:
    """Whether the edge overshoots its levels on both sides, as sharpening makes it.

    The mean profile across the contour is compared with its own level farther out.
    """
    sigma = math.sqrt(edges.blur_px**2 + PIXEL_VARIANCE)
    first, last = _BLURS * sigma, min(4.0 * sigma + 1.0, _FAR_PX[0])
    relative = [
        _overshoot(grey, edges.ellipse, edges.trusted, side, edges.contrast_dn, first, last) for side in (-1.0, 1.0)
    ]
    highest, lowest = max(relative), min(relative)
    return all(value > _SIGMAS * error for value, error in relative) and (
        highest[0] > _OVERSHOOT and lowest[0] > _UNDERSHOOT
    )


@compiled
def _along(grey: NDArray[np.float32], ellipse: Array, trusted: NDArray[np.bool_], offsets: Array) -> Array:
    """Nearest pixels (sectors, offsets) at distances from the trusted part of a contour; NaN outside the image.

    Of a long contour every second sector, or fewer.
    """
    feet, normals, _ = sector_centres(ellipse, len(trusted))
    total = 0
    for s in range(len(trusted)):
        total += trusted[s]
    every = max(1, total // _MOST)
    values = np.empty(((total + every - 1) // every, len(offsets)))
    row, seen = 0, 0
    for s in range(len(trusted)):
        if not trusted[s]:
            continue
        if seen % every == 0:
            for k in range(len(offsets)):
                x = round(feet[s, 0] + normals[s, 0] * offsets[k])
                y = round(feet[s, 1] + normals[s, 1] * offsets[k])
                inside = 0 <= x < grey.shape[1] and 0 <= y < grey.shape[0]
                values[row, k] = grey[y, x] if inside else math.nan
            row += 1
        seen += 1
    return values


@compiled
def _side_levels(
    grey: NDArray[np.float32], ellipse: Array, trusted: NDArray[np.bool_], inner: float, outer: float
) -> tuple[float, float]:
    offsets, middles = np.empty(2), np.empty(2)
    offsets[0], offsets[1] = inner, outer
    values = _along(grey, ellipse, trusted, offsets)
    known = np.empty(len(values))
    for side in range(2):
        n = 0
        for i in range(len(values)):
            if math.isfinite(values[i, side]):
                known[n] = values[i, side]
                n += 1
        middles[side] = median(known[:n]) if n else math.nan
    return middles[0], middles[1]


@compiled
def _clipped_fraction(
    grey: NDArray[np.float32], ellipse: Array, trusted: NDArray[np.bool_], reach: float, level: float
) -> float:
    offsets = np.empty(int(2.0 * reach) + 1)
    for k in range(len(offsets)):
        offsets[k] = k - reach
    values = _along(grey, ellipse, trusted, offsets)
    known, clipped = 0, 0
    for i in range(len(values)):
        for k in range(len(offsets)):
            known += math.isfinite(values[i, k])
            clipped += values[i, k] >= level
    return clipped / max(known, 1)


@compiled
def _overshoot(
    grey: NDArray[np.float32],
    ellipse: Array,
    trusted: NDArray[np.bool_],
    side: float,
    contrast_dn: float,
    first: float,
    last: float,
) -> tuple[float, float]:
    """Highest excess of the mean profile between two distances over its level farther out, in contrasts, and its error.

    Zero if too few sectors are in the image.
    """
    near, far = max(math.ceil((last - first) / _STEP_PX), 0), int((_FAR_PX[1] - _FAR_PX[0]) / _STEP_PX) + 1
    offsets = np.empty(near + far)
    for k in range(near):
        offsets[k] = side * (first + k * _STEP_PX)
    for k in range(far):
        offsets[near + k] = side * (_FAR_PX[0] + k * _STEP_PX)
    values = _along(grey, ellipse, trusted, offsets)
    rows = 0
    sums, squares = np.zeros(near), np.zeros(near)
    for i in range(len(values)):
        level = 0.0
        for k in range(far):
            level += values[i, near + k] / far
        whole = math.isfinite(level)
        for k in range(near):
            whole = whole and math.isfinite(values[i, k])
        if whole:
            rows += 1
            for k in range(near):
                excess = side * (values[i, k] - level) / contrast_dn
                sums[k], squares[k] = sums[k] + excess, squares[k] + excess * excess
    best, error = 0.0, 0.0
    if rows >= _FEWEST:
        for k in range(near):
            mean = sums[k] / rows
            if k == 0 or mean > best:
                best, error = mean, math.sqrt(max(squares[k] / rows - mean * mean, 0.0) / rows)
    return best, error
