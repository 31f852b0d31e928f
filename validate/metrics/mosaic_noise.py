"""What interpolation between the pixels of a Bayer mosaic leaves at an edge, as noise of the grey image.

Bilinear interpolation blurs each pixel by its place in the cell: beside the mean blur a pattern remains, which a solver
that sees the grey image (the mean of the three colours) cannot tell from noise. Its variance is a fraction of the
squared contrast, measured on edges in many directions and places.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve
from scipy.special import ndtr

Array = NDArray[np.float64]

_SIDE = 16
_DIRECTIONS, _PLACES, _NEAR_PX = 24, 12, 3.0
# Weights of bilinear interpolation on the grid of a colour's own pixels: red and blue, green.
_RED_BLUE = np.array([[1.0, 2.0, 1.0], [2.0, 4.0, 2.0], [1.0, 2.0, 1.0]]) / 4.0
_GREEN = np.array([[0.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 0.0]]) / 4.0


@lru_cache(maxsize=256)
def mosaic_variance(blur_px: float) -> float:
    """Variance of the pattern within 3 px of an edge of unit contrast.

    Parameters
    ----------
    blur_px : float
        Gaussian sigma of the edge, with the pixel.
    """
    angle = (np.arange(_DIRECTIONS) + 0.5) * (np.pi / _DIRECTIONS)
    place = (np.arange(_PLACES) + 0.5) / _PLACES * 4.0 - 2.0
    direction, offset = (grid.ravel()[:, None, None] for grid in np.meshgrid(angle, place))
    y, x = np.mgrid[:_SIDE, :_SIDE] - (_SIDE - 1) / 2
    distance = x * np.cos(direction) + y * np.sin(direction) - offset
    clean = ndtr(distance / blur_px)
    rows, columns = np.mgrid[:_SIDE, :_SIDE] % 2
    pattern = np.zeros_like(clean)
    for mine, kernel in (((rows, columns), _RED_BLUE), ((1 - rows, 1 - columns), _RED_BLUE), (None, _GREEN)):
        mask = rows != columns if mine is None else (mine[0] == 0) & (mine[1] == 0)
        share = mask.mean()
        # The difference between the interpolated colour and the mean of all four phases of the cell.
        pattern += convolve(clean * (mask - share), kernel[None], mode="nearest") / 3.0
    inner = np.zeros((_SIDE, _SIDE), dtype=bool)
    inner[2:-2, 2:-2] = True  # beyond, the border of the patch counts
    return float(np.mean(pattern[(np.abs(distance) < _NEAR_PX) & inner] ** 2))
