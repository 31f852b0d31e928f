"""Dark blobs of an image with the moments of their ink, and outlines of larger ink: dots and crowns of markers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_FEWEST_PX, _MOST_PX = 4, 20_000
_WINDOWS = (15, 31, 61, 121)  # sides of the neighbourhoods for thresholds, px
_SIGMAS = 10.0  # noise alone spans about 6 over a neighbourhood
_OUTLINE_WINDOWS = (15, 45)
_SHORTEST_OUTLINE = 40  # px
_LEAST_SEMI_AXIS_PX = 4.0
_MOST_ENLARGED_PX = 3_000_000
_LEAST_FILL = 0.6  # of the ellipse with a blob's second moments


@dataclass(frozen=True, eq=False)
class Blobs:
    """Blobs of ink.

    Attributes
    ----------
    centre : (N, 2) array
        Centroids, px.
    spread : (N, 2, 2) array
        Second moments with the blur removed, px^2: a quarter of A A^T for an ellipse {c + A u, |u| = 1}.
    variance : (N,) array
        Variance of the blur and the pixel that was removed, px^2.
    """

    centre: Array
    spread: Array
    variance: Array

    @property
    def size(self) -> Array:
        """Geometric mean of the semi-axes, (N,), px."""
        return np.asarray(2.0 * np.sqrt(np.sqrt(np.maximum(np.linalg.det(self.spread), 1e-12))))


def ink_blobs(levels: Array, noise_dn: float, light: bool = False) -> Blobs:
    """The compact dark (or light) blobs of an image.

    A pixel is ink if it is darker than the middle between the darkest and the lightest level of its neighbourhood. A
    blob's ink is the paper around it minus its level, over the same less the darkest level: it sums to the area pi a b
    whatever the blur v, which adds v I to the second moments M. An ellipse has det(M - v I) = (a b / 4)^2, from which v
    follows.

    Parameters
    ----------
    levels : (H, W) array
        Linear in light.
    noise_dn : float
    light : bool
        Whether the ink is lighter than its paper.

    Returns
    -------
    Blobs
        Those found with any of several neighbourhoods, without repetition.
    """
    image = np.asarray(-levels if light else levels, dtype=np.float32)
    kept: list[tuple[Array, Array, float]] = []
    cells: dict[tuple[int, int], list[Array]] = {}
    for window in _WINDOWS:
        if window > 2 * min(image.shape):
            break
        kernel = np.ones((window, window), np.uint8)
        low, high = cv2.erode(image, kernel), cv2.dilate(image, kernel)
        ink = (image < (low + high) / 2) & (high - low > _SIGMAS * max(noise_dn, 0.5) + 2.0)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(ink.astype(np.uint8), connectivity=4)
        for k in range(1, count):
            x, y, w, h, area = (int(v) for v in stats[k])
            if not _FEWEST_PX <= area <= _MOST_PX or max(w, h) > 0.6 * window:
                continue
            if x == 0 or y == 0 or x + w == image.shape[1] or y + h == image.shape[0]:
                continue
            blob = _moments(image, np.asarray(labels, dtype=np.int32), k, (x, y, w, h))
            if blob is None:
                continue
            # A centre within a pixel is in its own cell or in one of the eight around it.
            column, row = (int(v) for v in np.floor(blob[0]))
            beside = [c for i in (-1, 0, 1) for j in (-1, 0, 1) for c in cells.get((column + i, row + j), ())]
            if all(np.hypot(*(blob[0] - c)) > 1.0 for c in beside):
                kept.append(blob)
                cells.setdefault((column, row), []).append(blob[0])
    if not kept:
        return Blobs(np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))
    centres, spreads, variances = zip(*kept, strict=True)
    return Blobs(np.array(centres), np.array(spreads), np.array(variances))


def _moments(
    image: NDArray[np.float32], labels: NDArray[np.int32], k: int, box: tuple[int, int, int, int]
) -> tuple[Array, Array, float] | None:
    """Centroid, second moments without the blur, and the blur's variance of one blob; None if it is not compact."""
    x, y, w, h = box
    pad = 2
    x0, y0 = max(x - pad, 0), max(y - pad, 0)
    x1, y1 = min(x + w + pad, image.shape[1]), min(y + h + pad, image.shape[0])
    patch = image[y0:y1, x0:x1].astype(np.float64)
    own = labels[y0:y1, x0:x1]
    mine = cv2.dilate((own == k).astype(np.uint8), np.ones((2 * pad + 1, 2 * pad + 1), np.uint8)) > 0
    # A pixel between two blobs belongs to the nearer one; ink of another blob is not paper.
    mine &= (own == k) | (own == 0)
    paper = float(np.percentile(patch[own == 0], 75)) if np.any(own == 0) else 0.0
    dark = float(patch[own == k].min())
    if paper <= dark:
        return None
    weight = np.where(mine, np.clip((paper - patch) / (paper - dark), 0.0, None), 0.0)
    weight[weight < 0.04] = 0.0
    mass = float(weight.sum())
    rows, columns = np.mgrid[y0:y1, x0:x1]
    centre = np.array([float((weight * columns).sum()), float((weight * rows).sum())]) / mass
    u, v = columns - centre[0], rows - centre[1]
    xx, xy, yy = (float((weight * p).sum()) / mass for p in (u * u, u * v, v * v))
    quarter = mass / (4.0 * math.pi)  # a b / 4
    variance = ((xx + yy) - math.sqrt((xx - yy) ** 2 + 4 * xy**2 + 4 * quarter**2)) / 2
    # Rounding, a neighbour's ink or a square shape: half a pixel less blur than none is not an ellipse.
    if variance < -0.25 * quarter - 0.25 or quarter**2 < (_LEAST_FILL**2) * max(xx * yy - xy**2, 0.0) * 0.25:
        return None
    variance = max(variance, 0.0)
    spread = np.array([[xx - variance, xy], [xy, yy - variance]])
    if np.linalg.det(spread) <= 0 or np.trace(spread) <= 0:
        return None
    return centre, spread, variance


