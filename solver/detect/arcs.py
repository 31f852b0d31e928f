"""Cut edge segments at corners, to keep the visible arcs of a circle that is partly hidden or crossed by a shadow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STEP = 6  # points on either side that define a direction, because chains consist of whole pixels
_CORNER_DEG = 50.0
_BACK_DEG = 15.0  # turn against the direction of the arc
_MIN_POINTS = 14
_MIN_TURN_DEG = 40.0  # a flatter arc does not determine an ellipse


def arcs_of(segments: list[Array]) -> list[Array]:
    """Pieces of edge segments that bend in one direction and have no corner.

    Parameters
    ----------
    segments : list of (N, 2) arrays
        Chains of neighbouring pixels.

    Returns
    -------
    list of (N, 2) arrays
        Pieces that are long enough and bent enough to determine an ellipse.
    """
    segments = [s for s in segments if len(s) >= max(_MIN_POINTS, 2 * _STEP + 1)]
    if not segments:
        return []
    # All segments are concatenated, closed ones with repeated ends, so that each step is one pass over all points.
    rows = [np.concatenate([s[-_STEP:], s, s[:_STEP]]) if _is_closed(s) else s for s in segments]
    points = np.concatenate(rows)
    lengths = np.array([len(r) for r in rows])
    ends = np.cumsum(lengths)
    first, last = np.repeat(ends - lengths, lengths), np.repeat(ends - 1, lengths)
    at = np.arange(len(points))
    ahead, behind = points[np.minimum(at + _STEP, last)] - points, points - points[np.maximum(at - _STEP, first)]
    # Near an open end there is no direction on one side, so the turn is zero there.
    cross = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
    turn = -np.degrees(np.arctan2(cross, np.sum(ahead * behind, axis=1)))
    turn[(at - first < _STEP) | (last - at < _STEP)] = 0.0
    sums = np.concatenate([[0.0], np.cumsum(turn)])
    half = _STEP // 2
    smooth = (sums[np.minimum(at + half, last) + 1] - sums[np.maximum(at - half, first)]) / (2 * half + 1)
    out = []
    for start, end in zip(ends - lengths, ends, strict=True):
        out += _pieces(points[start:end], smooth[start:end])
    return out


def _is_closed(segment: Array) -> bool:
    return len(segment) > 4 * _STEP and float(np.max(np.abs(segment[0] - segment[-1]))) <= 3.0


def _pieces(points: Array, turn: Array) -> list[Array]:
    out = []
    sharp = np.abs(turn) > _CORNER_DEG
    for sign in (1.0, -1.0):
        bent = ~sharp & (sign * turn > -_BACK_DEG)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], bent, [False]]).astype(np.int8)))
        for start, end in edges.reshape(-1, 2):
            # A turn is spread over _STEP points on either side, so the sum counts it _STEP times.
            if end - start >= _MIN_POINTS and sign * float(np.sum(turn[start:end])) / _STEP >= _MIN_TURN_DEG:
                out.append(points[start:end])
    return out
