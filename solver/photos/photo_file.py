"""Read a photograph: upright, grey, in linear light, with its EXIF tags.

Edges are located in linear light. In encoded values the midpoint of an edge is displaced, and measured circles
would be some tenths of a pixel too large or too small, so the curve is undone: the one that is given, else the one that
the file declares, else sRGB for integers and none for real numbers.
"""

from __future__ import annotations

import io
import logging
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.response_curve import LINEAR, SRGB, ResponseCurve
from roundel.scenes.camera.srgb import linear_to_srgb
from roundel.scenes.errors import DataError
from roundel.solver.intrinsics.exif import ExifTags, read_exif, read_tiff_exif
from roundel.solver.photometry.image_levels import averaged_rounding, grey_levels
from roundel.solver.photometry.jpeg_rounding import luminance_table
from roundel.solver.photometry.photometry import Photometry, level_step
from roundel.solver.photos.file_curve import declared_curve
from roundel.solver.photos.heif_file import decode_heif, is_heif, size_of
from roundel.solver.photos.raw_file import decode_raw, is_raw

if TYPE_CHECKING:
    from PIL.Image import Image

# The largest phones have 200 megapixels. Without a limit, a file of a few kB can exhaust the memory.
MAX_PIXELS = 256_000_000

# Formats whose readers only decode pixels: no PostScript, no layers, no documents.
_FORMATS = ("JPEG", "MPO", "PNG", "TIFF", "WEBP", "BMP", "GIF", "PPM", "JPEG2000", "AVIF")
_DNG_VERSION = 50706
_BITS_PER_SAMPLE = 258

# Rec. 709 luminance, dominated by green: cameras sample it twice as densely, and lateral colour shifts red and blue.
LUMINANCE = (0.2126, 0.7152, 0.0722)

# Pillow's limit for huge images is a global variable.
_PILLOW = threading.Lock()


@dataclass(frozen=True, eq=False)
class Photo:
    """A photograph, upright.

    Attributes
    ----------
    grey : (H, W) float32 array
        Luminance, linear in light if the curve is known, 0 to `saturation_dn`.
    saturation_dn : float
        The level at which pixels saturate, in the file's range (255, 65,535, or 1 for real numbers).
    picture : (H, W, 3) uint8 array
        RGB for display.
    exif : ExifTags
    levels : (H, W) or (H, W, 3) array
        As in the file, opaque.
    photometry : Photometry
        The curve that was undone, and the rounding of the levels.
    """

    grey: NDArray[np.float32]
    saturation_dn: float
    picture: NDArray[np.uint8]
    exif: ExifTags
    levels: NDArray[Any]
    photometry: Photometry

    def grey_by(self, curve: ResponseCurve) -> tuple[NDArray[np.float32], float]:
        """Luminance (H, W) with another curve undone, and its saturation level."""
        return grey_levels(self.levels, curve, self.saturation_dn, LUMINANCE)[0], self.saturation_dn

    @property
    def width_px(self) -> int:
        """Width of the upright image."""
        return int(self.grey.shape[1])

    @property
    def height_px(self) -> int:
        """Height of the upright image."""
        return int(self.grey.shape[0])


def read_photo(path: str | Path, curve: ResponseCurve | None = None, page: int = 0) -> Photo:
    """Read a photograph: JPEG, HEIC, AVIF, PNG, TIFF, WebP, JPEG 2000, BMP, GIF, PPM; raw files if rawpy is installed.

    8 or 16 bits, or real numbers.

    Parameters
    ----------
    path : path
    curve : ResponseCurve, optional
        The curve to undo: `linear` for most machine-vision cameras. Default: the one that the file declares (ICC
        profile, PNG's gAMA); without one, integers are sRGB-encoded (IEC 61966-2-1) and real numbers are linear. Raw
        files are linear.
    page : int
        Of a TIFF, from 0; see `photo_inputs.pages_of`.

    Returns
    -------
    Photo

    Raises
    ------
    DataError
        If the file is missing, not an image, truncated, or has more than `MAX_PIXELS` pixels; one line with its name.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        what = "it is a folder, not a photograph" if path.is_dir() else error.strerror or type(error).__name__
        raise DataError(f"{path}: cannot read: {what}") from error
    if not data:
        raise DataError(f"{path}: this file is empty")
    if is_raw(path):
        decoded = _decode_raw(path, data)
    else:
        decoded = _decode_heif(path, data) if is_heif(data) else _decode(path, data, page)
    try:
        return _photo(decoded, curve)
    except ValueError as error:
        raise DataError(f"{path}: {error}") from error


@dataclass(frozen=True, eq=False)
class _Decoded:
    """Upright pixels (H, W) or (H, W, C), the tags, the declared curve, and a JPEG's table."""

    pixels: NDArray[Any]
    exif: ExifTags
    curve: ResponseCurve | None
    jpeg: tuple[int, ...] | None


