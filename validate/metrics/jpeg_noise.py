"""Noise that JPEG compression adds at an edge, from the quantisation table of the file.

Each coefficient of an 8x8 block's cosine transform is rounded to a multiple of its step. Where the step is finer than
the noise, the error is uniform, of variance step^2 / 12; where it is coarser, most coefficients become zero and the
error depends on the edge. It is therefore measured, on edges of the same contrast, blur and noise at many places in a
block.
"""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn
from scipy.special import ndtr

Array = NDArray[np.float64]

_SIDE = 8
# Directions and places of the edge in the block, and the distance within which its pixels are judged.
_DIRECTIONS, _PLACES, _NEAR_PX = 24, 12, 3.0
_SEED = 8  # of the noise in the blocks: the same for every file


def luma_table(data: bytes) -> Array | None:
    """Quantisation steps (8, 8) of the brightness, from the bytes of a JPEG file; None if it is not one."""
    from PIL import Image

    with Image.open(io.BytesIO(data)) as image:
        # Only a JPEG has tables; the first is that of the brightness, in the order of rows.
        tables: dict[int, list[int]] = getattr(image, "quantization", {})
    return np.array(tables[0], dtype=np.float64).reshape(_SIDE, _SIDE) if tables else None


def jpeg_variance_dn2(
    table: Array, levels_dn: tuple[float, float], noise_dn: tuple[float, float], blur_px: float
) -> float:
    """Variance, DN^2 of the file, that rounding the coefficients adds to the noise of pixels near an edge.

    Parameters
    ----------
    table : (8, 8) array
        Quantisation steps; the transform is orthonormal, as JPEG's.
    levels_dn, noise_dn : (float, float)
        Level and noise on either side, in the encoded numbers of the file.
    blur_px : float
        Gaussian sigma of the edge, with the pixel.

    Returns
    -------
    float
        Mean squared difference between decoded and noiseless pixels within 3 px of the edge, minus the noise that was
        there before; at least 0, because compression adds no information.
    """
    angle = (np.arange(_DIRECTIONS) + 0.5) * (np.pi / _DIRECTIONS)
    place = ((np.arange(_PLACES) + 0.5) / _PLACES - 0.5) * _SIDE
    direction, offset = (grid.ravel()[:, None, None] for grid in np.meshgrid(angle, place))
    y, x = np.mgrid[:_SIDE, :_SIDE] - (_SIDE - 1) / 2
    distance = x * np.cos(direction) + y * np.sin(direction) - offset
    step = ndtr(distance / blur_px)
    clean = levels_dn[0] + (levels_dn[1] - levels_dn[0]) * step
    variance = noise_dn[0] ** 2 + (noise_dn[1] ** 2 - noise_dn[0] ** 2) * step
    noisy = clean + np.sqrt(variance) * np.random.default_rng(_SEED).standard_normal(clean.shape)
    coefficients = dctn(noisy - 128.0, axes=(1, 2), norm="ortho")
    decoded = idctn(np.rint(coefficients / table) * table, axes=(1, 2), norm="ortho") + 128.0
    near = np.abs(distance) < _NEAR_PX
    return max(0.0, float(np.mean((decoded - clean)[near] ** 2) - np.mean((noisy - clean)[near] ** 2)))
