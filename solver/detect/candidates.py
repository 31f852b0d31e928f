"""Candidate ellipses: those that EdgeDrawing finds, and those fitted to its edge segments.

This is fast and rough: a candidate is accurate to a pixel or two, and most are false positives. `detect` decides.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.solver.detect.arcs import arcs_of
from roundel.solver.fit.ellipse import FailedFit, direct_ellipse
from roundel.solver.fit.ellipse_distance import foot_points

Array = NDArray[np.float64]

_MIN_SEMI_AXES_PX = (3.0, 1.2)  # major and minor; smaller ellipses have no visible interior
_MIN_ASPECT = 0.08  # b / a; a circle at 85 degrees of tilt
_NOISE_PIXELS = 20_000
_MIN_SEGMENT_POINTS = 12
_MIN_ARC = 0.2  # fraction of the ellipse that a piece must span


def noise_dn(image: NDArray[Any]) -> float:
    """Standard deviation of the pixels' noise, from second differences that cancel every smooth surface.

    Source: J. Immerkaer, Fast noise variance estimation, CVIU 64 (1996); with the median, so that edges do not count.
    """
    if min(image.shape) < 3:
        return 0.0
    # About 20,000 pixels determine the median to 1.5 %.
    skip = max(1, image.size // (3 * _NOISE_PIXELS))
    strips = image[: image.shape[0] // 3 * 3].reshape(-1, 3, image.shape[1])[::skip]
    top, middle, bottom = (strips[:, i].astype(np.float32) for i in range(3))
    rows = top - 2 * middle + bottom
    second = rows[:, :-2] - 2 * rows[:, 1:-1] + rows[:, 2:]
    size = np.abs(second)
    median = float(np.median(size))
    if np.issubdtype(image.dtype, np.integer) and median >= 1.0:
        # For integers the median is uncertain by half a level on either side.
        below, at = float(np.mean(size < median)), float(np.mean(size == median))
        median += (0.5 - below) / at - 0.5 if at > 0 else 0.0
    return median * 1.4826 / 6.0  # the mask's weights have the norm 6


def grey_8bit(image: NDArray[Any]) -> tuple[NDArray[np.uint8], float]:
    """The image stretched to 8 bits and the gain, for detectors that accept only 8 bits; not for measurements."""
    sample = image[::4, ::4]
    low, high = (float(sample.min()), float(sample.max())) if sample.size else (0.0, 0.0)
    # The range is at least a sixteenth of the full scale, so that the noise of a blank image is not amplified.
    full = float(np.iinfo(image.dtype).max) if np.issubdtype(image.dtype, np.integer) else max(high, 1e-12)
    span = max(high - low, full / 16.0)
    if image.dtype == np.uint8 and span > 0.5 * full:
        return np.ascontiguousarray(image, dtype=np.uint8), 1.0
    gain = 255.0 / span
    return np.ascontiguousarray(np.clip((image.astype(np.float32) - low) * gain, 0, 255).astype(np.uint8)), gain


def edge_drawing(grey: NDArray[np.uint8], noise: float, with_ellipses: bool = True) -> tuple[list[Array], list[Array]]:
    """Edge segments, (N, 2) each, and optionally EdgeDrawing's ellipses, (5,) each."""
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
    drawing.detectEdges(grey)
    segments = [np.asarray(s, dtype=np.float64).reshape(-1, 2) for s in drawing.getSegments()]
    answer = drawing.detectEllipses() if with_ellipses else None
    ellipses = []
    if answer is not None:
        for x, y, r, a, b, angle in np.asarray(answer, dtype=np.float64).reshape(-1, 6):
            # A circle has r > 0 and a = b = 0, an ellipse r = 0 and a, b > 0.
            big, small = max(a, b) + r, min(a, b) + r
            ellipses.append(np.array([x, y, big, small, angle if a >= b else angle + 90.0]))
    return segments, ellipses


def from_segments(segments: list[Array], shape: tuple[int, ...]) -> list[Array]:
    """Ellipses fitted to whole edge segments, or to their pieces between corners."""
    out = []
    everything = np.concatenate(segments) if segments else np.zeros((0, 2))
    rest = []
    for points in segments:
        ellipse = _of_points(points, shape)
        if ellipse is None:
            rest.append(points)
        else:
            out.append(_grown(ellipse, points, everything, shape))
    for arc in arcs_of(rest):
        # If a segment continues into something else without a corner, one of its halves is an arc.
        half = len(arc) // 2
        for points in (arc, arc[:half], arc[half:]):
            ellipse = _of_points(points, shape)
            if ellipse is not None:
                out.append(_grown(ellipse, points, everything, shape))
            if (ellipse is not None and points is arc) or half < 2 * _MIN_SEGMENT_POINTS:
                break
    return out


