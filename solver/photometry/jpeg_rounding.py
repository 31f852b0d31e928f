"""What JPEG's quantisation does to an edge: noise, and a displacement, from the tables in the file.

A JPEG rounds the 64 cosine coefficients of each 8x8 block to multiples of its table. On flat paper all but one of them
are zero and nothing is lost; on an edge they are large, and their errors are patterns across the block. Beside this
noise the small coefficients of high frequencies become zero: the edge is smoothed, in encoded levels. Once the curve is
undone, a smoothed edge is no longer symmetric, and a fit finds it displaced, all around the contour.

Both are computed: straight edges of random position and direction, between the levels and with the blur of the one in
question, are put through the curve and the table, and what comes out is fitted by shift, levels and blur.
"""

from __future__ import annotations

import io
import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.response_curve import ResponseCurve
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE

Array = NDArray[np.float64]

_BLOCKS = 800  # the variance is then known to 5 %, the displacement to 0.001 px
_DITHER = 0.5  # levels of noise before the rounding: no sensor has less
_NEAR = 3.0  # blurs that an edge's centre may lie outside its block
_COARSE = 8.0  # steps of the levels for which an edge is computed
_FINE, _LEAST_BLUR_PX = 3.0, 0.1  # steps of its blur per factor of 2, and the least blur


def luminance_table(image: Any) -> tuple[int, ...] | None:
    """The 64 steps of an opened JPEG's first table, row by row; None if it is another format or has no table."""
    tables = getattr(image, "quantization", None)
    if not isinstance(tables, dict) or not tables:
        return None
    steps = tuple(int(step) for step in tables[min(tables)])
    return steps if len(steps) == 64 and min(steps) > 0 else None


def read_luminance_table(data: bytes) -> tuple[int, ...] | None:
    """`luminance_table` of the bytes of a file; None if it is no JPEG, or cannot be read."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data)) as image:  # reads the header, decodes nothing
            return luminance_table(image)
    except (OSError, SyntaxError, ValueError):  # whoever decodes the pixels reports what is wrong
        return None


class JpegEdge(NamedTuple):
    """Effect of a table on an edge.

    Attributes
    ----------
    variance : float
        Variance of a pixel, in levels^2, that displaces an edge as much as the patterns in a block do.
    displacement_px : float
        Mean displacement of the edge toward the outside.
    """

    variance: float
    displacement_px: float


def jpeg_edge(table: tuple[int, ...], curve: ResponseCurve, inside: float, outside: float, blur_px: float) -> JpegEdge:
    """Noise and displacement of an edge in a JPEG.

    Parameters
    ----------
    table : tuple of 64 int
        See `luminance_table`.
    curve : ResponseCurve
        Of the levels.
    inside, outside : float
        Levels on both sides, in the file's range of 0 to 255.
    blur_px : float
        Gaussian sigma of the edge's blur, excluding the pixel's aperture.
    """
    # Photographs have many circles with nearly the same levels and blur.
    low, high = (_COARSE * round(min(max(v, 0.0), 255.0) / _COARSE) for v in (inside, outside))
    if low == high:
        return JpegEdge(0.0, 0.0)
    blur = 2.0 ** (round(_FINE * math.log2(max(blur_px, _LEAST_BLUR_PX))) / _FINE)
    return _edge(table, curve.because(""), low, high, blur)


@lru_cache(maxsize=512)
def _edge(table: tuple[int, ...], curve: ResponseCurve, low: float, high: float, blur_px: float) -> JpegEdge:
    from scipy.fft import dctn, idctn

    steps = np.array(table, dtype=np.float64).reshape(8, 8)
    z, share, slope, noise = _edges(blur_px)
    dark, bright = (float(v) for v in curve.light(np.array([low, high]) / 255.0))
    light = dark + (bright - dark) * share
    clean = 255.0 * curve.level(light)
    coefficients = dctn(clean + noise - 128.0, axes=(1, 2), norm="ortho")
    decoded = idctn(np.rint(coefficients / steps) * steps, axes=(1, 2), norm="ortho") + 128.0
    decoded = np.clip(np.rint(decoded), 0.0, 255.0)
    pushed = np.sum(slope * (decoded - clean), axis=(1, 2))
    variance = float(np.sum(pushed**2) / np.sum(slope**2))
    # The fit's weights are those of a noise that is the same for all encoded levels; it fits levels and blur as well.
    gain = [float(np.diff(curve.light(np.array([v - 0.5, v + 0.5]) / 255.0))[0]) for v in (low, high)]
    weight = 1.0 / (gain[0] ** 2 + (gain[1] ** 2 - gain[0] ** 2) * share)
    design = np.stack([v.ravel() for v in (slope, z * slope, 1.0 - share, share)], axis=1)
    error = (curve.light(decoded / 255.0) - light) / (bright - dark)
    weighted = design * weight.reshape(-1, 1)
    shift = np.linalg.solve(design.T @ weighted, weighted.T @ error.ravel())[0]
    return JpegEdge(variance, -float(shift))


@lru_cache(maxsize=32)
def _edges(blur_px: float) -> tuple[Array, Array, Array, Array]:
    """Straight edges through blocks (n, 8, 8): distance in sigmas, response, its slope per px, and some noise."""
    from scipy.special import ndtr

    random = np.random.default_rng(0)
    sigma = math.sqrt(blur_px**2 + PIXEL_VARIANCE)
    angle = random.uniform(0.0, 2 * np.pi, (_BLOCKS, 1, 1))
    offset = random.uniform(-4.0 - _NEAR * sigma, 4.0 + _NEAR * sigma, (_BLOCKS, 1, 1))
    y, x = np.mgrid[:8, :8] - 3.5
    z = (x * np.cos(angle) + y * np.sin(angle) + offset) / sigma
    slope = np.exp(-0.5 * z * z) / (math.sqrt(2 * math.pi) * sigma)
    return z, np.asarray(ndtr(z)), slope, random.normal(0.0, _DITHER, z.shape)
