"""Thumbnails: an image of any depth as a small JPEG of 8 bits."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

LONG_SIDE_PX = 240
_QUALITY = 90


def thumbnail(image: NDArray[Any], top_dn: float | None) -> bytes:
    """The JPEG of a thumbnail, at most `LONG_SIDE_PX` along its longer side; a smaller image keeps its size.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        uint8 or uint16; channels beyond the third are left out.
    top_dn : float or None
        The level that is shown as white, for 16 bits; None: the largest number.
    """
    from PIL import Image

    pixels = image[..., :3] if image.ndim == 3 else image
    if pixels.dtype != np.uint8:
        # By the converter's range and not by the image's own, so that a dark frame looks dark.
        levels = np.arange(np.iinfo(pixels.dtype).max + 1)
        pixels = np.rint(255 * np.minimum(levels / (top_dn or levels[-1]), 1)).astype(np.uint8)[pixels]
    picture = Image.fromarray(np.ascontiguousarray(pixels))
    scale = LONG_SIDE_PX / max(picture.size)
    if scale < 1:
        size = (max(1, round(picture.width * scale)), max(1, round(picture.height * scale)))
        # The mean of the pixels that it covers, like a camera with larger pixels: no ringing at the edges of the ink.
        picture = picture.resize(size, Image.Resampling.BOX)
    sink = io.BytesIO()
    picture.save(sink, format="JPEG", quality=_QUALITY)
    return sink.getvalue()
