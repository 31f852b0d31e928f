"""Which camera an estimate is made with: the frame's own, a scaled one, a calibrated one, or a default.

The default is a normal distribution of 35-mm-equivalent focal lengths, fitted to many cameras (the paper; errata,
section 4).
"""

from __future__ import annotations

import difflib
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from roundel.scenes.camera import Camera, camera_from_json, principal_point_at_centre
from roundel.scenes.errors import DataError, UsageError

DEFAULT_FOCAL_35MM_MM = 29.95
DEFAULT_FOCAL_35MM_SIGMA_MM = 3.444  # 11.5 %
FILM_WIDTH_MM = 36.0
FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)

Kind = Literal["true", "default", "exif", "scaled", "calibrated"]

_FORMS = ("true", "default", "default:width", "exif", "scaled:0.7", "calibrated:FILE")


@dataclass(frozen=True)
class Intrinsics:
    """One `--intrinsics` argument.

    Attributes
    ----------
    label : str
        As it stands in the records; never a path.
    kind : str
    factor : float
        Of `scaled`.
    by_width : bool
        Whether 35-mm equivalence compares widths instead of diagonals.
    camera : Camera or None
        Of `calibrated`.
    """

    label: str
    kind: Kind
    factor: float = 1.0
    by_width: bool = False
    camera: Camera | None = None


def parse_intrinsics(text: str) -> Intrinsics:
    """Read `true`, `default`, `default:width`, `exif`, `scaled:X` or `calibrated:FILE`.

    Raises
    ------
    UsageError
        If it is none of these, the factor is not a positive number, or there is no such file.
    DataError
        If the file holds no camera.
    """
    name, colon, value = text.strip().partition(":")
    if name == "calibrated":
        if not value:
            raise UsageError("--intrinsics calibrated: name the camera file, as calibrated:FILE")
        return _calibrated(Path(value))
    if name == "scaled":
        return _scaled(value)
    if text.strip() == "default:width":
        return Intrinsics("default:width", "default", by_width=True)
    if name == "true" and not colon:
        return Intrinsics("true", "true")
    if name == "default" and not colon:
        return Intrinsics("default", "default")
    if name == "exif" and not colon:
        return Intrinsics("exif", "exif")
    close = difflib.get_close_matches(text.strip(), _FORMS, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]}?" if close else f"use one of {', '.join(_FORMS)}"
    raise UsageError(f"--intrinsics {text}: unknown; {hint}")


def _scaled(value: str) -> Intrinsics:
    try:
        factor = float(value)
    except ValueError:
        factor = math.nan
    if not (math.isfinite(factor) and factor > 0):
        raise UsageError(f"--intrinsics scaled:{value}: the factor must be a positive number, as scaled:0.7")
    return Intrinsics(f"scaled:{factor:g}", "scaled", factor=factor)


def _calibrated(path: Path) -> Intrinsics:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise UsageError(
            f"--intrinsics calibrated:{path}: there is no such file; `roundel calibrate` writes one"
        ) from error
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: not a camera file; `roundel calibrate` writes one") from error
    try:
        camera = camera_from_json(record)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    return Intrinsics(f"calibrated:{path.stem}", "calibrated", camera=camera)


def camera_for(spec: Intrinsics, camera: Camera | None, width_px: int, height_px: int) -> Camera:
    """The camera to estimate with.

    Parameters
    ----------
    spec : Intrinsics
    camera : Camera or None
        The frame's own, where it is known.
    width_px, height_px : int
        Size of the image.

    Returns
    -------
    Camera
        `default` and `exif`: centred principal point, square pixels, no distortion. `scaled` multiplies fx and fy and
        keeps the rest.

    Raises
    ------
    UsageError
        If the frame's camera is needed and not known, has no EXIF focal length, or the file is of another image size.
    """
    if spec.kind == "calibrated":
        assert spec.camera is not None
        if (spec.camera.width_px, spec.camera.height_px) != (width_px, height_px):
            raise UsageError(
                f"--intrinsics {spec.label}: calibrated for {spec.camera.width_px}x{spec.camera.height_px} px, "
                f"but the image has {width_px}x{height_px}; calibrate at the size of the images"
            )
        return spec.camera
    if spec.kind == "default":
        return _ideal(DEFAULT_FOCAL_35MM_MM, width_px, height_px, spec.by_width)
    if camera is None:
        raise UsageError(f"--intrinsics {spec.label}: the camera of these images is not known; use default")
    if spec.kind == "exif":
        if camera.focal_35mm_mm is None:
            raise UsageError("--intrinsics exif: a frame has no 35-mm focal length in its EXIF; use default")
        return _ideal(camera.focal_35mm_mm, width_px, height_px, by_width=False)
    if spec.kind == "scaled":
        k = np.array(camera.K, dtype=np.float64)
        k[0, 0] *= spec.factor
        k[1, 1] *= spec.factor
        return replace(camera, width_px=width_px, height_px=height_px, K=k)
    return camera


def focal_px_of(focal_35mm_mm: float, width_px: int, height_px: int, by_width: bool = False) -> float:
    """Focal length in pixels of a 35-mm-equivalent one: the same diagonal angle of view, or the same horizontal one.

    Source: errata, section 4 (CIPA DCG-001 and EXIF's FocalLengthIn35mmFilm mean the diagonal). Portrait or landscape
    makes no difference: the longer side counts as the width.
    """
    if by_width:
        return focal_35mm_mm * max(width_px, height_px) / FILM_WIDTH_MM
    return focal_35mm_mm * math.hypot(width_px, height_px) / FILM_DIAGONAL_MM


def _ideal(focal_35mm_mm: float, width_px: int, height_px: int, by_width: bool) -> Camera:
    focal_px = focal_px_of(focal_35mm_mm, width_px, height_px, by_width)
    cx, cy = principal_point_at_centre(width_px, height_px)
    k = np.array([[focal_px, 0.0, cx], [0.0, focal_px, cy], [0.0, 0.0, 1.0]])
    return Camera(width_px, height_px, k, focal_35mm_mm=focal_35mm_mm)