def _of_points(points: Array, shape: tuple[int, ...]) -> Array | None:
    if len(points) < _MIN_SEGMENT_POINTS or (points.max(axis=0) - points.min(axis=0)).min() < 3.0:
        return None
    # OpenCV's direct fit is fast and rough, which suits thousands of segments.
    (x, y), (width, height), angle = cv2.fitEllipseDirect(points.astype(np.float32))
    ellipse = np.array([x, y, width / 2, height / 2, angle])
    if height > width:
        ellipse[2:] = height / 2, width / 2, angle + 90.0
    # Chain points are whole pixels, off by 0.3 px; a residual above that and 4 % of the size is a square or a letter.
    if not plausible(ellipse, shape) or _sampson_rms(ellipse, points) > min(0.5 + 0.04 * float(ellipse[3]), 2.0):
        return None
    return ellipse if _covered(ellipse, points) >= _MIN_ARC else None


def _grown(ellipse: Array, points: Array, everything: Array, shape: tuple[int, ...]) -> Array:
    """Refit an arc with the points along its continuation."""
    covered = _covered(ellipse, points)
    for _ in range(3):
        if covered > 0.9:
            break
        more = _along(ellipse, everything)
        grown = direct_ellipse(more)
        if isinstance(grown, FailedFit) or not plausible(grown, shape):
            break
        before, ellipse, covered = covered, grown, _covered(grown, more)
        if covered <= before:
            break
    return ellipse


def _sampson_rms(ellipse: Array, points: Array) -> float:
    """RMS of the first-order (Sampson) distance."""
    return float(np.sqrt(np.mean(_sampson(ellipse, points) ** 2)))


def _in_frame(ellipse: Array, points: Array) -> Array:
    """Points (N, 2) in the frame in which the ellipse is the unit circle."""
    angle = math.radians(ellipse[4])
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.asarray((points - ellipse[:2]) @ turn / ellipse[2:4])


def _sampson(ellipse: Array, points: Array) -> Array:
    """First-order (Sampson) distance, F / |grad F|."""
    p = _in_frame(ellipse, points)
    gradient = np.sum((p / ellipse[2:4]) ** 2, axis=1)
    value = np.sum(p * p, axis=1) - 1.0
    return np.asarray(value / np.sqrt(np.maximum(4.0 * gradient, 1e-12)))


def plausible(ellipse: Array, shape: tuple[int, ...]) -> bool:
    """Whether this ellipse (5,) may be a circle in an image of this shape."""
    x, y, a, b, angle = map(float, ellipse)
    if not math.isfinite(x + y + a + b + angle):
        return False
    inside = -0.5 * a <= x <= shape[1] + 0.5 * a and -0.5 * a <= y <= shape[0] + 0.5 * a
    return (
        inside and a >= _MIN_SEMI_AXES_PX[0] and b >= _MIN_SEMI_AXES_PX[1] and b >= _MIN_ASPECT * a and a <= max(shape)
    )


def rms_distance(ellipse: Array, points: Array) -> float:
    """RMS of the orthogonal distances of points (N, 2) to an ellipse (5,), px."""
    return float(np.sqrt(np.mean(foot_points(ellipse, points)[0] ** 2)))


def _covered(ellipse: Array, points: Array) -> float:
    """Fraction of 24 equal steps of the eccentric angle that contain a point."""
    p = _in_frame(ellipse, points)
    angle = np.arctan2(p[:, 1], p[:, 0]) / (2 * np.pi) + 0.5
    return float(np.count_nonzero(np.bincount((angle * 24).astype(np.int64) % 24, minlength=24))) / 24.0


def _along(ellipse: Array, points: Array) -> Array:
    radius = float(ellipse[2]) + 2.0
    box = np.all(np.abs(points - ellipse[:2]) <= radius, axis=1)
    close = points[box]
    return close[np.abs(_sampson(ellipse, close)) <= 1.5]
