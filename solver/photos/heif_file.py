"""HEIC and HEIF: the container and codec in which iPhones and many other phones save photographs.

Decoded by libheif (package `pi-heif`, which has no encoder: docs/decisions/028-photographs-of-phones.md). Its
transformations, such as a rotation, are applied by the decoder; the orientation tag of the EXIF says the same again,
and is to be ignored (ISO/IEC 23008-12).
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

from roundel.scenes.errors import DataError

if TYPE_CHECKING:
    from PIL.Image import Image

# Brands of the `ftyp` box: HEVC images and sequences. `mif1` and `msf1` say nothing about the codec.
_HEVC_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx"}
_ANY_CODEC = {b"mif1", b"msf1"}
_AVIF_BRANDS = {b"avif", b"avis"}
_REMEDY = "install pi-heif (pip install pi-heif), or export it as JPEG, with its metadata"


def is_heif(data: bytes) -> bool:
    """Whether a file is HEIC or HEIF, not AVIF, by the brands in its first box."""
    if data[4:8] != b"ftyp":
        return False
    length = min(int.from_bytes(data[:4], "big"), 256)
    brands = {data[8:12], *(data[i : i + 4] for i in range(16, length - 3, 4))}
    return bool(brands & _HEVC_BRANDS) or (bool(brands & _ANY_CODEC) and not brands & _AVIF_BRANDS)


def size_of(data: bytes) -> tuple[int, int]:
    """Width and height of the primary image, before it is decoded."""
    width, height = _opened(data).size
    return int(width), int(height)


def decode_heif(data: bytes) -> tuple[Image, int]:
    """The primary image, upright, and the orientation tag (1 to 8) that it had.

    Raises
    ------
    DataError
        If the decoder is not installed.
    """
    image: Image = _opened(data).to_pillow()
    return image, int(image.info.get("original_orientation") or 1)


def _opened(data: bytes) -> Any:
    try:
        import pi_heif
    except ImportError as error:
        raise DataError(f"HEIC images need a decoder; {_REMEDY}") from error
    return pi_heif.open_heif(io.BytesIO(data))
