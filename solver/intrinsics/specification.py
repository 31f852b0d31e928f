"""Parse `--intrinsics` and make its camera: true, scaled, calibrated, from EXIF, or the default phone.

The default is a normal distribution of 35-mm-equivalent focal lengths, fitted to many phones: the paper's (errata,
section 4), or those of the 2020s (`scenes/camera/phones.csv`). Cameras come with their uncertainty and its basis, see
`uncertain_camera`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.camera_file import SUFFIXES as CAMERA_SUFFIXES
from roundel.scenes.camera.camera_file import read_camera_record
from roundel.scenes.camera.film import FILM_DIAGONAL_MM
from roundel.scenes.camera.model import Camera, camera_from_json, principal_point_at_centre
from roundel.scenes.camera.parameter_covariance import parameter_covariance
from roundel.scenes.camera.quarter_turns import TURNS, can_turn, turned_camera
from roundel.scenes.camera.row_time import RowTime, row_time_from_json
from roundel.scenes.errors import DataError, UsageError, did_you_mean
from roundel.solver.intrinsics.default_phone import DEFAULT_FORMS, Convention, Phones, default_focal, parse_default
from roundel.solver.intrinsics.exif import ExifFocal, ExifTags, NoFocal, focal_of_exif
from roundel.solver.intrinsics.shutter import assumed_shutter
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera

FILM_WIDTH_MM = 36.0

# Standard deviation of each coordinate of a principal point assumed at the centre, as a fraction of the longer side.
# OpenSfM's prior for photographs is the same (`principal_point_sd`, 0.01); stabilised lenses move by as much.
PRINCIPAL_SIGMA = 0.01

# Standard deviations of k1, k2, p1, p2 of a lens assumed without distortion. Phones correct some of it: published
# calibrations of their main cameras have k1 from -0.02 to 0.17, k2 from -0.7 to 0 and tangential terms of 0.0004 to
# 0.009 (docs/decisions/026-uncertain-cameras.md).
LENS_SIGMAS = (0.08, 0.1, 0.002, 0.002)

Kind = Literal["true", "default", "exif", "scaled", "calibrated", "focal", "focal35"]

_FORMS = ("true", *DEFAULT_FORMS, "exif", "scaled:0.7", "calibrated:FILE", "focal:3100+-60", "focal35:26+-1")


@dataclass(frozen=True)
class Intrinsics:
    """One `--intrinsics` argument.

    Attributes
    ----------
    label : str
        As in the records; never a path.
    kind : str
    factor : float
        Of `scaled`.
    convention : str
        Quantity that 35-mm equivalence compares: `diagonal`, `width`, or the diagonal of the 4:3 sensor (`crop43`).
    phones : str
        Of `default`: the phones that it stands for, the paper's or those of the 2020s.
    camera : Camera or None
        Of `calibrated`.
    focal, focal_sigma : float
        Of `focal` (px) and `focal35` (mm); the standard deviation is a fraction of the focal length.
    row_time : RowTime or None
        The shutter that the file of `calibrated` declares.
    covariance : (c, c) array or None
        Of the parameters of `camera`, see `parameter_names`; None if the file of `calibrated` has none.
    orientation : int or None
        EXIF orientation of the photographs that `camera` is for, upright; None if its file does not say.
    """

    label: str
    kind: Kind
    factor: float = 1.0
    convention: Convention = "diagonal"
    phones: Phones = "paper"
    camera: Camera | None = None
    focal: float = 0.0
    focal_sigma: float = 0.0
    row_time: RowTime | None = None
    covariance: NDArray[np.float64] | None = None
    orientation: int | None = None


def parse_intrinsics(text: str) -> Intrinsics:
    """Parse one `--intrinsics` argument.

    - `true`: the frame's true camera; `scaled:X`: the true camera with its focal lengths times X;
    - `calibrated:FILE`: a camera file, as `roundel calibrate` writes it; a name that ends in .json, .yaml or .yml is
      one without the prefix;
    - `default`, `default:width`, `default:crop43`: the default phone, by the three conventions of 35-mm equivalence;
    - `default:2020s`, `default:2020s:width`, `default:2020s:crop43`: the same for phones of the 2020s;
    - `exif`: the focal length of the file's EXIF;
    - `focal:PX`, `focal35:MM`: a given focal length, in pixels or as a 35-mm equivalent; `+-` precedes its standard
      deviation, in the same unit or in per cent: `focal:3100+-60`, `focal35:26+-4%`. Without it, the focal length is
      taken as exact.

    Raises
    ------
    UsageError
        If it is none of these, a number is not positive, or there is no such file.
    DataError
        If the file is not a camera file.
    """
    text = text.strip()
    name, colon, value = text.partition(":")
    if name == "calibrated":
        if not value:
            raise UsageError("--intrinsics calibrated: give the camera file, as in calibrated:FILE")
        return _calibrated(Path(value))
    if Path(text).suffix.lower() in CAMERA_SUFFIXES:
        return _calibrated(Path(text))
    if name == "scaled":
        return _scaled(value)
    if name == "focal":
        return _focal("focal", value, "px", "focal:3100+-60")
    if name == "focal35":
        return _focal("focal35", value, "mm", "focal35:26+-1")
    if name == "true" and not colon:
        return Intrinsics("true", "true")
    if (default := parse_default(text)) is not None:
        return Intrinsics(text, "default", phones=default[0], convention=default[1])
    if name == "exif" and not colon:
        return Intrinsics("exif", "exif")
    hint = did_you_mean(text, _FORMS, cutoff=0.5) or f"use one of {', '.join(_FORMS)}"
    raise UsageError(f"--intrinsics {text}: unknown; {hint}")


def _positive(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0 else None


def _scaled(value: str) -> Intrinsics:
    factor = _positive(value)
    if factor is None:
        raise UsageError(f"--intrinsics scaled:{value}: the factor must be a positive number, for example scaled:0.7")
    return Intrinsics(f"scaled:{factor:g}", "scaled", factor=factor)


def _focal(kind: Literal["focal", "focal35"], value: str, unit: str, example: str) -> Intrinsics:
    first, spread, last = value.replace("±", "+-").partition("+-")
    focal = _positive(first.strip().removesuffix(unit))
    if focal is None:
        raise UsageError(f"--intrinsics {kind}:{value}: give a positive focal length in {unit}, for example {example}")
    if not spread:
        return Intrinsics(f"{kind}:{focal:g}", kind, focal=focal)
    per_cent = last.strip().endswith("%")
    sigma = _positive(last.strip().removesuffix("%").removesuffix(unit))
    # A standard deviation of more than half the value does not suit a normal distribution of a positive number.
    if sigma is None or (sigma := sigma / 100 if per_cent else sigma / focal) > 0.5:
        raise UsageError(
            f"--intrinsics {kind}:{value}: give its standard deviation after +-, in {unit} or %, at most half of it, "
            f"for example {example}"
        )
    shown = f"{100 * sigma:g}%" if per_cent else f"{sigma * focal:g}"
    return Intrinsics(f"{kind}:{focal:g}+-{shown}", kind, focal=focal, focal_sigma=sigma)


def _calibrated(path: Path) -> Intrinsics:
    try:
        record = read_camera_record(path)
    except UsageError as error:
        raise UsageError(
            f"--intrinsics calibrated:{path}: there is no such file; `roundel calibrate` writes one"
        ) from error
    except DataError as error:
        raise DataError(f"{path}: not a camera file; `roundel calibrate` writes one") from error
    try:
        camera, row_time = camera_from_json(record), row_time_from_json(record)
        covariance = parameter_covariance(record, camera)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    label = f"calibrated:{path.stem}"
    return Intrinsics(
        label, "calibrated", camera=camera, row_time=row_time, covariance=covariance, orientation=_orientation(record)
    )


def _orientation(record: dict[str, Any]) -> int | None:
    about = record.get("calibration")
    value = about.get("exif_orientation") if isinstance(about, dict) else None
    return value if value in TURNS else None


def _turned(spec: Intrinsics, exif: ExifTags | None) -> Intrinsics:
    """The calibrated camera of a photograph that was taken with the camera turned by quarter turns."""
    if spec.camera is None or exif is None or spec.orientation is None or exif.orientation not in TURNS:
        return spec
    turns = TURNS[exif.orientation] - TURNS[spec.orientation]
    if not turns or not can_turn(spec.camera):
        return spec
    camera, covariance = turned_camera(spec.camera, spec.covariance, turns)
    return replace(spec, camera=camera, covariance=covariance)


def camera_for(spec: Intrinsics, camera: Camera | None, width_px: int, height_px: int) -> Camera:
    """The camera of `uncertain_camera_for`."""
    return uncertain_camera_for(spec, camera, width_px, height_px).camera


def uncertain_camera_for(
    spec: Intrinsics,
    camera: Camera | None,
    width_px: int,
    height_px: int,
    exif: ExifTags | None = None,
    row_time: RowTime | None = None,
) -> UncertainCamera:
    """The camera to estimate with, and its uncertainty.

    Parameters
    ----------
    spec : Intrinsics
    camera : Camera or None
        The frame's true camera, if it is known.
    width_px, height_px : int
        Size of the image.
    exif : ExifTags, optional
        Tags of a photograph; for a frame of a dataset, `camera` has the 35-mm equivalent.
    row_time : RowTime, optional
        The shutter that the frame declares; without it, that of a `calibrated` file, or of `assumed_shutter`.

    Returns
    -------
    UncertainCamera
        Assumed cameras have a centred principal point, square pixels and no distortion, all but the pixels uncertain.
        `scaled` multiplies fx and fy and keeps the rest. `true` and `scaled` are taken as exact, and so is
        `calibrated` if its file has no covariance.

    Raises
    ------
    UsageError
        If the frame's camera is required but unknown, has no EXIF focal length, or the file is for another image size.
    """
    found = _uncertain_camera(spec, camera, (width_px, height_px), exif)
    declared = row_time if row_time is not None else spec.row_time
    given = spec.kind in ("true", "scaled", "calibrated")
    return replace(found, row_time=assumed_shutter(declared, not given, width_px, height_px))


def _uncertain_camera(
    spec: Intrinsics, camera: Camera | None, size: tuple[int, int], exif: ExifTags | None
) -> UncertainCamera:
    if spec.kind == "calibrated":
        spec = _turned(spec, exif)
        assert spec.camera is not None
        _check_size(spec, size)
        name = f"calibrated camera {spec.label.partition(':')[2]}"
        if spec.covariance is None:
            return UncertainCamera(spec.camera, basis=f"{name}, taken as exact")
        sigma = math.sqrt(spec.covariance[0, 0]) / float(spec.camera.K[0, 0])
        return UncertainCamera(
            spec.camera, basis=f"{name}, with the covariance of its parameters: fx +- {100 * sigma:.2g} %",
            covariance=spec.covariance,
        )  # fmt: skip
    if spec.kind == "default":
        focal_35mm_mm, sigma, basis = default_focal(spec.phones, spec.convention)
        return _ideal(_focal_px(focal_35mm_mm, size, spec.convention), size, sigma, basis)
    if spec.kind == "focal":
        basis = f"focal length given: {spec.focal:g} px, {_spread(spec.focal_sigma)}"
        return _ideal(spec.focal, size, spec.focal_sigma, basis)
    if spec.kind == "focal35":
        basis = f"focal length given: {spec.focal:g} mm (35-mm equivalent, by diagonal), {_spread(spec.focal_sigma)}"
        return _ideal(_focal_px(spec.focal, size, "diagonal"), size, spec.focal_sigma, basis)
    if spec.kind == "exif":
        return _by_exif(spec, camera, size, exif)
    if camera is None:
        raise UsageError(f"--intrinsics {spec.label}: the camera of these images is not known; use default")
    if spec.kind == "scaled":
        k = np.array(camera.K, dtype=np.float64)
        k[0, 0] *= spec.factor
        k[1, 1] *= spec.factor
        scaled = replace(camera, width_px=size[0], height_px=size[1], K=k)
        return UncertainCamera(scaled, basis=f"the frame's own camera, its focal length times {spec.factor:g}")
    return UncertainCamera(camera, basis="the frame's own camera, taken as exact")


def _check_size(spec: Intrinsics, size: tuple[int, int]) -> None:
    assert spec.camera is not None
    calibrated = (spec.camera.width_px, spec.camera.height_px)
    if calibrated != size:
        turned = "; the photograph was turned upright according to its EXIF" if calibrated == size[::-1] else ""
        raise UsageError(
            f"--intrinsics {spec.label}: calibrated for {calibrated[0]}x{calibrated[1]} px, "
            f"but the image has {size[0]}x{size[1]}{turned}; calibrate at the size of the images"
        )


def _by_exif(spec: Intrinsics, camera: Camera | None, size: tuple[int, int], exif: ExifTags | None) -> UncertainCamera:
    if exif is None:
        if camera is None:
            raise UsageError(f"--intrinsics {spec.label}: the camera of these images is not known; use default")
        if camera.focal_35mm_mm is None:
            raise UsageError("--intrinsics exif: a frame has no 35-mm focal length in its EXIF; use default")
        exif = ExifTags(focal_35mm_mm=camera.focal_35mm_mm)
    focal: ExifFocal | NoFocal = focal_of_exif(exif, *size)
    if isinstance(focal, NoFocal):
        raise UsageError(f"--intrinsics exif: {focal.reason}; use default, or focal35:MM")
    return _ideal(focal.focal_px, size, focal.sigma, focal.basis)


def _spread(sigma: float) -> str:
    return f"+- {100 * sigma:.3g} %" if sigma > 0 else "taken as exact"


def focal_px_of(focal_35mm_mm: float, width_px: int, height_px: int, by_width: bool = False) -> float:
    """Convert a 35-mm-equivalent focal length to pixels, by equal diagonal or horizontal angle of view.

    Source: errata, section 4 (CIPA DCG-001 and EXIF's FocalLengthIn35mmFilm mean the diagonal). Portrait or landscape
    makes no difference: the longer side counts as the width.
    """
    return _focal_px(focal_35mm_mm, (width_px, height_px), "width" if by_width else "diagonal")


def _focal_px(focal_35mm_mm: float, size: tuple[int, int], convention: Convention) -> float:
    long_px, short_px = max(size), float(min(size))
    if convention == "width":
        return focal_35mm_mm * long_px / FILM_WIDTH_MM
    if convention == "crop43":  # an image not wider than 4:3 is the whole sensor
        short_px = max(short_px, 0.75 * long_px)
    return focal_35mm_mm * math.hypot(long_px, short_px) / FILM_DIAGONAL_MM


def _ideal(focal_px: float, size: tuple[int, int], focal_sigma: float, basis: str) -> UncertainCamera:
    cx, cy = principal_point_at_centre(*size)
    k = np.array([[focal_px, 0.0, cx], [0.0, focal_px, cy], [0.0, 0.0, 1.0]])
    focal_35mm_mm = focal_px * FILM_DIAGONAL_MM / math.hypot(*size)
    camera = Camera(size[0], size[1], k, focal_35mm_mm=focal_35mm_mm)
    lens = np.diag([0.0] * 4 + [sigma**2 for sigma in LENS_SIGMAS])
    return UncertainCamera(camera, focal_sigma, PRINCIPAL_SIGMA * max(size), basis, covariance=lens)
