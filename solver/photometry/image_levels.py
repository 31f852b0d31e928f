"""An image array of any kind as grey levels that are linear in light, with its saturation level."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.response_curve import LINEAR, ResponseCurve

# Equal weights for arrays and datasets, whose sensors may have any primaries.
EQUAL = (1 / 3, 1 / 3, 1 / 3)

_ABOVE = 1.01  # of the largest value
_LARGEST_LEVEL = 1e9  # beyond, squares and cubes of grey levels overflow float32
_STRIP_ROWS = 512  # three float32 channels of a hundred megapixels would take 1.2 GB


def grey_levels(
    image: NDArray[Any],
    curve: ResponseCurve = LINEAR,
    top_dn: float | None = None,
    weights: tuple[float, float, float] = EQUAL,
    *,
    keep_8bit: bool = False,
) -> tuple[NDArray[Any], float]:
    """Grey levels (H, W) in linear light, and the top of their range.

    The range of the levels is kept: 255 stays 255. Colours are averaged in light, after the curve is undone.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        See `locate`.
    curve : ResponseCurve
        Undone; `unknown` leaves the levels as they are.
    top_dn : float, optional
        The level that the curve maps to 1; default: the largest of the integer type, or the smallest of 1, 255 and
        65,535 that contains all real numbers.
    weights : (float, float, float)
        Of red, green and blue.
    keep_8bit : bool
        Return an 8-bit grey image without a curve to undo as it is, for detection; other levels are float32.

    Raises
    ------
    ValueError
        If it is not an image: wrong shape, no pixels, neither integers nor real numbers, or not finite.
    """
    pixels, full_scale = _checked(image)
    if top_dn is None:
        top_dn = full_scale
    if curve.identity and keep_8bit and pixels.ndim == 2 and pixels.dtype == np.uint8:
        return pixels, full_scale
    if curve.identity:
        return _grey(pixels, None, weights), full_scale
    # With 8 or 16 bits there are few levels: the curve is computed once for each.
    if pixels.dtype in (np.uint8, np.uint16):
        level = np.arange(np.iinfo(pixels.dtype).max + 1, dtype=np.float64)
        table = (top_dn * curve.light(level / top_dn)).astype(np.float32)
        return _grey(pixels, table, weights), full_scale
    light = top_dn * curve.light(np.maximum(pixels, 0) / top_dn)
    return _grey(light.astype(np.float32), None, weights), full_scale


def encodable(image: NDArray[Any]) -> bool:
    """Whether an array may have encoded levels: no negative ones, and none beyond 16 bits."""
    if image.dtype in (np.uint8, np.uint16):
        return True
    return float(np.min(image)) >= 0.0 and float(np.max(image)) <= 65535.0


def averaged_rounding(image: NDArray[Any], weights: tuple[float, float, float] = EQUAL) -> float:
    """Fraction of the variance of the levels' rounding that is left in grey."""
    return 1.0 if image.ndim == 2 or image.shape[2] == 1 else sum(w * w for w in weights)


def _checked(image: NDArray[Any]) -> tuple[NDArray[Any], float]:
    """Pixels (H, W) or (H, W, 3) of a type that the rest can use, and the top of their range."""
    pixels = np.asarray(image)
    if pixels.ndim not in (2, 3) or (pixels.ndim == 3 and pixels.shape[2] not in (1, 3, 4)) or pixels.size == 0:
        raise ValueError(
            f"an image is (H, W) or (H, W, C) with 1, 3 or 4 channels; this array has shape {pixels.shape}"
        )
    if pixels.dtype == np.bool_:
        pixels = pixels.astype(np.uint8) * np.uint8(255)
    integers = pixels.dtype.kind in "iu"
    if not integers and pixels.dtype.kind != "f":
        raise ValueError(f"an image has integers or real numbers, not {pixels.dtype}")
    if integers and pixels.dtype.itemsize <= 2:
        full_scale = float(np.iinfo(pixels.dtype).max)
    else:
        low, largest = float(np.min(pixels)), float(np.max(pixels))
        if not (math.isfinite(low) and math.isfinite(largest)):
            raise ValueError("the image has values that are not finite")
        # Real numbers and very wide integers have no saturation level of their own: the smallest of 1, 255 and 65,535
        # that contains all values is used. Larger ones saturate nowhere, not at their own maximum.
        full_scale = next(v for v in (1.0, 255.0, 65535.0, _ABOVE * largest) if v >= largest)
        pixels = pixels.astype(np.float64 if integers or pixels.dtype.itemsize > 4 else np.float32, copy=False)
        if max(-low, largest) > _LARGEST_LEVEL:
            pixels, full_scale = pixels / pixels.dtype.type(max(-low, largest)), _ABOVE
    if pixels.ndim == 3:
        pixels = pixels[..., 0] if pixels.shape[2] == 1 else pixels[..., :3]
    return pixels, full_scale


def _grey(
    pixels: NDArray[Any], table: NDArray[np.float32] | None, weights: tuple[float, float, float]
) -> NDArray[np.float32]:
    """Weighted mean of the channels, each through a table of its levels if there is one."""
    if pixels.ndim == 2:
        return _looked_up(pixels, table)
    grey = np.empty(pixels.shape[:2], dtype=np.float32)
    by_channel = np.array([weights], dtype=np.float32)
    for start in range(0, len(grey), _STRIP_ROWS):
        rows = slice(start, start + _STRIP_ROWS)
        grey[rows] = cv2.transform(_looked_up(pixels[rows], table), by_channel)
    return grey


def _looked_up(pixels: NDArray[Any], table: NDArray[np.float32] | None) -> NDArray[np.float32]:
    if table is None:
        # Writable, too: kernels would be compiled again for an image that is not.
        return np.require(pixels, np.float32, ["C", "W"])
    if pixels.dtype == np.uint8:
        return np.asarray(cv2.LUT(np.ascontiguousarray(pixels), table), dtype=np.float32)
    return np.asarray(table[pixels])
