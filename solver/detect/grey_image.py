"""The noise of an image, and its 8-bit version for detectors that accept nothing else."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

_NOISE_PIXELS = 8_000


def noise_dn(image: NDArray[Any]) -> float:
    """Standard deviation of the pixels' noise, from second differences that cancel every smooth surface.

    Source: J. Immerkaer, Fast noise variance estimation, CVIU 64 (1996); with the median, so that edges do not count.
    """
    if min(image.shape) < 3:
        return 0.0
    # About 8,000 pixels determine the median to 2.5 %.
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


def grey_8bit(image: NDArray[Any], full_scale_dn: float) -> tuple[NDArray[np.uint8], float]:
    """The image stretched to 8 bits and the gain, for detectors that accept only 8 bits; not for measurements."""
    low, high = float(image.min()), float(image.max())
    # The range is at least a sixteenth of the full scale, so that the noise of a blank image is not amplified.
    span = max(high - low, full_scale_dn / 16.0)
    if image.dtype == np.uint8 and span > 0.5 * full_scale_dn:
        return np.asarray(image), 1.0
    gain = 255.0 / span
    grey = cv2.convertScaleAbs(np.asarray(image, dtype=np.float32), alpha=gain, beta=-low * gain)
    return np.asarray(grey, dtype=np.uint8), gain