def _decode_raw(path: Path, data: bytes) -> _Decoded:
    try:
        pixels = decode_raw(data, MAX_PIXELS)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    return _Decoded(pixels, _raw_exif(data), LINEAR.because("raw files are linear"), None)


def _raw_exif(data: bytes) -> ExifTags:
    """Tags of a raw file; most are TIFFs whose first directory has those of the camera."""
    # Its size is that of the preview or of the sensor with its margins: it does not tell whether it was cropped.
    return replace(read_tiff_exif(data), width_px=None, height_px=None)


def _decode_heif(path: Path, data: bytes) -> _Decoded:
    with _quiet_and_large():
        try:
            _check_size(path, *size_of(data))
            image, orientation = decode_heif(data)
            exif = replace(read_exif(image), orientation=orientation)
            return _Decoded(_array(image), exif, declared_curve(image.info), None)
        except DataError as error:
            raise DataError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error
        # libheif's errors are of many types: ValueError, RuntimeError, EOFError, SyntaxError...
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise DataError(f"{path}: this image is truncated or corrupt ({reason})") from error


def _check_size(path: Path, width_px: int, height_px: int) -> None:
    count = width_px * height_px
    if count > MAX_PIXELS:
        raise DataError(
            f"{path}: {width_px}x{height_px} px are {count / 1e6:.0f} megapixels; the limit is "
            f"{MAX_PIXELS / 1e6:.0f}; reduce the image"
        )


def _decode(path: Path, data: bytes, page: int) -> _Decoded:
    from PIL import Image, UnidentifiedImageError

    with _quiet_and_large():
        try:
            Image.init()
            formats = [name for name in _FORMATS if name in Image.OPEN]
            with Image.open(io.BytesIO(data), formats=formats) as image:
                if image.format == "TIFF" and page:
                    image.seek(page)
                _check_size(path, image.width, image.height)
                if image.format == "TIFF" and _DNG_VERSION in getattr(image, "tag_v2", {}):
                    raise DataError(f"{path}: a raw file; name it .dng")
                deep = _is_deep_colour(image)
                image.load()
                # After loading, because Pillow turns TIFFs upright itself and then removes the tag.
                exif = read_exif(image)
                pixels = _upright(_array(image), exif.orientation)
                # A profile of other primaries than RGB or grey does not describe the converted pixels.
                declared = declared_curve(image.info) if image.mode not in ("CMYK", "YCbCr", "LAB", "HSV") else None
                jpeg = luminance_table(image)
        except DataError:
            raise
        except UnidentifiedImageError as error:
            raise DataError(f"{path}: not an image, or truncated; JPEG, HEIC, PNG and TIFF are supported") from error
        # Damaged files make its readers raise many types: OSError, SyntaxError, ValueError, struct.error...
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise DataError(f"{path}: this image is truncated or corrupt ({reason})") from error
    if deep:
        pixels = _deep_colour(data, pixels, exif.orientation, page)
    return _Decoded(pixels, exif, declared, jpeg)


@contextmanager
def _quiet_and_large() -> Iterator[None]:
    """Disable Pillow's warnings on stderr and its size limit; `MAX_PIXELS` replaces it."""
    from PIL import Image

    with _PILLOW, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logger = logging.getLogger("PIL")
        limit, level = Image.MAX_IMAGE_PIXELS, logger.level
        Image.MAX_IMAGE_PIXELS = None
        logger.setLevel(logging.CRITICAL)
        try:
            yield
        finally:
            Image.MAX_IMAGE_PIXELS = limit
            logger.setLevel(level)


def _is_deep_colour(image: Image) -> bool:
    """Whether this is 16-bit colour, of which Pillow returns only the upper 8 bits."""
    if image.mode not in ("RGB", "RGBA", "LA"):
        return False
    if image.format == "TIFF":
        return bool(max(getattr(image, "tag_v2", {}).get(_BITS_PER_SAMPLE, (8,))) == 16)
    return any(";16" in str(tile) for tile in getattr(image, "tile", []))


