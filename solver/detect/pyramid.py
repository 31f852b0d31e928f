"""Image pyramid: images reduced by whole factors, and detections scaled back to full resolution.

Reduction shrinks the blur and averages the noise, so contours that are too blurred or noisy at full size are found.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.fit.edges import EdgePoints

Array = NDArray[np.float64]

# Types that cv2.resize accepts; others are converted to float32.
_RESIZABLE = ("uint8", "uint16", "float32", "float64")


def reduced(image: NDArray[Any], factor: int) -> NDArray[Any]:
    """Means of squares of `factor` pixels; a remainder at the right and lower border is dropped."""
    height, width = (n // factor for n in image.shape)
    whole = image[: height * factor, : width * factor]
    if whole.dtype.name not in _RESIZABLE:
        whole = whole.astype(np.float32)
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))


def enlarged_ellipse(ellipse: Array, factor: int) -> Array:
    """An ellipse (5,) of the reduced image in pixels of the full image; the centre of pixel 0 is 0 in both."""
    scale, shift = np.array([factor, factor, factor, factor, 1.0]), (factor - 1) / 2
    return np.asarray(ellipse * scale + np.array([shift, shift, 0.0, 0.0, 0.0]))


def enlarged(edges: EdgePoints, factor: int) -> EdgePoints:
    """Edge points of the reduced image in pixels of the full image."""
    # `blur_px` excludes the pixel's own variance, which differs between the two images.
    variance = factor**2 * (edges.blur_px**2 + PIXEL_VARIANCE) - PIXEL_VARIANCE
    return replace(
        edges,
        points_px=edges.points_px * factor + (factor - 1) / 2,
        sigma_px=edges.sigma_px * factor,
        ellipse=enlarged_ellipse(edges.ellipse, factor),
        blur_px=math.sqrt(variance),
        reach_px=(edges.reach_px[0] * factor, edges.reach_px[1] * factor),
    )
