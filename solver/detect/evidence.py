"""Contrast across the contours of many candidate ellipses at once: is there an edge all the way round?"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SAMPLES = 48
_OUTWARD_PX = 2.0
_LEAST_STEP = 0.2  # fraction of a strong step: light may be uneven along a contour
# The gradient of a square deviates by up to 45 degrees from the normal of its ellipse, for half of it by over 23.
_ALIGNED = 0.92
_LEAST_ALIGNED = 0.7


def contour_evidence(image: NDArray[Any], ellipses: Array) -> tuple[Array, Array]:
    """Fraction of each contour that shows a step of one polarity.

    Parameters
    ----------
    image : (H, W) array
        Grey levels.
    ellipses : (n, 5) array
        x_px, y_px, a_px, b_px, angle_deg.

    Returns
    -------
    support : (n,) array
        Fraction of the contour with such a step; 0 if too few of the steps are along the contour's normal.
    polarity : (n,) array
        +1 for dark inside, -1 for bright inside, 0 without support.
    """
    if len(ellipses) == 0:
        return np.zeros(0), np.zeros(0)
    t = np.linspace(0, 2 * np.pi, _SAMPLES, endpoint=False)
    x, y, a, b, angle = (column[:, None] for column in np.asarray(ellipses, dtype=np.float64).T)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    cos_t, sin_t = np.cos(t), np.sin(t)
    fx, fy = x + c * a * cos_t - s * b * sin_t, y + s * a * cos_t + c * b * sin_t
    # Normal in the ellipse's frame: (cos t / a, sin t / b), normalised.
    nx, ny = b * cos_t, a * sin_t
    length = np.hypot(nx, ny)
    nx, ny = (c * nx - s * ny) / length, (s * nx + c * ny) / length
    inward = np.minimum(2.0, 0.6 * b)
    # Outside, inside, right, left, below and above every point.
    offsets = [(_OUTWARD_PX * nx, _OUTWARD_PX * ny), (-inward * nx, -inward * ny)]
    offsets += [(inward * dx, inward * dy) for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    level, inside = bilinear(image, *(np.stack([f + o[i] for o in offsets]) for i, f in enumerate((fx, fy))))
    seen = inside[0] & inside[1]
    step = np.where(seen, level[0] - level[1], 0.0)
    gx, gy = level[2] - level[3], level[4] - level[5]
    along, steep = gx * nx + gy * ny, np.hypot(gx, gy)
    # The upper quartile instead of the median, which belongs to the occluder if half of the contour is hidden.
    rank = _SAMPLES * 3 // 4
    support, polarity = np.zeros(len(ellipses)), np.zeros(len(ellipses))
    for sign in (1.0, -1.0):
        typical = np.partition(sign * step, rank, axis=1)[:, rank, None]
        agrees = seen & (sign * step > _LEAST_STEP * typical) & (typical > 0)
        aligned = agrees & (sign * along > _ALIGNED * steep)
        count = np.count_nonzero(agrees, axis=1)
        good = (np.count_nonzero(seen, axis=1) >= _SAMPLES // 8) & (
            np.count_nonzero(aligned, axis=1) >= _LEAST_ALIGNED * count
        )
        fraction = np.where(good, count / _SAMPLES, 0.0)
        polarity = np.where(fraction > support, sign, polarity)
        support = np.maximum(support, fraction)
    return support, polarity


def bilinear(image: NDArray[Any], x: Array, y: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Bilinear grey levels at points, and which of them are in the image."""
    height, width = image.shape
    seen = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    x0, y0 = np.minimum(x.astype(np.int64), max(width - 2, 0)), np.minimum(y.astype(np.int64), max(height - 2, 0))
    right, below = 1 if width > 1 else 0, width if height > 1 else 0
    fx, fy = x - x0, y - y0
    flat, at = image.reshape(-1), y0 * width + x0
    top = flat[at] * (1 - fx) + flat[at + right] * fx
    return top * (1 - fy) + (flat[at + below] * (1 - fx) + flat[at + below + right] * fx) * fy, seen
