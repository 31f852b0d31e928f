"""What exports are read back to, in Roundel's units and coordinates, whatever the format's."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ReadMarker:
    """A marker as a format has it; what it does not have is None.

    Lengths are metres; pixels count from the centre of the first.
    """

    marker_id: int | None = None
    pose: Array | None = None
    diameter_m: float | None = None
    category: str | None = None
    full_mask: Mask | None = None
    visible_mask: Mask | None = None
    box_px: Array | None = None
    outline_px: Array | None = None
    keypoints_px: Array | None = None
    facts: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ReadFrame:
    """A frame as a format has it; what it does not have is None, its number, too."""

    frame_id: int | None
    split: str
    k: Array | None = None
    distortion: tuple[float, ...] | None = None
    size_px: tuple[int, int] | None = None
    image: bytes | None = None
    depth_m: Array | None = None
    markers: list[ReadMarker] = field(default_factory=list)


def read_bytes(path: Path) -> bytes:
    """A file of an export.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error


def read_lines(path: Path) -> list[str]:
    """The lines of a file of text.

    Raises
    ------
    DataError
        If it cannot be read, or is no text.
    """
    try:
        return read_bytes(path).decode().splitlines()
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: is no text") from error


def read_json(path: Path, kind: type) -> Any:
    """A file of JSON that must be a list or an object.

    Raises
    ------
    DataError
        If it is not.
    """
    try:
        value = json.loads(read_bytes(path))
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: is no JSON") from error
    if not isinstance(value, kind):
        raise DataError(f"{path}: must be {'an object' if kind is dict else 'a list'}")
    return value


def read_picture(path: Path) -> NDArray[Any]:
    """The pixels of an image file.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    return decoded(read_bytes(path), str(path))


def decoded(data: bytes, place: str) -> NDArray[Any]:
    """The pixels of an image.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(io.BytesIO(data)) as image:
            return np.asarray(image)
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise DataError(f"{place}: is no image") from error
