"""A dataset's frame as grey levels, linear in light, with what its record says of its sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from roundel.datasets.layout.images import Images
from roundel.scenes.camera.response_curve import UNKNOWN, ResponseCurve
from roundel.solver.photometry.image_levels import averaged_rounding, grey_levels
from roundel.solver.photometry.jpeg_rounding import read_luminance_table
from roundel.solver.photometry.photometry import Photometry, processing_of


@dataclass(frozen=True, eq=False)
class Levels:
    """Grey levels of an image.

    Attributes
    ----------
    grey : (H, W) array
        Linear in light if the curve is known, else as delivered.
    full_scale_dn : float
        The level at which its pixels saturate.
    photometry : Photometry
    linearise : callable or None
        If the curve is to be estimated: returns grey levels and saturation level after a curve was undone.
    """

    grey: NDArray[Any]
    full_scale_dn: float
    photometry: Photometry
    linearise: Callable[[ResponseCurve], tuple[NDArray[Any], float]] | None = None


def frame_levels(images: Images, i: int, delivered: NDArray[Any]) -> Levels:
    """The levels of frame `i`, of which `delivered` is the image."""
    curve, top_dn = images.curve(i), images.top_dn(i)
    grey, range_dn = grey_levels(delivered, curve or UNKNOWN, top_dn, keep_8bit=True)
    top_dn = top_dn or range_dn
    saturation = images.saturation_dn(i) or range_dn
    full_scale_dn = top_dn * float((curve or UNKNOWN).light(round(saturation) / top_dn))
    sensor = images.records[i].get("sensor") or {}
    photometry = Photometry(
        curve or UNKNOWN,
        top_dn,
        float(1 << sensor.get("stored_shift", 0)),
        averaged_rounding(delivered),
        read_luminance_table(images.image_bytes(i)) if images.is_jpeg(i) else None,
        *processing_of(sensor.get("isp")),
    )
    return Levels(grey, full_scale_dn, photometry, None if curve else lambda found: grey_levels(delivered, found))
