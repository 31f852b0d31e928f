"""Candidate ellipses: fitted to edge chains or to their arcs, and extended along the edges that continue them.

This is fast and rough: a candidate is accurate to a pixel or two, and most are false positives. `detect` decides.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.detect.arcs import MIN_POINTS, arcs_of
from roundel.solver.detect.edge_chains import Chains
from roundel.solver.detect.ellipse_sums import direct_fit, sampson
from roundel.solver.kernels.compiled import compiled

Array = NDArray[np.float64]

_MIN_A_PX, _MIN_B_PX = 3.0, 1.2  # smaller ellipses have no visible interior
_MIN_ASPECT = 0.08  # b / a; a circle at 85 degrees of tilt
_MIN_CHAIN_POINTS = 12
_MIN_ARC = 0.2  # fraction of the ellipse that a piece must span
_BINS = 24  # steps of the eccentric angle that measure it
_MAX_ARCS = 256  # of one chain
_WALK = 512  # most steps along an ellipse
_BESIDE_PX = 2  # an edge this close to an ellipse belongs to it


def candidate_ellipses(chains: Chains, shape: tuple[int, ...]) -> Array:
    """Ellipses (n, 5) fitted to whole chains, or to their pieces between corners.

    Parameters
    ----------
    chains : Chains
    shape : (int, int)
        Height and width of the image.
    """
    points, starts = chains.points_px, chains.starts
    edges = np.zeros(shape, np.uint8)
    edges[points[:, 1], points[:, 0]] = 1
    longest = int(np.max(np.diff(starts), initial=0))
    # A chain yields one ellipse, or at most two for each MIN_POINTS - 12 points or so of its arcs.
    out = np.empty((len(starts) + 2 * len(points) // MIN_POINTS + 16, 5))
    count = _from_chains(points, starts, edges, longest, out)
    return out[:count]


@compiled
def _from_chains(
    points: NDArray[np.int32], starts: NDArray[np.int64], edges: NDArray[np.uint8], longest: int, out: Array
) -> int:
    x, y, turn = np.empty(longest), np.empty(longest), np.empty(2 * longest)
    arcs, found = np.empty((_MAX_ARCS, 2), np.int64), 0
    walk = np.empty((2, 2 * _WALK))
    for chain in range(len(starts) - 1):
        first = starts[chain]
        count = starts[chain + 1] - first
        if count < _MIN_CHAIN_POINTS:
            continue
        for i in range(count):
            x[i], y[i] = points[first + i, 0], points[first + i, 1]
        if found < len(out) and _of_points(x[:count], y[:count], edges, walk, out[found]):
            found += 1
            continue
        for k in range(arcs_of(x, y, count, turn, arcs)):
            low, high = arcs[k]
            half = (high - low) // 2
            # If a chain continues into something else without a corner, one of its halves is an arc.
            for part in range(3):
                begin = low if part < 2 else low + half
                end = high if part != 1 else low + half
                if found < len(out) and _of_points(x[begin:end], y[begin:end], edges, walk, out[found]):
                    found += 1
                    if part == 0:
                        break
                if half < 2 * _MIN_CHAIN_POINTS:
                    break
    return found


@compiled
def _of_points(x: Array, y: Array, edges: NDArray[np.uint8], walk: Array, out: Array) -> bool:
    """Write the ellipse of a piece of a chain, extended along other edges; False if the piece is none."""
    count = len(x)
    if count < _MIN_CHAIN_POINTS:
        return False
    left, right, top, bottom = x[0], x[0], y[0], y[0]
    for i in range(count):
        left, right, top, bottom = min(left, x[i]), max(right, x[i]), min(top, y[i]), max(bottom, y[i])
    if min(right - left, bottom - top) < 3.0:
        return False
    if not direct_fit(x, y, count, out) or not plausible(out, edges.shape[0], edges.shape[1]):
        return False
    # Chain points are whole pixels, off by 0.3 px; a residual above that and 4 % of the size is a square or a letter.
    if _rms(out, x, y, count) > min(0.5 + 0.04 * out[3], 2.0):
        return False
    covered = _covered(out, x, y, count)
    if covered < _MIN_ARC:
        return False
    grown = np.empty(5)
    for _ in range(3):
        if covered > 0.9:
            break
        number = _along(out, edges, walk)
        if not direct_fit(walk[0], walk[1], number, grown) or not plausible(grown, edges.shape[0], edges.shape[1]):
            break
        before, covered = covered, _covered(grown, walk[0], walk[1], number)
        for i in range(5):
            out[i] = grown[i]
        if covered <= before:
            break
    return True


@compiled
def plausible(ellipse: Array, height: int, width: int) -> bool:
    """Whether this ellipse (5,) may be a circle in an image of this size."""
    x, y, a, b, angle = ellipse[0], ellipse[1], ellipse[2], ellipse[3], ellipse[4]
    if not math.isfinite(x + y + a + b + angle):
        return False
    if not (-0.5 * a <= x <= width + 0.5 * a and -0.5 * a <= y <= height + 0.5 * a):
        return False
    return bool(a >= _MIN_A_PX and b >= _MIN_B_PX and b >= _MIN_ASPECT * a and a <= max(height, width))


@compiled
def _rms(ellipse: Array, x: Array, y: Array, count: int) -> float:
    total = 0.0
    for i in range(count):
        total += sampson(ellipse, x[i], y[i]) ** 2
    return math.sqrt(total / count)


@compiled
def _covered(ellipse: Array, x: Array, y: Array, count: int) -> float:
    """Fraction of equal steps of the eccentric angle that contain a point."""
    c, s = math.cos(math.radians(ellipse[4])), math.sin(math.radians(ellipse[4]))
    seen, number = np.zeros(_BINS, np.bool_), 0
    for i in range(count):
        dx, dy = x[i] - ellipse[0], y[i] - ellipse[1]
        angle = math.atan2((c * dy - s * dx) / ellipse[3], (c * dx + s * dy) / ellipse[2])
        k = int((angle / (2.0 * math.pi) + 0.5) * _BINS) % _BINS
        number += not seen[k]
        seen[k] = True
    return number / _BINS


@compiled
def _along(ellipse: Array, edges: NDArray[np.uint8], walk: Array) -> int:
    """Write the edge pixels met on a walk along an ellipse, the nearest at each step, to `walk`; their number.

    The time depends on the ellipse's perimeter alone, not on the number of edges in the image.
    """
    height, width = edges.shape
    a, b = ellipse[2], ellipse[3]
    c, s = math.cos(math.radians(ellipse[4])), math.sin(math.radians(ellipse[4]))
    step = max(1.0, math.pi * (a + b) / _WALK)
    t, count = 0.0, 0
    while t < 2.0 * math.pi and count < walk.shape[1]:
        p, q = math.cos(t), math.sin(t)
        speed = math.hypot(a * q, b * p)
        nx, ny = b * p / speed, a * q / speed
        nx, ny = c * nx - s * ny, s * nx + c * ny
        fx, fy = ellipse[0] + c * a * p - s * b * q, ellipse[1] + s * a * p + c * b * q
        for k in range(2 * _BESIDE_PX + 1):
            offset = (k + 1) // 2 * (1 if k % 2 else -1)
            column, row = round(fx + offset * nx), round(fy + offset * ny)
            if 0 <= column < width and 0 <= row < height and edges[row, column]:
                walk[0, count], walk[1, count] = column, row
                count += 1
                break
        t += step / speed
    return count
