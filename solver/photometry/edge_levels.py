"""Levels along a contour, apart from any fit: both sides of the edge, and whether the edge overshoots them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.kernels.contour_pixels import sector_centres

Array = NDArray[np.float64]

_FAR_PX = (4.0, 8.0)  # a sharpening filter's ringing has ended here
_STEP_PX = 0.5
_BLURS = 1.5  # the ringing is beyond this much of the blur
_OVERSHOOT = 0.03  # fraction of the contrast; a blur's edge response never overshoots
_UNDERSHOOT = 0.01  # the darker side's ringing is compressed in linear light
_SIGMAS = 5.0
_FEWEST, _MOST = 24, 64  # sectors
_SATURATED = 254.5 / 255.0  # fraction of the full scale


def side_levels(grey: NDArray[Any], edges: EdgePoints) -> tuple[float, float]:
    """Median levels inside and outside a contour, where its edge has ended."""
    at = _along(grey, edges, np.array(edges.reach_px)).T
    sides = [side[np.isfinite(side)] for side in at]
    if not all(map(len, sides)):
        return 0.0, edges.contrast_dn
    return float(np.median(sides[0])), float(np.median(sides[1]))


def clipped_fraction(grey: NDArray[Any], edges: EdgePoints, saturation_dn: float) -> float:
    """Fraction of the pixels of a contour's edge, without its plateaus, that are clipped at the top of the range."""
    sigma = math.sqrt(edges.blur_px**2 + PIXEL_VARIANCE)
    reach = 2.0 * sigma + 0.5
    values = _along(grey, edges, np.arange(-reach, reach + 1e-9, 1.0))
    known = np.isfinite(values)
    clipped = values[known] >= saturation_dn * _SATURATED
    return float(np.mean(clipped)) if np.any(known) else 0.0


def overshoots(grey: NDArray[Any], edges: EdgePoints) -> bool:
    """Whether the edge overshoots its levels on both sides, as sharpening makes it.

    The mean profile across the contour is compared with its own level farther out.
    """
    sigma = math.sqrt(edges.blur_px**2 + PIXEL_VARIANCE)
    near = np.arange(_BLURS * sigma, min(4.0 * sigma + 1.0, _FAR_PX[0]), _STEP_PX)
    far = np.arange(_FAR_PX[0], _FAR_PX[1] + 1e-9, _STEP_PX)
    if not len(near):
        return False
    relative = []
    for side in (-1.0, 1.0):
        profile = side * _along(grey, edges, side * np.concatenate([near, far])) / edges.contrast_dn
        close, level = profile[:, : len(near)], profile[:, len(near) :]
        whole = np.isfinite(profile).all(axis=1)
        if np.count_nonzero(whole) < _FEWEST:
            return False
        difference = close[whole] - level[whole].mean(axis=1, keepdims=True)
        mean = difference.mean(axis=0)
        best = int(np.argmax(mean))
        error = float(difference[:, best].std()) / math.sqrt(len(difference))
        relative.append((float(mean[best]), error))
    highest, lowest = max(relative), min(relative)
    return all(value > _SIGMAS * error for value, error in relative) and (
        highest[0] > _OVERSHOOT and lowest[0] > _UNDERSHOOT
    )


def _along(grey: NDArray[Any], edges: EdgePoints, offsets: Array) -> Array:
    """Nearest pixels (sectors, offsets) at distances from the trusted part of a contour; NaN outside the image.

    Of a long contour every second sector, or fewer.
    """
    count = len(edges.trusted)
    feet, normals, _ = sector_centres(edges.ellipse, count)
    trusted = np.flatnonzero(edges.trusted)
    some = trusted[:: max(1, len(trusted) // _MOST)]
    places = feet[some, None] + normals[some, None] * offsets[:, None]
    x, y = np.rint(places).astype(np.int64).transpose(2, 0, 1)
    inside = (x >= 0) & (y >= 0) & (x < grey.shape[1]) & (y < grey.shape[0])
    values = grey[np.where(inside, y, 0), np.where(inside, x, 0)].astype(np.float64)
    return np.where(inside, values, np.nan)
