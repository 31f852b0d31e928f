"""Raw files (DNG and those of the camera makers): demosaiced by LibRaw, in linear light, if `rawpy` is installed.

Nothing but white balance and the camera's colour matrix is applied: no tone curve, no automatic brightness, no
sharpening. Lens corrections that a DNG lists are not applied either.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from roundel.scenes.errors import DataError

_SUFFIXES = {".dng", ".nef", ".nrw", ".cr2", ".cr3", ".arw", ".orf", ".rw2", ".raf", ".pef", ".srw"}
SUFFIXES = tuple(sorted(_SUFFIXES))
_REMEDY = "install rawpy (pip install 'roundel[raw]'), or export it as JPEG or 16-bit TIFF, with its metadata"


def is_raw(path: Path) -> bool:
    """Whether a file is raw, by its suffix: most are TIFFs by their first bytes."""
    return path.suffix.lower() in _SUFFIXES


def decode_raw(data: bytes, most_pixels: int) -> NDArray[Any]:
    """Upright pixels (H, W, 3), uint16, linear, in sRGB's primaries.

    Raises
    ------
    DataError
        If rawpy is not installed, the file is no raw file or corrupt, or it has more than `most_pixels` pixels; without
        the file's name.
    """
    try:
        import rawpy
    except ImportError as error:
        raise DataError(f"raw files need a decoder; {_REMEDY}") from error
    try:
        with rawpy.imread(io.BytesIO(data)) as raw:
            width, height = raw.sizes.width, raw.sizes.height
            if width * height > most_pixels:
                raise DataError(f"{width}x{height} px are more than {most_pixels / 1e6:.0f} megapixels")
            pixels: NDArray[Any] = raw.postprocess(
                gamma=(1, 1), no_auto_bright=True, output_bps=16, use_camera_wb=True, output_color=rawpy.ColorSpace.sRGB
            )
    except DataError:
        raise
    # LibRaw has an exception for each of its error codes.
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise DataError(f"this raw file is not supported, truncated or corrupt ({reason})") from error
    return pixels
