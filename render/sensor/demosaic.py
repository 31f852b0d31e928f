"""Bayer mosaics: the filter of each pixel, and bilinear interpolation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.study.sensor_section import filters_of

Array = NDArray[np.float64]

# Bilinear interpolation between the pixels of one colour (red and blue: a quarter of all; green: a half). On the grid
# of its own colour, the weights of each kernel add up to 1 at every phase.
_GREEN = np.array([[0.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 0.0]]) / 4.0
_RED_BLUE = np.array([[1.0, 2.0, 1.0], [2.0, 4.0, 2.0], [1.0, 2.0, 1.0]]) / 4.0


def filter_of(mosaic: str, rows: NDArray[np.integer[Any]], columns: NDArray[np.integer[Any]]) -> NDArray[np.intp]:
    """Filter of pixels: 0 red, 1 green, 2 blue. A mosaic such as `rggb` lists two rows of two, from the top left."""
    tile = np.array(filters_of(mosaic), dtype=np.intp).reshape(2, 2)
    return np.asarray(tile[rows % 2, columns % 2], dtype=np.intp)


def filters(mosaic: str, shape: tuple[int, int]) -> NDArray[np.intp]:
    """Filter (H, W) of every pixel: 0 red, 1 green, 2 blue."""
    return filter_of(mosaic, np.arange(shape[0])[:, None], np.arange(shape[1])[None, :])


def demosaic(levels: NDArray[Any], mosaic: str) -> Array:
    """Colours (H, W, 3) from a mosaic (H, W), by bilinear interpolation.

    A constant colour is preserved up to the border, a linear ramp in the interior.
    """
    from scipy.ndimage import convolve

    levels = np.asarray(levels, dtype=np.float64)
    colour = filters(mosaic, (levels.shape[0], levels.shape[1]))
    out = np.empty((*levels.shape, 3))
    for channel, kernel in enumerate((_RED_BLUE, _GREEN, _RED_BLUE)):
        # Mirror about the last pixel, not its edge, so that the mosaic continues in phase beyond the border.
        convolve(np.where(colour == channel, levels, 0.0), kernel, output=out[..., channel], mode="mirror")
    return out
