"""A contact sheet: some frames of a dataset as small pictures in the page."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset

FRAMES = 12
_SIDE_PX = 240


def sheet_of(dataset: Dataset) -> list[dict[str, Any]]:
    """Up to `FRAMES` frames with images, evenly over the dataset: frame_id, group, the picture as a data URL."""
    count = len(dataset)
    places = sorted({round(i * (count - 1) / max(1, min(FRAMES, count) - 1)) for i in range(min(FRAMES, count))})
    images = dataset.images
    return [
        {
            "frame_id": int(images.records[i]["frame_id"]),
            "group": str(images.records[i]["group"]),
            "picture": _data_url(thumbnail(images.image(i), significant_bits(images.records[i]))),
        }
        for i in places
        if images.mode(i) == "images"
    ]


def significant_bits(record: dict[str, Any]) -> int:
    """Bits of an image file that its levels fill."""
    sensor = record.get("sensor") or {}
    return int(sensor.get("bits", 8)) + int(sensor.get("stored_shift", 0))


def thumbnail(image: NDArray[Any], bits: int) -> bytes:
    """A small JPEG of an image of 8 or 16 bits, with the image's own levels."""
    from PIL import Image

    # The brightest level of a deep image is white.
    levels = image if image.dtype == np.uint8 else (image >> max(0, bits - 8)).clip(0, 255).astype(np.uint8)
    picture = Image.fromarray(levels)
    picture.thumbnail((_SIDE_PX, _SIDE_PX), Image.Resampling.BOX)
    sink = io.BytesIO()
    picture.save(sink, format="JPEG", quality=80)
    return sink.getvalue()


def _data_url(data: bytes) -> str:
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"
