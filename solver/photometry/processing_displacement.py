"""What a camera's processing does to an edge: sharpening and tone curves displace it, all around a contour.

Both work on encoded levels, in which an edge is no longer symmetric. Once the curve is undone, its middle has moved to
the darker side. The solver knows at most that an image was processed, not how much: the displacement at strengths that
are typical of phones becomes a standard deviation, and the pose stays as it is. It grows slowly with the strength,
because sharpening makes the edge steeper, too.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.response_curve import ResponseCurve
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE

Array = NDArray[np.float64]

_AMOUNT, _RADIUS_PX = 0.7, 1.0  # unsharp mask
_CONTRAST = 0.25  # S-curve: the slope of middle grey is 1 + this / 2
_STEP_PX, _REACH_PX = 0.05, 4.0  # of the profile


def processing_displacement_px(
    curve: ResponseCurve, inside: float, outside: float, blur_px: float, sharpened: bool, toned: bool
) -> float:
    """Distance, toward the outside, by which typical processing displaces an edge.

    Parameters
    ----------
    curve : ResponseCurve
        Of the levels that were processed.
    inside, outside : float
        Light on both sides, as fractions of the range.
    blur_px : float
        Gaussian sigma of the blur, excluding the pixel's aperture.
    sharpened, toned : bool
        The steps of the processing.
    """
    from scipy.special import ndtr

    low, high = (min(max(side, 0.0), 1.0) for side in (inside, outside))
    if math.isclose(low, high) or not (sharpened or toned):
        return 0.0
    sigma = math.sqrt(blur_px**2 + PIXEL_VARIANCE)
    reach = _REACH_PX * math.hypot(sigma, _RADIUS_PX)
    x = np.arange(-reach, reach + _STEP_PX, _STEP_PX)
    # Sharpening takes the levels that a tone curve has made.
    level = _toned(curve.level(low + (high - low) * ndtr(x / sigma)), toned)
    if sharpened:
        level = level + _AMOUNT * (level - _blurred(level))
    light = np.asarray(curve.light(np.clip(level, 0.0, 1.0)), dtype=np.float64)
    ends = np.asarray(curve.light(_toned(curve.level([low, high]), toned)), dtype=np.float64)
    share = (light - ends[0]) / (ends[1] - ends[0])
    after = int(np.argmax(share >= 0.5))  # overshoots lie beyond the plateaus: the middle is passed once
    return float(np.interp(0.5, share[after - 1 : after + 1], x[after - 1 : after + 1]))


def _toned(level: Array, toned: bool) -> Array:
    v = np.clip(np.asarray(level, dtype=np.float64), 0.0, 1.0)
    return v + _CONTRAST * (v * v * (3 - 2 * v) - v) if toned else v


def _blurred(level: Array) -> Array:
    """A profile after the unsharp mask's blur; its ends go on as they are."""
    half = round(_REACH_PX * _RADIUS_PX / _STEP_PX)
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) * _STEP_PX / _RADIUS_PX) ** 2)
    return np.convolve(np.pad(level, half, mode="edge"), kernel / kernel.sum(), mode="valid")
