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

from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.order_statistics import median

Array = NDArray[np.float64]

_FAR = 4.5  # sigmas of a single sector's offset, or of the mean of a run
_RUNS = np.array([0, 1, 3])  # neighbours on either side
_LOUD = 1.5  # mean square of residuals over what chance allows: sharp edges fit some directions worse than others
_OPPOSITE = 2  # neighbours of the sector on the opposite side
FEWEST, LEAST = 12, 0.4  # sectors that are left, and their share of those with an offset
_FIRST, _LAST = 3, 8  # harmonics of the direction
_PRIOR = 8.0  # degrees of freedom by which an excess is taken to be none


@compiled
def chance(number: float, sigmas: float) -> float:
    """Mean square of so many normal numbers, that chance exceeds as rarely as a normal number exceeds these sigmas.

    Source: E. B. Wilson, M. M. Hilferty, The distribution of chi-square, PNAS 17 (1931).
    """
    share = 2.0 / (9.0 * max(number, 1.0))
    return max(1.0 - share + sigmas * math.sqrt(share), 0.1) ** 3


@compiled
def deviating_sectors(
    offset: Array, sigma: Array, square: Array, pixels: Array, used: NDArray[np.bool_], width: int
) -> NDArray[np.bool_]:
    """Sectors that do not belong to the ellipse or whose pixels do not match the model.

    Parameters
    ----------
    offset, sigma : (S,) arrays
        Offset of the edge from the ellipse in each sector, in the order of the contour, and its standard deviation, px.
    square, pixels : (S,) arrays
        Sum of the squared residuals of each sector's pixels, in any unit, and their number.
    used : (S,) array of bool
        Sectors that have an offset.
    width : int
        Neighbours on either side of a bad sector that are left out, too: blur carries the error to them.

    Returns
    -------
    (S,) array of bool
        None if fewer than 12 sectors, or less than 40 % of them, would be left.
    """
    count = len(offset)
    bad, none = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    number = 0
    for i in range(count):
        number += used[i]
    if number < FEWEST:
        return none
    z, sizes, noise, shares = np.zeros(count), np.empty(number), np.zeros(count), np.zeros(count)
    n, loud, level = 0, np.empty(number), np.zeros(count)
    for i in range(count):
        if used[i]:
            z[i] = offset[i] / sigma[i]
            for k in range(-1, 2):  # a sharp edge has two pixels a sector: three sectors tell noise from more
                j = (i + k) % count
                if used[j]:
                    noise[i], shares[i] = noise[i] + square[j], shares[i] + pixels[j]
            level[i] = noise[i] / max(shares[i], 1.0) / chance(shares[i], 0.0)
            sizes[n], loud[n] = abs(z[i]), level[i]
            n += 1
    limit = _FAR * max(1.0, 1.4826 * median(sizes))
    typical = median(loud)
    found = False
    for i in range(count):
        if not used[i]:
            continue
        for half in _RUNS:
            total, terms = 0.0, 0
            for k in range(-half, half + 1):
                j = (i + k) % count
                total, terms = total + z[j], terms + used[j]
            bad[i] = bad[i] or abs(total) > limit * math.sqrt(terms)
        # A blur that the model does not describe, of a moving camera, is the same on the opposite side.
        n = 0
        for k in range(-_OPPOSITE, _OPPOSITE + 1):
            j = (i + count // 2 + k) % count
            if used[j]:
                loud[n] = level[j]
                n += 1
        usual = max(typical, median(loud[:n])) if n > _OPPOSITE else typical
        bad[i] = bad[i] or noise[i] > _LOUD * usual * chance(shares[i], _FAR) * max(shares[i], 1.0)
        found = found or bad[i]
    if not found:
        return none
    out, left = np.zeros(count, np.bool_), 0
    for i in range(count):
        if used[i]:
            for k in range(-width, width + 1):
                out[i] = out[i] or bad[(i + k) % count]
            left += not out[i]
    return out if left >= max(FEWEST, LEAST * number) else none


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
    # Contiguous: a kernel is compiled again for each memory layout.
    return _shared_excess(offset / sigma, np.ascontiguousarray(shape / sigma[:, None]), sigma, direction)


@compiled
def _shared_excess(known: Array, rows: Array, sigma: Array, direction: Array) -> float:
    count = len(known)
    last = min(_LAST, count // 6)
    if last < _FIRST:
        return 1.0
    free = 2 * (last - _FIRST + 1)
    columns, left = np.empty((5 + free, count)), known.copy()
    for i in range(count):
        for j in range(5):
            columns[j, i] = rows[i, j]
        for order in range(_FIRST, last + 1):
            j = 5 + 2 * (order - _FIRST)
            columns[j, i] = math.cos(order * direction[i]) / sigma[i]
            columns[j + 1, i] = math.sin(order * direction[i]) / sigma[i]
    # The harmonics reduce the sum of squares by more than their number if errors are shared.
    explained = 0.0
    for j in range(5 + free):
        length = _length(columns[j])
        if not length > 0.0:
            continue
        for _ in range(2):  # the second time for the digits that the first one leaves
            for k in range(j):
                _subtract(columns[k], columns[j])
        rest = _length(columns[j])
        if rest < 1e-8 * length:  # what is left of the contour does not tell it from the others
            columns[j, :] = 0.0
            continue
        along = 0.0
        for i in range(count):
            columns[j, i] /= rest
            along += columns[j, i] * left[i]
        for i in range(count):
            left[i] -= along * columns[j, i]
        if j >= 5:
            explained += along * along
    return max(1.0, (explained + _PRIOR) / (free + _PRIOR))


@compiled
def _length(column: Array) -> float:
    total = 0.0
    for i in range(len(column)):
        total += column[i] * column[i]
    return math.sqrt(total)


@compiled
def _subtract(unit: Array, column: Array) -> None:
    """Remove from a column its part along a unit vector."""
    along = 0.0
    for i in range(len(column)):
        along += unit[i] * column[i]
    for i in range(len(column)):
        column[i] -= along * unit[i]


def direction_of(ellipse: Array, points_px: Array) -> Array:
    """Eccentric angle (N,) of points near an ellipse, rad."""
    angle = math.radians(ellipse[4])
    dx, dy = (points_px - ellipse[:2]).T
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(np.arctan2((c * dy - s * dx) / ellipse[3], (c * dx + s * dy) / ellipse[2]))
