"""Imported photographs, and their entries in cameras.json."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout import files
from roundel.scenes.camera.model import Camera, camera_to_json
from roundel.scenes.camera.response_curve import ResponseCurve
from roundel.scenes.markers.marker import Sheet

Array = NDArray[np.float64]

GROUP = "photographs"
# The files that a dataset's images may be, by their first bytes.
SUFFIXES = {b"\xff\xd8\xff": ".jpg", b"\x89PNG": ".png"}


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph and the poses measured in it.

    Attributes
    ----------
    name : str
        Of its file.
    load : callable
        Returns the bytes of the file, which become the image of the frame unchanged.
    suffix : str
        .jpg or .png.
    bits : int
        8 or 16.
    curve : ResponseCurve
        What its levels are encoded by.
    focal_35mm_mm : float or None
        From its EXIF.
    orientation : int
        The EXIF tag, 1 to 8. Pixels, K and poses are those of the image as it is stored: the tag is not applied.
    camera_from_part : (P, 4, 4) array
        Reference pose of each part of the sheet.
    covariance : (P, 6, 6) array
        Of each: its centre (m), then rotation about the axes of the camera's frame (rad).
    corners : int
        Number of corners of the board.
    sigma_px, rms_px : float
        Noise of a coordinate of a corner, and root mean square distance of the corners from the model.
    """

    name: str
    load: Callable[[], bytes]
    suffix: str
    bits: int
    curve: ResponseCurve
    focal_35mm_mm: float | None
    orientation: int
    camera_from_part: Array
    covariance: Array
    corners: int
    sigma_px: float
    rms_px: float


def suffix_of(data: bytes) -> str | None:
    """Suffix of an image by the first bytes of its file; None if it is neither a JPEG nor a PNG."""
    return next((suffix for start, suffix in SUFFIXES.items() if data.startswith(start)), None)


def camera_entry(frame_id: int, photo: Photograph, camera: Camera, sheet: Sheet) -> dict[str, Any]:
    """A photograph's entry in cameras.json."""
    return {
        "frame_id": frame_id,
        "group": GROUP,
        "mode": "images",
        "image": files.image_name(frame_id, photo.suffix),
        **_sensor(photo),
        **camera_to_json(replace(camera, focal_35mm_mm=photo.focal_35mm_mm)),
        "markers": [
            {
                "marker_id": part.marker_id,
                "kind": part.kind,
                "diameter_m": None if part.radius_m is None else 2 * part.radius_m,
                "layout": part.layout,
                **({} if part.size_m is None else {"size_m": list(part.size_m)}),
            }
            for part in sheet.parts
        ],
    }


def _sensor(photo: Photograph) -> dict[str, Any]:
    """What is known of the sensor: the curve of the file. Nothing, if that is not known."""
    if photo.curve.kind not in ("linear", "srgb", "gamma"):
        return {}
    top = (1 << photo.bits) - 1
    record: dict[str, Any] = {"bits": photo.bits, "stored_shift": 0, "saturation_dn": float(top)}
    record["curve"] = photo.curve.kind
    if photo.curve.kind == "gamma":
        record["gamma"] = photo.curve.gamma
    return {"sensor": record}
