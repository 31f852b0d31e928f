"""The sRGB curve (IEC 61966-2-1), both ways, on levels from 0 to 1."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def srgb_to_linear(level: ArrayLike) -> Array:
    """Convert encoded levels (...) to linear light (...)."""
    encoded = np.asarray(level, dtype=np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: ArrayLike) -> Array:
    """Convert linear light (...) to encoded levels (...)."""
    linear = np.asarray(light, dtype=np.float64)
    # Avoid powers of negative numbers, also where the linear part applies.
    power = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, power)
