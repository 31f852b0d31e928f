"""The camera's image signal processor, on levels after the curve: denoising, tone, saturation, sharpening.

Each step takes levels from 0 (black) to 1 (white), (H, W) or (H, W, 3). A guided filter removes noise, as it costs the
same for every window and keeps edges (K. He, J. Sun, X. Tang, "Guided image filtering", PAMI 35(6), 2013).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.study.sensor_section import IspSection

Array = NDArray[np.float64]

# Luma of red, green and blue, as in a JPEG file (ITU-R BT.601).
_LUMA = np.array([0.299, 0.587, 0.114])


def toned(levels: Array, isp: IspSection) -> Array:
    """Levels (...) through black point, white point and S-curve: pointwise and never decreasing.

    The curve is v + contrast (3 v^2 - 2 v^3 - v), which leaves black, middle grey and white in place.
    """
    v = np.clip((levels - isp.black_point) / (isp.white_point - isp.black_point), 0.0, 1.0)
    return np.asarray(v + isp.contrast * (v * v * (3 - 2 * v) - v), dtype=np.float64)


def saturated(colours: Array, isp: IspSection) -> Array:
    """Colours (..., 3) with their difference from grey multiplied; clipped to the range."""
    grey = (colours @ _LUMA)[..., None]
    return np.asarray(np.clip(grey + isp.saturation * (colours - grey), 0.0, 1.0), dtype=np.float64)


def guided(image: Array, guide: Array, deviation: float, radius_px: int) -> Array:
    """An image (H, W) smoothed where its guide (H, W) varies less than `deviation` (equations 5, 6 and 8)."""
    from scipy.ndimage import uniform_filter

    def mean(values: Array) -> Array:
        return np.asarray(uniform_filter(values, 2 * radius_px + 1))

    mean_guide, mean_image = mean(guide), mean(image)
    # A window's running sums may leave a negative rounding error.
    variance = np.maximum(mean(guide * guide) - mean_guide**2, 0.0)
    slope = (mean(guide * image) - mean_guide * mean_image) / (variance + deviation**2)
    return np.asarray(mean(slope) * guide + mean(mean_image - slope * mean_guide), dtype=np.float64)


def denoised(levels: Array, isp: IspSection) -> Array:
    """Levels without noise: luma guided by itself, the colours by luma, so that they do not run over its edges."""
    colour = levels.ndim == 3
    luma = levels @ _LUMA if colour else levels
    chroma = levels - luma[..., None] if colour else None
    if isp.luma_denoise > 0:
        luma = guided(luma, luma, isp.luma_denoise, isp.denoise_radius_px)
    if chroma is None:
        return luma
    if isp.chroma_denoise > 0:
        red, blue = (guided(chroma[..., i], luma, isp.chroma_denoise, isp.denoise_radius_px) for i in (0, 2))
        # Chroma has no luma of its own, which gives green.
        chroma = np.stack([red, -(_LUMA[0] * red + _LUMA[2] * blue) / _LUMA[1], blue], axis=-1)
    return np.asarray(luma[..., None] + chroma, dtype=np.float64)


def sharpened(levels: Array, isp: IspSection) -> Array:
    """Unsharp mask: the difference of luma from its Gaussian blur, times the amount, is added to every channel."""
    from scipy.ndimage import gaussian_filter

    luma = levels @ _LUMA if levels.ndim == 3 else levels
    detail = isp.sharpen_amount * (luma - gaussian_filter(luma, isp.sharpen_radius_px))
    return np.asarray(levels + (detail[..., None] if levels.ndim == 3 else detail), dtype=np.float64)


def processed(levels: Array, isp: IspSection) -> Array:
    """Levels (H, W) or (H, W, 3) through all steps, in their order, and clipped to the range."""
    if isp.luma_denoise > 0 or (isp.chroma_denoise > 0 and levels.ndim == 3):
        levels = denoised(levels, isp)
    levels = toned(levels, isp)
    if levels.ndim == 3 and isp.saturation != 1:
        levels = saturated(levels, isp)
    if isp.sharpen_amount > 0:
        levels = sharpened(levels, isp)
    return np.clip(levels, 0.0, 1.0)
