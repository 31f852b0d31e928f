"""Noise that JPEG's quantisation adds to an edge, from the tables in the file.

A JPEG rounds the 64 cosine coefficients of each 8x8 block to multiples of its table. On flat paper all but one of them
are zero and nothing is lost; on an edge they are large, and their errors are patterns across the block that displace
the edge. The variance is therefore that of an edge: straight edges of random position and direction are put
through the table, and the error of the offset that independent noise would cause is compared with the one that the
patterns cause.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn
from scipy.special import ndtr

from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE

Array = NDArray[np.float64]

_BLOCKS = 400  # the variance is then known to 7 %
_DITHER = 0.5  # levels of noise before the rounding: no sensor has less
_NEAR = 3.0  # blurs that an edge's centre may lie outside its block
_FINE = 2.0  # steps of contrast and blur for which it is computed, per factor of 2


def luminance_table(image: Any) -> tuple[int, ...] | None:
    """The 64 steps of an opened JPEG's first table, row by row; None if it is another format or has no table."""
    tables = getattr(image, "quantization", None)
    if not isinstance(tables, dict) or not tables:
        return None
    steps = tuple(int(step) for step in tables[min(tables)])
    return steps if len(steps) == 64 and min(steps) > 0 else None


def read_luminance_table(path: str | Path) -> tuple[int, ...] | None:
    """`luminance_table` of a file; None if it is no JPEG, or cannot be read."""
    from PIL import Image

    if Path(path).suffix.lower() not in (".jpg", ".jpeg"):
        return None
    try:
        with Image.open(path) as image:  # reads the header, decodes nothing
            return luminance_table(image)
    except (OSError, SyntaxError, ValueError):  # whoever decodes the pixels reports what is wrong
        return None


def jpeg_variance(table: tuple[int, ...], contrast: float, blur_px: float) -> float:
    """Variance of a pixel, levels^2, that displaces an edge as much as the rounding of its coefficients does.

    Parameters
    ----------
    table : tuple of 64 int
        See `luminance_table`.
    contrast : float
        Of the edge, in the levels of the file (0 to 255).
    blur_px : float
        Gaussian sigma of the edge's blur, excluding the pixel's aperture.
    """
    if not contrast > 0:
        return 0.0
    # Steps of a factor of 1.4 change the variance by less than it matters, and photographs have many circles.
    coarse = [2.0 ** (round(_FINE * math.log2(v)) / _FINE) for v in (contrast, max(blur_px, 0.25))]
    return _variance(table, *coarse)


@lru_cache(maxsize=256)
def _variance(table: tuple[int, ...], contrast: float, blur_px: float) -> float:
    steps = np.array(table, dtype=np.float64).reshape(8, 8)
    total, slope = _edges(blur_px)
    random = np.random.default_rng(1)
    noise = random.normal(0.0, _DITHER, total.shape)
    clean = contrast * total + random.uniform(0.0, steps[0, 0], (_BLOCKS, 1, 1))
    coefficients = dctn(clean + noise, axes=(1, 2), norm="ortho")
    decoded = idctn(np.rint(coefficients / steps) * steps, axes=(1, 2), norm="ortho")
    pushed = np.sum(slope * (decoded - clean), axis=(1, 2))
    return float(np.sum(pushed**2) / np.sum(slope**2))


@lru_cache(maxsize=32)
def _edges(blur_px: float) -> tuple[Array, Array]:
    """Response (blocks, 8, 8) of straight edges through the blocks, and its slope."""
    random = np.random.default_rng(0)
    sigma = math.sqrt(blur_px**2 + PIXEL_VARIANCE)
    angle = random.uniform(0.0, 2 * np.pi, (_BLOCKS, 1, 1))
    offset = random.uniform(-4.0 - _NEAR * sigma, 4.0 + _NEAR * sigma, (_BLOCKS, 1, 1))
    y, x = np.mgrid[:8, :8] - 3.5
    z = (x * np.cos(angle) + y * np.sin(angle) + offset) / sigma
    return np.asarray(ndtr(z)), np.exp(-0.5 * z * z)
