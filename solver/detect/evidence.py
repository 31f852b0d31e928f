"""Evidence for many candidate ellipses at once: is there an edge all the way round, and where exactly?

Short profiles across a candidate are searched for their steepest step of one polarity; an ellipse is fitted to the
steps, and the search is repeated along it. Most candidates are not circles, and their steps lie on no ellipse.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.solver.detect.candidates import plausible
from roundel.solver.detect.ellipse_sums import direct_fit, sampson
from roundel.solver.kernels.compiled import compiled
from roundel.solver.kernels.order_statistics import select

Array = NDArray[np.float64]

SUPPORT, POLARITY, RESIDUAL, VISIBLE = 5, 6, 7, 8  # columns after the five of the ellipse
_LEAST_PROFILES, _MOST_PROFILES = 24, 64
_HALF = 4  # a profile has this many samples on either side
_PITCH_PX = 1.0  # and this pitch, or a third of the semi-minor axis of small ellipses
_ROUNDS = 2
_LEAST_STEP = 0.2  # fraction of a strong step: light may be uneven along a contour
_OFF_PX = 0.7  # a step farther from the ellipse does not belong to it


@compiled
def contour_evidence(image: NDArray[np.float32], ellipses: Array) -> Array:
    """Fraction of each contour that shows a step of one polarity, and the ellipse through these steps.

    Parameters
    ----------
    image : (H, W) array of float32
        Grey levels.
    ellipses : (n, 5) array
        x_px, y_px, a_px, b_px, angle_deg.

    Returns
    -------
    (n, 9) array
        The ellipse through the steps; the fraction of the contour that shows them, 0 if there is no ellipse; their
        polarity, +1 for dark inside, -1 for bright inside; the RMS of their distances from it, px; the fraction of the
        contour that is inside the image.
    """
    out = np.zeros((len(ellipses), 9))
    levels = np.empty((_MOST_PROFILES, 2 * _HALF + 1))
    seen, strength = np.empty(_MOST_PROFILES, np.bool_), np.empty(_MOST_PROFILES)
    x, y = np.empty(_MOST_PROFILES), np.empty(_MOST_PROFILES)
    feet = np.empty((_MOST_PROFILES, 4))
    for i in range(len(ellipses)):
        row = out[i]
        for j in range(5):
            row[j] = ellipses[i, j]
        for turn in range(_ROUNDS):
            count = _profiles(image, row, levels, seen, feet)
            pitch = min(_PITCH_PX, row[3] / 3.0)
            best, sign = 0.0, 1.0
            if turn == 0:
                for polarity in (1.0, -1.0):
                    number, typical = _steps(levels, seen, feet, count, pitch, polarity, strength, x, y)
                    if number * typical > best:
                        best, sign = number * typical, polarity
                row[POLARITY] = sign
            number, typical = _steps(levels, seen, feet, count, pitch, row[POLARITY], strength, x, y)
            row[VISIBLE] = _number(seen, count) / count
            number = _ellipse_of_steps(x, y, number, row)
            if number == 0 or not plausible(row, image.shape[0], image.shape[1]):
                row[SUPPORT] = 0.0
                break
            row[SUPPORT] = number / count
    return out


@compiled
def _profiles(image: NDArray[np.float32], ellipse: Array, levels: Array, seen: NDArray[np.bool_], feet: Array) -> int:
    """Grey levels across the contour, the foot points with their normals, and the number of profiles."""
    height, width = image.shape
    a, b = ellipse[2], ellipse[3]
    count = int(min(max(math.pi * (a + b) / 2.0, _LEAST_PROFILES), _MOST_PROFILES))
    pitch = min(_PITCH_PX, b / 3.0)
    c, s = math.cos(math.radians(ellipse[4])), math.sin(math.radians(ellipse[4]))
    for k in range(count):
        t = 2.0 * math.pi * k / count
        p, q = math.cos(t), math.sin(t)
        length = math.hypot(a * q, b * p)
        nx, ny = b * p / length, a * q / length
        nx, ny = c * nx - s * ny, s * nx + c * ny
        fx, fy = ellipse[0] + c * a * p - s * b * q, ellipse[1] + s * a * p + c * b * q
        feet[k, 0], feet[k, 1], feet[k, 2], feet[k, 3] = fx, fy, nx, ny
        seen[k] = 0.0 <= fx <= width - 1.0 and 0.0 <= fy <= height - 1.0
        for j in range(2 * _HALF + 1):
            offset = (j - _HALF) * pitch
            # Beyond the border the last pixel is repeated: a profile without a step.
            u, v = min(max(fx + offset * nx, 0.0), width - 1.0), min(max(fy + offset * ny, 0.0), height - 1.0)
            column, line = min(int(u), max(width - 2, 0)), min(int(v), max(height - 2, 0))
            right, below = min(column + 1, width - 1), min(line + 1, height - 1)
            u, v = u - column, v - line
            top = image[line, column] * (1.0 - u) + image[line, right] * u
            bottom = image[below, column] * (1.0 - u) + image[below, right] * u
            levels[k, j] = top * (1.0 - v) + bottom * v
    return count


@compiled
def _steps(
    levels: Array, seen: NDArray[np.bool_], feet: Array, count: int, pitch: float, sign: float,
    strength: Array, x: Array, y: Array,
) -> tuple[int, float]:  # fmt: skip
    """Where the profiles are steepest, for those with a step of one polarity; their number, and a strong step."""
    positive = 0
    for k in range(count):
        best, at = 0.0, -1
        if seen[k]:
            for j in range(1, 2 * _HALF):
                rise = sign * (levels[k, j + 1] - levels[k, j - 1])
                if rise > best:
                    best, at = rise, j
        strength[k] = 0.0
        if 2 <= at <= 2 * _HALF - 2:  # at an end of the profile it is the flank of another edge
            strength[k] = best
            positive += 1
            before = sign * (levels[k, at] - levels[k, at - 2])
            after = sign * (levels[k, at + 2] - levels[k, at])
            bend = 2.0 * best - before - after
            shift = 0.5 * (after - before) / bend if bend > 0.0 else 0.0
            offset = (at - _HALF + min(max(shift, -0.5), 0.5)) * pitch
            x[k], y[k] = feet[k, 0] + offset * feet[k, 2], feet[k, 1] + offset * feet[k, 3]
    # The upper quartile instead of the median, which belongs to the occluder if half of the contour is hidden.
    visible = _number(seen, count)
    if visible == 0:
        return 0, 0.0
    typical = select(strength[:count].copy(), count - 1 - visible // 4)
    number = 0
    for k in range(count):
        if strength[k] > 0.0 and strength[k] >= _LEAST_STEP * typical:
            x[number], y[number] = x[k], y[k]
            number += 1
    return number, typical


@compiled
def _number(seen: NDArray[np.bool_], count: int) -> int:
    """How many of the first `count` are true."""
    number = 0
    for k in range(count):
        number += seen[k]
    return number


@compiled
def _ellipse_of_steps(x: Array, y: Array, number: int, row: Array) -> int:
    """Fit the ellipse of a row to points, without those off it; how many are on it, 0 if there is no ellipse."""
    for turn in range(3):
        if number < 8 or not direct_fit(x, y, number, row):
            return 0
        total = 0.0
        for k in range(number):
            total += sampson(row, x[k], y[k]) ** 2
        row[RESIDUAL] = math.sqrt(total / number)
        if turn == 2:
            break
        limit, kept = max(_OFF_PX, 2.0 * row[RESIDUAL]), 0
        for k in range(number):
            if abs(sampson(row, x[k], y[k])) <= limit:
                x[kept], y[kept] = x[k], y[k]
                kept += 1
        if kept == number:
            break
        number = kept
    return number
