"""The edges of a grey image as chains of neighbouring pixels, by OpenCV's EdgeDrawing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chains:
    """Chains of neighbouring edge pixels.

    Attributes
    ----------
    points_px : (N, 2) array of int32
        x and y of the pixels of all chains, one chain after another.
    starts : (n + 1,) array of int64
        Chain i has the points `starts[i]` to `starts[i + 1]`.
    """

    points_px: NDArray[np.int32]
    starts: NDArray[np.int64]


def edge_chains(grey: NDArray[np.uint8], noise: float) -> Chains:
    """Edge chains of an 8-bit image whose noise has this standard deviation."""
    drawing = _drawing(noise)
    drawing.detectEdges(grey)
    segments = drawing.getSegments()
    lengths = np.array([0, *map(len, segments)], dtype=np.int64)
    points = np.concatenate(segments) if len(segments) else np.zeros((0, 2), np.int32)
    return Chains(np.ascontiguousarray(points, dtype=np.int32).reshape(-1, 2), np.cumsum(lengths))


def edgedrawing_ellipses(grey: NDArray[np.uint8], noise: float) -> list[Array]:
    """EdgeDrawing's own ellipses (5,); it returns circles for ellipses as eccentric as 14.4 x 11.4 px."""
    drawing = _drawing(noise)
    drawing.detectEdges(grey)
    answer = drawing.detectEllipses()
    out = []
    if answer is not None:
        for x, y, r, a, b, angle in np.asarray(answer, dtype=np.float64).reshape(-1, 6):
            # A circle has r > 0 and a = b = 0, an ellipse r = 0 and a, b > 0.
            big, small = max(a, b) + r, min(a, b) + r
            out.append(np.array([x, y, big, small, angle if a >= b else angle + 90.0]))
    return out


def _drawing(noise: float) -> Any:
    parameters = cv2.ximgproc.EdgeDrawing.Params()
    parameters.EdgeDetectionOperator = cv2.ximgproc.EdgeDrawing_PREWITT
    # Strong noise needs a wider Gaussian: a step keeps 1 / sigma of its gradient, noise only 1 / sigma^2.
    parameters.Sigma = 1.0 if noise <= 10.0 else 2.0
    # After that Gaussian, Prewitt sums of noise have a sigma of 3 * 2 / sqrt(8 pi) = 1.2 times the noise, for sigma 1.
    parameters.GradientThresholdValue = max(16, round(4.5 * 1.2 * noise / parameters.Sigma**2))
    parameters.AnchorThresholdValue = 2
    parameters.MinPathLength = 10
    parameters.NFAValidation = True
    drawing = cv2.ximgproc.createEdgeDrawing()
    drawing.setParams(parameters)
    return drawing