def ink_outlines(levels: Array, noise_dn: float, light: bool = False) -> list[Array]:
    """Ellipses (5,) round connected ink of any shape, such as a crown: the largest first.

    Thresholds as in `ink_blobs`, on the image at twice its size; the ellipse is fitted to the outer contour and is that
    of the middle between ink and paper, to some tenths of a pixel.

    Parameters
    ----------
    levels : (H, W) array
    noise_dn : float
    light : bool
        Whether the ink is lighter than its paper.
    """
    image = np.asarray(-levels if light else levels, dtype=np.float32)
    scale = 2 if image.size <= _MOST_ENLARGED_PX else 1
    size = image.shape[1] * scale, image.shape[0] * scale
    enlarged = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC) if scale > 1 else image
    found: list[Array] = []
    for window in _OUTLINE_WINDOWS:
        if window > min(image.shape):
            break
        kernel = np.ones((window, window), np.uint8)
        low, high = (
            cv2.resize(extreme(image, kernel), size, interpolation=cv2.INTER_NEAREST)
            for extreme in (cv2.erode, cv2.dilate)
        )
        ink = (enlarged < (low + high) / 2) & (high - low > _SIGMAS * max(noise_dn, 0.5) + 2.0)
        closed = cv2.morphologyEx(ink.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        # Outlines of ink and of the holes in it; ink in a hole is outlined, too.
        contours, tree = cv2.findContours(closed, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        for i, contour in enumerate(contours):
            if tree[0, i, 3] >= 0 or len(contour) < _SHORTEST_OUTLINE * scale:
                continue
            (x, y), (width, height), angle = cv2.fitEllipse(contour)
            # A contour runs through the middles of its outermost pixels.
            a, b = (width / 2 + 0.5) / scale, (height / 2 + 0.5) / scale
            if min(a, b) < _LEAST_SEMI_AXIS_PX or max(a, b) > max(image.shape):
                continue
            turn = angle if a >= b else angle + 90.0
            centre = (x + 0.5) / scale - 0.5, (y + 0.5) / scale - 0.5
            ellipse = np.array([*centre, max(a, b), min(a, b), turn % 180.0])
            if all(np.abs(ellipse[:4] - other[:4]).max() > 0.5 for other in found):
                found.append(ellipse)
    return sorted(found, key=lambda ellipse: -float(ellipse[2] * ellipse[3]))
