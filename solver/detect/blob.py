"""The ellipse of a small blob from its grey-level moments; chains of whole pixels are too coarse at this size."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMALL_PX = 4.0  # semi-minor axis
_AROUND_PX = 1.5


def blob_ellipse(image: NDArray[Any], ellipse: Array) -> Array | None:
    """The ellipse with the centre and second moments of the blob at a rough ellipse; None if there is no blob.

    A uniformly filled ellipse {S u} has the covariance S S^T / 4. The weight of each pixel is its level between that of
    the surroundings (the median of a frame around the blob) and that of the blob (its most different pixel); its own
    area adds 1/12.

    Parameters
    ----------
    image : (H, W) array
    ellipse : (5,) array
        x_px, y_px, a_px, b_px, angle_deg.
    """
    x, y, a, b, angle = (float(v) for v in ellipse)
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    half = np.array([math.hypot(a * c, b * s), math.hypot(a * s, b * c)]) + _AROUND_PX
    x0, y0 = (max(0, math.floor(v)) for v in (x - half[0], y - half[1]))
    x1, y1 = (math.ceil(v) + 1 for v in (x + half[0], y + half[1]))
    patch = image[y0:y1, x0:x1].astype(np.float64)
    if min(patch.shape) < 3:
        return None
    dx, dy = np.arange(x0, x0 + patch.shape[1]) - x, (np.arange(y0, y0 + patch.shape[0]) - y)[:, None]
    p, q = c * dx + s * dy, c * dy - s * dx
    inside = (p / a) ** 2 + (q / b) ** 2 <= 1.0
    near = (p / (a + _AROUND_PX)) ** 2 + (q / (b + _AROUND_PX)) ** 2 <= 1.0
    if not np.any(inside) or np.all(near):
        return None
    outside = float(np.median(patch[~near]))
    blob = patch[inside] - outside
    own = float(blob[np.argmax(np.abs(blob))])
    if own == 0.0:
        return None
    weight = np.clip((patch - outside) / own, 0.0, 1.0) * near
    total = float(weight.sum())
    mx, my = float(np.sum(weight * dx)) / total, float(np.sum(weight * dy)) / total
    rows = np.broadcast_to(dx, patch.shape) - mx, np.broadcast_to(dy, patch.shape) - my
    cov = np.array([[np.sum(weight * u * v) for v in rows] for u in rows]) / total - np.eye(2) / 12.0
    values, vectors = np.linalg.eigh(cov)
    if not values[0] > 0:
        return None
    small, big = 2.0 * np.sqrt(values)
    turn = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180.0
    return np.array([x + mx, y + my, big, small, turn])