def _deep_colour(data: bytes, shallow: NDArray[Any], orientation: int, page: int) -> NDArray[Any]:
    """All 16 bits of colour, read by OpenCV; Pillow's pixels are kept if the two images differ."""
    import cv2

    deep: NDArray[Any] | None
    buffer = np.frombuffer(data, dtype=np.uint8)
    try:
        if page:
            _, pages = cv2.imdecodemulti(buffer, cv2.IMREAD_UNCHANGED, range=(page, page + 1))
            deep = pages[0] if pages else None
        else:
            deep = cv2.imdecode(buffer, cv2.IMREAD_UNCHANGED)
    except (cv2.error, TypeError):
        return shallow
    if deep is None or deep.dtype != np.uint16 or deep.ndim != 3:
        return shallow
    deep = deep[..., [2, 1, 0, 3][: deep.shape[2]]]
    # OpenCV turns TIFFs upright but not PNGs, so the orientation that matches Pillow's pixels is used.
    for candidate in (deep, _upright(deep, orientation)):
        if candidate.shape[:2] == shallow.shape[:2]:
            colours = min(candidate.shape[2], shallow.shape[2], 3)
            difference = candidate[..., :colours] // 256 - shallow[..., :colours].astype(np.int32)
            if np.max(np.abs(difference), initial=0) <= 1:
                return np.ascontiguousarray(candidate)
    return shallow


def _array(image: Image) -> NDArray[Any]:
    """Pixels as stored; palettes and other colour spaces become RGB, transparency the last channel."""
    mode = image.mode
    if mode == "1":
        return np.asarray(image).astype(np.uint8) * np.uint8(255)
    if mode in ("L", "RGB", "RGBA", "F", "I") or mode.startswith("I;16"):
        if "transparency" in image.info and mode in ("L", "RGB"):
            return np.asarray(image.convert("RGBA"))
        return np.asarray(image)
    transparent = mode in ("LA", "La", "PA", "RGBa") or "transparency" in image.info
    return np.asarray(image.convert("RGBA" if transparent else "RGB"))


def _upright(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Undo the orientation tag: 2 mirrored, 3 upside down, 6 to rotate clockwise, 8 anticlockwise, and mirrored."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return np.ascontiguousarray(pixels)


def as_stored(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Upright pixels (H, W[, C]) as the file stores them: the inverse of what the orientation tag asks for.

    All photographs of a camera are alike as they are stored, however it was held: they share one K.
    """
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    return np.ascontiguousarray(pixels)


def _photo(decoded: _Decoded, curve: ResponseCurve | None) -> Photo:
    pixels = decoded.pixels
    if pixels.size == 0:
        raise ValueError("this image has no pixels")
    if np.issubdtype(pixels.dtype, np.floating):
        if not np.all(np.isfinite(pixels)):
            raise ValueError("this image has values that are not finite")
        # Some files have values like 1e38, or negative ones; their squares would overflow.
        levels: NDArray[Any] = np.clip(pixels / max(1.0, float(np.max(pixels))), 0.0, 1.0)
        used = curve or LINEAR.because("real numbers are taken as linear")
        shown = _encoded(used.light(levels))
    else:
        levels = _on_white(_sixteen_bits(pixels))
        used = curve or decoded.curve or SRGB.because("photographs are sRGB unless their file says otherwise")
        shown = levels if levels.dtype == np.uint8 else (levels >> 8).astype(np.uint8)
    top = 1.0 if levels.dtype.kind == "f" else float(np.iinfo(levels.dtype).max)
    picture = np.repeat(shown[..., None], 3, axis=2) if shown.ndim == 2 else shown
    rounding = level_step(levels, top), averaged_rounding(levels, LUMINANCE)
    photometry = Photometry(used, top, *rounding, decoded.jpeg)
    grey = grey_levels(levels, used, top, LUMINANCE)[0]
    return Photo(grey, top, np.ascontiguousarray(picture), decoded.exif, levels, photometry)


def _sixteen_bits(pixels: NDArray[Any]) -> NDArray[Any]:
    """32-bit integers, usually with 16-bit values, as such."""
    if pixels.dtype.itemsize < 4:
        return pixels
    low, high = int(pixels.min()), int(pixels.max())
    if low < 0 or high > 65_535:
        raise ValueError(f"this image has integers from {low} to {high}; 0 to 65535 are supported")
    return pixels.astype(np.uint16)


def _encoded(light: NDArray[Any]) -> NDArray[np.uint8]:
    return np.asarray(np.rint(255 * linear_to_srgb(light)), dtype=np.uint8)


def _on_white(pixels: NDArray[Any]) -> NDArray[Any]:
    """Transparent pixels composited on white, as viewers show them; the alpha channel is dropped."""
    if pixels.ndim == 2 or pixels.shape[2] == 3:
        return pixels
    colour, alpha, top = pixels[..., :3], pixels[..., 3:], np.iinfo(pixels.dtype).max
    if alpha.min() == top:
        return np.ascontiguousarray(colour)
    share = alpha.astype(np.float32) / top
    return np.asarray(np.rint(colour * share + top * (1 - share)), dtype=pixels.dtype)
