"""Image files as bytes: PNG or JPEG."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray


def png_bytes(image: NDArray[Any], bits: int) -> bytes:
    """An image (H, W) or (H, W, 3), uint8 or uint16, as PNG.

    If its numbers have fewer bits than the file, the chunk sBIT records how many (PNG specification).
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    chunks = PngInfo()
    if bits < 8 * image.dtype.itemsize:
        chunks.add(b"sBIT", bytes([bits] * (1 if image.ndim == 2 else image.shape[2])))
    sink = io.BytesIO()
    Image.fromarray(image).save(sink, format="PNG", compress_level=1, pnginfo=chunks)
    return sink.getvalue()


def jpeg_bytes(image: NDArray[np.uint8], quality: float) -> bytes:
    """An image (H, W) or (H, W, 3) as baseline JPEG of a quality from 1 to 100; colour is subsampled 4:2:0."""
    from PIL import Image

    sink = io.BytesIO()
    Image.fromarray(image).save(sink, format="JPEG", quality=round(quality), subsampling="4:2:0")
    return sink.getvalue()
