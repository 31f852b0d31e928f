"""An image array of any kind as grey levels, with its saturation level."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

_LARGEST_LEVEL = 1e9  # beyond, squares and cubes of grey levels overflow float32


def grey_levels(image: NDArray[Any]) -> tuple[NDArray[Any], float]:
    """Grey levels (H, W), and the level at which pixels saturate.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        See `locate`.

    Raises
    ------
    ValueError
        If it is not an image: wrong shape, no pixels, neither integers nor real numbers, or not finite.
    """
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
    low, largest = float(np.min(pixels)), float(np.max(pixels))
    if not (math.isfinite(low) and math.isfinite(largest)):
        raise ValueError("the image has values that are not finite")
    if integers and pixels.dtype.itemsize <= 2:
        full_scale = float(np.iinfo(pixels.dtype).max)
    else:
        # Real numbers and very wide integers have no saturation level of their own: the smallest of 1, 255 and 65,535
        # that contains all values is used.
        full_scale = next(v for v in (1.0, 255.0, 65535.0, largest) if v >= largest)
        pixels = pixels.astype(np.float64 if integers or pixels.dtype.itemsize > 4 else np.float32, copy=False)
        if max(-low, largest) > _LARGEST_LEVEL:
            pixels, full_scale = pixels / pixels.dtype.type(max(-low, largest)), 1.0
    if pixels.ndim == 3:
        pixels = pixels[..., 0] if pixels.shape[2] == 1 else pixels[..., :3].mean(axis=2, dtype=np.float32)
    return pixels, full_scale
