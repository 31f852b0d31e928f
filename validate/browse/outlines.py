"""Outlines of markers in few bytes: fewer points, in hundredths of a pixel, each relative to the one before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PER_PX = 100
# How far the polygon of the points is from the contour. The page draws circles as smooth curves through the points,
# which are closer by far: 0.02 px.
_TOLERANCE_PX = 0.5
_COARSEST_STEP = 16


def packed_outline(x_px: Array, y_px: Array) -> tuple[list[int], bool]:
    """An outline in the numbers of `packed`, and whether it is closed.

    Points that are not in front of the camera are not finite; they are left out, and the outline is open there.
    """
    points = np.stack([x_px, y_px], axis=-1)
    known = np.asarray(np.isfinite(points).all(axis=-1))
    if not known.any():
        return [], False
    if known.all():
        return packed(_decimated(points)), True
    # It starts behind the gap, so that no line crosses it.
    start = np.flatnonzero(known & ~np.roll(known, 1))[0]
    order = np.roll(np.arange(len(points)), -start)
    return packed(points[order][known[order]]), False


def packed(points: Array) -> list[int]:
    """Points (N, 2) as x0, y0, then the differences x1 - x0, y1 - y0, ..., in 1 / `PER_PX` of a pixel.

    Examples
    --------
    >>> packed(np.array([[10.0, 20.0], [10.5, 20.0], [10.5, 21.0]]))
    [1000, 2000, 50, 0, 0, 100]
    """
    steps = np.diff(np.rint(points * PER_PX), axis=0, prepend=0)
    return [int(value) for value in steps.ravel()]


def _decimated(points: Array) -> Array:
    """The fewest evenly spaced points whose polygon is within `_TOLERANCE_PX` of the closed contour."""
    step = _COARSEST_STEP
    while step > 1 and not (len(points) % step == 0 and _deviation_px(points, step) <= _TOLERANCE_PX):
        step //= 2
    return points[::step]


def _deviation_px(points: Array, step: int) -> float:
    """Largest distance of a point from the chord that replaces it."""
    ends = points[::step]
    chord = np.roll(ends, -1, axis=0) - ends
    length = np.maximum(np.hypot(*chord.T), 1e-12)
    between = points.reshape(len(ends), step, 2) - ends[:, None]
    across = between[..., 0] * chord[:, None, 1] - between[..., 1] * chord[:, None, 0]
    return float(np.max(np.abs(across) / length[:, None]))
