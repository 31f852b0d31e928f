"""Exposure, for the sheet's white or as set by the study, and white balance."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.sensor.demosaic import filter_of
from roundel.scenes.camera.model import project
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.surfaces import lifted
from roundel.scenes.study.sensor_section import SensorSection
from roundel.scenes.world.frame import Frame

Pixels = tuple[NDArray[np.int64], NDArray[np.int64]]

# White is the level that 1 % of the sheet exceeds.
_WHITE_QUANTILE = 0.99
_METERED_SIDE = 64


def sheet_pixels(frame: Frame) -> Pixels:
    """Rows and columns of pixels spread over the sheet: where exposure is measured.

    The whole frame is unsuitable: a far sheet is a thousandth of it, and would be overexposed for the sake of the wall.
    It is used only if no point of the sheet is in the image.
    """
    (x0, y0), (x1, y1) = frame.sheet.low_m, frame.sheet.high_m
    steps = (np.arange(_METERED_SIDE) + 0.5) / _METERED_SIDE
    x, y = (a.ravel() for a in np.meshgrid(x0 + (x1 - x0) * steps, y0 + (y1 - y0) * steps))
    px = project(frame.camera, transform_points(frame.camera_from_sheet, lifted(frame.sheet.curve, x, y)))
    height, width = frame.camera.height_px, frame.camera.width_px
    with np.errstate(invalid="ignore"):
        seen = np.all((px >= -0.5) & (px < [width - 0.5, height - 0.5]), axis=1)
    if not seen.any():
        rows, columns = np.divmod(np.arange(height * width, dtype=np.int64), width)
        return rows, columns
    columns, rows = np.rint(px[seen]).astype(np.int64).T
    return rows, columns


def whites(radiance: NDArray[Any], pixels: Pixels, mosaic: str) -> NDArray[np.float64]:
    """Radiance of the sheet's white: one number, or for a mosaic (3,) red, green, blue (0 if none was metered)."""
    levels = np.asarray(radiance[pixels], dtype=np.float64)
    if mosaic == "none":
        return np.array([np.quantile(levels, _WHITE_QUANTILE)])
    colour = filter_of(mosaic, *pixels)
    parts = [levels[colour == channel] for channel in range(3)]
    return np.array([np.quantile(part, _WHITE_QUANTILE) if len(part) else 0.0 for part in parts])


def exposure_of(white: NDArray[np.float64], sensor: SensorSection) -> float:
    """Electrons collected for a radiance of 1: fixed, or such that the brightest white reaches the requested level.

    0 if there is no light to expose for.
    """
    if sensor.exposure_e is not None:
        return float(sensor.exposure_e)
    if sensor.exposure_ph is not None:
        return float(sensor.exposure_ph * sensor.quantum_efficiency)
    brightest = float(white.max())
    return float(sensor.white_level * sensor.full_well_e / brightest) if brightest > 0 else 0.0


def balance_of(white: NDArray[np.float64], sensor: SensorSection) -> NDArray[np.float64]:
    """Factors (3,) for red, green and blue.

    `auto` makes the sheet's white grey. Its smallest factor is 1, so that pixels saturated in all channels stay white.
    """
    if sensor.white_balance == "none":
        return np.ones(3)
    if sensor.white_balance != "auto":
        return np.array(sensor.white_balance, dtype=np.float64)
    lit = white > 0
    return np.where(lit, white.max(initial=0.0) / np.where(lit, white, 1.0), 1.0)
