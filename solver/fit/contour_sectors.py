"""Sectors of a contour where the model does not hold, and errors that neighbouring sectors share.

An occluder, the edge of a shadow, a highlight or touching print moves the edge in a run of neighbouring sectors; they
are found by their offsets from the ellipse and by the residuals of their pixels, and left out. What is left may still
err together along the contour. The ellipse takes up the first harmonics of the direction (0 to 2), so its own errors do
not show; those of the next harmonics do, and such errors change slowly with the order.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_FAR = 4.5  # sigmas of a single sector's offset, or of the mean of a run
_RUNS = (1, 3, 7)  # sectors
_LOUD = 4.0  # mean square of a sector's residuals, in medians of all
_SPREAD = 1  # sectors on either side of a bad one: blur carries the error to them
_FEWEST = 12
_FIRST, _LAST = 3, 8  # harmonics of the direction
_PRIOR = 8.0  # degrees of freedom by which an excess is taken to be none


def deviating_sectors(
    offset: Array, sigma: Array, square: Array, used: NDArray[np.bool_], width: int = _SPREAD
) -> NDArray[np.bool_]:
    """Sectors that do not belong to the ellipse or whose pixels do not match the model.

    Parameters
    ----------
    offset, sigma : (S,) arrays
        Offset of the edge from the ellipse in each sector, in the order of the contour, and its standard deviation, px.
    square : (S,) array
        Mean square of the residuals of each sector's pixels, in any unit.
    used : (S,) array of bool
        Sectors that have an offset.
    width : int
        Neighbours on either side that are left out, too.

    Returns
    -------
    (S,) array of bool
        Empty of True if fewer than 12 sectors, or less than two thirds of them, would be left.
    """
    none = np.zeros(len(offset), bool)
    if np.count_nonzero(used) < _FEWEST:
        return none
    z = np.where(used, offset / np.where(used, sigma, 1.0), 0.0)
    scale = max(1.0, 1.4826 * float(np.median(np.abs(z[used]))))
    bad = none.copy()
    for run in _RUNS:
        total, count = (_around(v, run // 2) for v in (z, used.astype(np.float64)))
        mean = total / np.sqrt(np.maximum(count, 1.0))
        bad |= used & (np.abs(mean) > _FAR * scale)
    bad |= used & (square > _LOUD * float(np.median(square[used])))
    if not np.any(bad):
        return none
    bad = _around(bad.astype(np.float64), width) > 0
    left = np.count_nonzero(used & ~bad)
    return used & bad if left >= max(_FEWEST, 0.4 * np.count_nonzero(used)) else none


def shared_excess(offset: Array, sigma: Array, direction: Array, shape: Array) -> float:
    """Variance of the errors that change slowly along the contour, in units of independent ones; at least 1.

    Parameters
    ----------
    offset, sigma : (S,) arrays
        Of the used sectors, px.
    direction : (S,) array
        Eccentric angle of each, rad.
    shape : (S, 5) array
        Derivative of the offsets by the ellipse.
    """
    last = min(_LAST, len(offset) // 6)
    if last < _FIRST:
        return 1.0
    orders = np.arange(_FIRST, last + 1)
    waves = np.concatenate([np.cos(direction[:, None] * orders), np.sin(direction[:, None] * orders)], axis=1)
    rows = np.concatenate([shape, waves], axis=1) / sigma[:, None]
    rows /= np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    known = offset / sigma
    # The harmonics reduce the sum of squares by more than their number if errors are shared.
    ends = [float(np.sum((known - r @ np.linalg.lstsq(r, known, rcond=1e-8)[0]) ** 2)) for r in (rows[:, :5], rows)]
    free = 2 * len(orders)
    excess = (ends[0] - ends[1]) / free
    return max(1.0, (free * excess + _PRIOR) / (free + _PRIOR))


def _around(values: Array, half: int) -> Array:
    """Sums over `half` neighbours on either side, around the closed contour."""
    out = values.copy()
    for shift in range(1, half + 1):
        out += np.roll(values, shift) + np.roll(values, -shift)
    return out


def direction_of(ellipse: Array, points_px: Array) -> Array:
    """Eccentric angle (N,) of points near an ellipse, rad."""
    angle = math.radians(ellipse[4])
    dx, dy = (points_px - ellipse[:2]).T
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(np.arctan2((c * dy - s * dx) / ellipse[3], (c * dx + s * dy) / ellipse[2]))
