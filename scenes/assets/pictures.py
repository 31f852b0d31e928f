"""Textures and pictures: PNG and JPEG files, checked by their headers, decoded to linear light by Pillow."""

from __future__ import annotations

import io
import warnings
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.assets.files import IMAGES, MOST_TEXTURE_PX, any_of, digest_of, inside, read_inside, sha256_of
from roundel.scenes.camera.srgb import srgb_to_linear

Array32 = NDArray[np.float32]

MOST_PICTURES = 10_000
_FORMATS = ("PNG", "JPEG")


def open_picture(name: str, data: bytes) -> Any:
    """A Pillow image whose header was read, and whose pixels were not.

    Raises
    ------
    ValueError
        If the bytes are no PNG or JPEG, or the picture is too large.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        # Pillow warns of large pictures; the limit here is smaller and has its own message.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data), formats=_FORMATS)
    except Image.DecompressionBombError as error:
        raise ValueError(f"{name}: too large; at most {MOST_TEXTURE_PX} pixels a side") from error
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise ValueError(f"{name}: is not a PNG or JPEG picture, or is corrupt; get the file again") from error
    if max(image.size) > MOST_TEXTURE_PX:
        raise ValueError(f"{name}: {image.size[0]} x {image.size[1]} pixels; at most {MOST_TEXTURE_PX} a side")
    return image


def decode(name: str, data: bytes) -> NDArray[np.uint8]:
    """Encoded red, green and blue (H, W, 3) of a picture, upright as its EXIF says.

    Raises
    ------
    ValueError
        If it is no picture, too large, truncated or corrupt.
    """
    from PIL import ImageOps

    image = open_picture(name, data)
    try:
        return np.asarray(ImageOps.exif_transpose(image).convert("RGB"))
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        raise ValueError(f"{name}: the picture is truncated or corrupt; get the file again") from error


@lru_cache(maxsize=1)
def _curve() -> Array32:
    return srgb_to_linear(np.arange(256) / 255).astype(np.float32)


def to_linear(encoded: NDArray[np.uint8]) -> Array32:
    """Linear light (...) of sRGB levels (...), 0 to 255."""
    return _curve()[encoded]


def check_decodes(name: str, data: bytes) -> None:
    """Decode a picture at a fraction of its size where the format allows it.

    Raises
    ------
    ValueError
        If it is truncated or corrupt.
    """
    image = open_picture(name, data)
    # A JPEG is read to its end and decoded to an eighth.
    image.draft("RGB", (max(image.width // 8, 1), max(image.height // 8, 1)))
    try:
        image.load()
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        raise ValueError(f"{name}: the picture is truncated or corrupt; get the file again") from error


def pictures_in(folder: Path, name: str) -> list[str]:
    """Names of the pictures in a folder that a study in `folder` names, sorted; folders inside it are not entered.

    Raises
    ------
    ValueError
        If there is no such folder, no picture in it, or too many.
    """
    path = inside(folder, name)
    if not path.is_dir():
        raise ValueError(f"no such folder: {name}; the path is relative to the study")
    found = sorted(p.name for p in path.iterdir() if p.suffix.lower() in IMAGES)
    if not found:
        raise ValueError(f"{name}: holds no picture ({any_of(IMAGES)})")
    if len(found) > MOST_PICTURES:
        raise ValueError(f"{name}: holds {len(found)} pictures; at most {MOST_PICTURES}")
    return found


@lru_cache(maxsize=4)
def names_of(folder: Path, name: str, digest: str) -> list[str]:
    """The sorted names of a folder's pictures; read once for each `folder_digest`."""
    return pictures_in(folder, name)


@lru_cache(maxsize=MOST_PICTURES)
def check_picture(folder: Path, name: str, digest: str) -> None:
    """Check once that a picture decodes, see `check_decodes`."""
    check_decodes(name, read_inside(folder, name))


def folder_digest(folder: Path, name: str) -> tuple[str, int]:
    """Checksum over names and contents of all pictures of a folder, and their number; each header is read.

    Raises
    ------
    ValueError
        If the folder, or a picture in it, cannot be used.
    """
    checksums = {}
    for picture in pictures_in(folder, name):
        data = read_inside(folder, f"{name}/{picture}")
        open_picture(f"{name}/{picture}", data)
        checksums[picture] = sha256_of(data)
    return digest_of(checksums), len(checksums)
