"""Focal length and its uncertainty from a photograph's EXIF.

Cameras write wrong tags, editors leave outdated tags, and files are truncated. Nothing here raises: a value that is not
credible is returned as a falsy value with its reason.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from roundel.scenes.camera.film import FILM_DIAGONAL_MM

if TYPE_CHECKING:
    from PIL.Image import Exif, Image


# Difference between the nominal focal length and that of a photograph: focus alone lengthens a 5 mm lens by 1.7 % at
# 0.3 m (v = f u / (u - f)); stabilisation and in-camera correction crop by a similar amount. OpenSfM uses 1 % (its
# `exif_focal_sd`), but a single photograph has no others that would correct it.
MODELLING_SIGMA = 0.02
ROUNDING_SIGMA_MM = 1.0 / math.sqrt(12.0)  # the 35-mm tag has whole millimetres

_EXIF_IFD = 0x8769
_ORIENTATION, _MAKE = 0x0112, 0x010F
_FOCAL_MM, _FOCAL_35MM, _DIGITAL_ZOOM = 0x920A, 0xA405, 0xA404
_WIDTH, _HEIGHT = 0xA002, 0xA003
_PLANE_RESOLUTION, _PLANE_UNIT = 0xA20E, 0xA210
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}  # inch, cm, mm, um; inch if unspecified

FOCAL_35MM_RANGE = (4.0, 3000.0)  # from fisheye lenses to the longest telescopes
# Crop factor (diagonal of 35-mm film over that of the sensor): from an 8x10-inch plate (0.13) to a sensor of 3 mm.
_CROP_FACTOR_RANGE = (0.12, 15.0)
_ZOOM_RANGE = (1.02, 200.0)  # a smaller value means no zoom
_SQUAREST_CROPPED = 1.55  # slightly above 3:2: wider images are usually cropped from a 4:3 or 3:2 sensor


@dataclass(frozen=True)
class ExifTags:
    """The relevant tags; None if one is missing or not a positive number.

    Attributes
    ----------
    focal_35mm_mm, focal_mm : float or None
    plane_px_per_mm : float or None
        Pixels per millimetre of the sensor, along x.
    digital_zoom : float
        1 for none.
    width_px, height_px : int or None
        Of the image that the camera wrote, before it was rotated, cropped or resized.
    make : str
    orientation : int
        1 to 8; 1 if it is missing or invalid.
    problem : str
        Why there are no tags, as one clause; empty if there are any.
    """

    focal_35mm_mm: float | None = None
    focal_mm: float | None = None
    plane_px_per_mm: float | None = None
    digital_zoom: float = 1.0
    width_px: int | None = None
    height_px: int | None = None
    make: str = ""
    orientation: int = 1
    problem: str = ""


@dataclass(frozen=True)
class ExifFocal:
    """A focal length of a photograph.

    Attributes
    ----------
    focal_px : float
        In pixels of the image as stored.
    sigma : float
        Standard deviation as a fraction of it.
    basis : str
        Description for the user.
    """

    focal_px: float
    sigma: float
    basis: str


@dataclass(frozen=True)
class NoFocal:
    """No credible focal length: falsy, with its reason."""

    reason: str

    def __bool__(self) -> bool:
        return False


def read_exif(image: Image) -> ExifTags:
    """Tags of an image that Pillow has opened; never raises, whatever the tags contain."""
    return _read(image.getexif)


def read_tiff_exif(data: bytes) -> ExifTags:
    """Tags of a file with the structure of a TIFF that Pillow cannot open, such as a DNG; never raises."""
    from PIL.Image import Exif

    def load() -> Exif:
        found = Exif()
        found.load(data)
        return found

    return _read(load)


def _read(load: Callable[[], Exif]) -> ExifTags:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow warns of corrupt blocks; `problem` reports them
        try:
            top = load()
            if not len(top):
                return ExifTags(problem="the file has no EXIF")
            # The EXIF directory has the focal length; some writers put its tags into the first directory.
            inner: dict[int, Any] = {**dict(top), **dict(top.get_ifd(_EXIF_IFD))}
        # Corrupt blocks make Pillow raise many types: struct.error, KeyError, OSError, TypeError, SyntaxError...
        except Exception as error:
            return ExifTags(problem=f"its EXIF is corrupt ({type(error).__name__})")
    return _tags(inner)


def _tags(values: dict[int, Any]) -> ExifTags:
    resolution, unit = _number(values.get(_PLANE_RESOLUTION)), _number(values.get(_PLANE_UNIT, 2))
    unit_mm = _UNIT_MM.get(int(unit)) if unit is not None and unit < 10 else None
    zoom = _number(values.get(_DIGITAL_ZOOM)) or 1.0
    width, height = _number(values.get(_WIDTH)), _number(values.get(_HEIGHT))
    orientation = _number(values.get(_ORIENTATION))
    make = values.get(_MAKE)
    return ExifTags(
        focal_35mm_mm=_number(values.get(_FOCAL_35MM)),
        focal_mm=_number(values.get(_FOCAL_MM)),
        plane_px_per_mm=None if resolution is None or unit_mm is None else resolution / unit_mm,
        digital_zoom=zoom if _ZOOM_RANGE[0] <= zoom <= _ZOOM_RANGE[1] else 1.0,
        width_px=_pixels(width),
        height_px=_pixels(height),
        make=make.strip("\0 ") if isinstance(make, str) else "",
        orientation=int(orientation) if orientation is not None and orientation in range(1, 9) else 1,
    )


def _pixels(number: float | None) -> int | None:
    """Whole pixels, at least one: a rational of 1/4 is a number but not a width."""
    return None if number is None or round(number) < 1 else round(number)


def _number(value: Any) -> float | None:
    """A finite positive number below 1e9, or None: rationals with a zero denominator are NaN or raise."""
    if isinstance(value, (tuple, list)) and len(value) == 1:
        value = value[0]
    if isinstance(value, (str, bytes, tuple, list, dict)) or value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError, ArithmeticError):
        return None
    return number if math.isfinite(number) and 0.0 < number < 1e9 else None


def focal_of_exif(tags: ExifTags, width_px: int, height_px: int) -> ExifFocal | NoFocal:
    """Focal length of a photograph in its own pixels, with its standard deviation.

    The 35-mm equivalent means an equal diagonal angle of view (CIPA DCG-001; errata, section 4). Its standard deviation
    combines the rounding to whole millimetres, a modelling error of 2 % and, for images wider than 3:2, the uncertainty
    whether it refers to the image or to the 4:3 sensor from which the image was cropped. If a focal length in
    millimetres and the resolution of the focal plane agree with it to 5 %, they are used for their finer digits.

    Digital zoom: some cameras include it in the 35-mm equivalent (Apple's do), some do not, and no tag tells which. The
    sensor size implied by each interpretation may decide; otherwise the mean is used, with a standard deviation that
    covers both.

    Parameters
    ----------
    tags : ExifTags
    width_px, height_px : int
        Size of the image, in either orientation.
    """
    if tags.problem:
        return NoFocal(tags.problem)
    long_px, short_px = max(width_px, height_px), min(width_px, height_px)
    cut = _cut(tags, long_px, short_px)
    if cut:
        return NoFocal(cut)
    plane_px = _focal_by_plane_px(tags, long_px)
    equivalent = _focal_by_equivalent(tags, long_px, short_px)
    if isinstance(equivalent, NoFocal):
        if plane_px is None:
            return equivalent
    elif plane_px is None or abs(math.log(plane_px / equivalent.focal_px)) > 0.05:
        return equivalent
    zoom = f" and digital zoom {tags.digital_zoom:g}" if tags.digital_zoom > 1 else ""
    basis = f"EXIF: {tags.focal_mm:g} mm with the sensor's resolution{zoom}, +- {100 * MODELLING_SIGMA:.1f} %"
    return ExifFocal(plane_px, MODELLING_SIGMA, basis)


def _cut(tags: ExifTags, long_px: int, short_px: int) -> str:
    """Whether the image was cropped after the camera wrote it, as one clause; resizing does not matter."""
    if tags.width_px is None or tags.height_px is None:
        return ""
    was = max(tags.width_px, tags.height_px) / min(tags.width_px, tags.height_px)
    if abs(math.log(was * short_px / long_px)) <= 0.02:  # rounding by a pixel in the smallest thumbnails
        return ""
    return f"the image was cut after its EXIF was written ({tags.width_px}x{tags.height_px} px then)"


def _focal_by_equivalent(tags: ExifTags, long_px: int, short_px: int) -> ExifFocal | NoFocal:
    stated, zoom = tags.focal_35mm_mm, tags.digital_zoom
    if stated is None:
        return NoFocal("its EXIF has no 35-mm equivalent focal length")
    if not FOCAL_35MM_RANGE[0] <= stated <= FOCAL_35MM_RANGE[1]:
        return NoFocal(f"its EXIF has an absurd 35-mm equivalent focal length, {stated:g} mm")
    # For each interpretation of the zoom: the equivalent focal length, and the one without zoom, for the sensor size.
    readings = [(stated, stated / zoom)]
    if zoom > 1 and tags.make.lower() != "apple":
        readings.append((stated * zoom, stated))
    if tags.focal_mm is not None:
        low, high = _CROP_FACTOR_RANGE
        readings = [r for r in readings if low <= r[1] / tags.focal_mm <= high]
        if not readings:
            diagonal_mm = FILM_DIAGONAL_MM * tags.focal_mm / stated
            return NoFocal(
                f"its EXIF contradicts itself: {tags.focal_mm:g} mm and a 35-mm equivalent of {stated:g} mm would "
                f"mean a sensor of {diagonal_mm:.2g} mm"
            )
    logs = [math.log(equivalent) for equivalent, _ in readings]
    focal_35mm_mm, doubt = math.exp(sum(logs) / len(logs)), (max(logs) - min(logs)) / 2
    if doubt > 0.5:  # too uncertain for a normal distribution of a positive number
        return NoFocal(f"its EXIF has digital zoom {zoom:g}, which the {stated:g} mm stated may or may not include")
    diagonal_px = math.hypot(long_px, short_px)
    crop_doubt = math.log(1.25 * long_px / diagonal_px) / 2 if long_px > _SQUAREST_CROPPED * short_px else 0.0
    sigma = math.sqrt((ROUNDING_SIGMA_MM / stated) ** 2 + MODELLING_SIGMA**2 + doubt**2 + crop_doubt**2)
    basis = f"EXIF: {focal_35mm_mm:.4g} mm (35-mm equivalent, by diagonal), +- {100 * sigma:.1f} %"
    if doubt > 0:
        basis += f"; it has digital zoom {zoom:g}, which the {stated:g} mm stated may or may not include"
    elif crop_doubt > 0:
        basis += "; the image may be cut from a sensor of another shape"
    return ExifFocal(focal_35mm_mm * diagonal_px / FILM_DIAGONAL_MM, sigma, basis)


def _focal_by_plane_px(tags: ExifTags, long_px: int) -> float | None:
    if tags.focal_mm is None or tags.plane_px_per_mm is None:
        return None
    written_px = max(tags.width_px, tags.height_px) if tags.width_px and tags.height_px else long_px
    sensor_mm = written_px / tags.plane_px_per_mm
    # Some cameras write a wrong unit: implausible sensor sizes are rejected.
    if not 2.0 <= sensor_mm <= 300.0:
        return None
    focal_px = tags.focal_mm * tags.plane_px_per_mm * tags.digital_zoom * long_px / written_px
    low, high = (f * long_px / 36.0 for f in FOCAL_35MM_RANGE)
    return focal_px if low <= focal_px <= high else None
