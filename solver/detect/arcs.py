"""Cut edge chains at corners, to keep the visible arcs of a circle that is partly hidden or crossed by a shadow."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]

STEP = 6  # points on either side that define a direction, because chains consist of whole pixels
_CORNER_DEG = 50.0
_BACK_DEG = 15.0  # turn against the direction of the arc
MIN_POINTS = 14
_MIN_TURN_DEG = 40.0  # a flatter arc does not determine an ellipse


@compiled
def arcs_of(x: Array, y: Array, count: int, turn: Array, arcs: NDArray[np.int64]) -> int:
    """Pieces of a chain that bend in one direction and have no corner.

    Parameters
    ----------
    x, y : arrays
        Neighbouring pixels; only the first `count` are used.
    count : int
    turn : array
        Workspace of at least twice the length of x.
    arcs : (n, 2) array
        Receives the first and the past-the-end index of each piece; what does not fit is dropped.

    Returns
    -------
    int
        The number of pieces: long enough and bent enough to determine an ellipse.
    """
    if count < max(MIN_POINTS, 2 * STEP + 1):
        return 0
    half, raw = STEP // 2, turn[count:]
    for i in range(count):
        raw[i] = 0.0  # near an open end there is no direction on one side
        if STEP <= i < count - STEP:
            ax, ay = x[i + STEP] - x[i], y[i + STEP] - y[i]
            bx, by = x[i] - x[i - STEP], y[i] - y[i - STEP]
            raw[i] = math.degrees(math.atan2(bx * ay - by * ax, ax * bx + ay * by))
    total = 0.0
    for i in range(min(half, count)):
        total += raw[i]
    for i in range(count):
        if i + half < count:
            total += raw[i + half]
        if i - half - 1 >= 0:
            total -= raw[i - half - 1]
        turn[i] = total / STEP
    found = 0
    for sign in (1.0, -1.0):
        first, bent = 0, 0.0
        for i in range(count + 1):
            if i < count and abs(turn[i]) <= _CORNER_DEG and sign * turn[i] > -_BACK_DEG:
                bent += sign * turn[i]
                continue
            # A turn is spread over STEP points on either side, so the sum counts it STEP times.
            if i - first >= MIN_POINTS and bent / STEP >= _MIN_TURN_DEG and found < len(arcs):
                arcs[found, 0], arcs[found, 1] = first, i
                found += 1
            first, bent = i + 1, 0.0
    return found
