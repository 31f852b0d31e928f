"""Digital numbers of the file: white balance, curve, processing, and bit depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.render.sensor.data_sheet import DataSheet
from roundel.render.sensor.demosaic import demosaic
from roundel.render.sensor.isp import processed, toned
from roundel.scenes.camera.srgb import linear_to_srgb

Array = NDArray[np.float64]


def encoded(linear: ArrayLike, curve: str, gamma: float = 2.2) -> Array:
    """A linear signal in [0, 1] through a curve: `linear`, `srgb` (IEC 61966-2-1) or `gamma` (out = in^(1/gamma))."""
    signal = np.asarray(linear, dtype=np.float64)
    if curve == "srgb":
        return linear_to_srgb(signal)
    if curve == "gamma":
        return np.asarray(signal ** (1.0 / gamma), dtype=np.float64)
    return signal


def _curved(numbers: ArrayLike, sheet: DataSheet, balance: Array | None) -> Array:
    """Levels from 0 to 1 after the curve: black level subtracted, each channel clipped separately."""
    values = np.asarray(numbers, dtype=np.float64)
    signal = (values - sheet.black_level_dn) / (sheet.top_dn - sheet.black_level_dn)
    if balance is not None:
        signal = signal * balance
    return encoded(np.clip(signal, 0.0, 1.0), sheet.curve, sheet.gamma)


def delivered_levels(numbers: ArrayLike, sheet: DataSheet, balance: Array | None = None) -> Array:
    """Levels in the file's DN, not rounded, for the converter's numbers; `balance` broadcasts against these.

    They are those of a flat area: of the processor's steps, the tone curve alone acts on a pixel by itself.
    """
    if not sheet.developed:
        return np.asarray(np.asarray(numbers, dtype=np.float64) * 2.0**sheet.stored_shift)
    levels = _curved(numbers, sheet, balance)
    if sheet.isp is not None:
        levels = toned(levels, sheet.isp)
    return np.asarray(levels * ((2**sheet.bits - 1) * 2.0**sheet.stored_shift))


def delivered(numbers: NDArray[np.uint16], sheet: DataSheet, balance: Array | None = None) -> NDArray[Any]:
    """The image as stored in its file: (H, W) or, for colour, (H, W, 3); uint8 for 8 bits, else uint16.

    Parameters
    ----------
    numbers : (H, W) array
        The converter's numbers.
    sheet : DataSheet
    balance : (3,) array, optional
        Factors for red, green, blue; for colour images only.
    """
    kind: Any = np.uint8 if sheet.bits == 8 else np.uint16
    if not sheet.developed:
        return np.asarray(np.left_shift(numbers, sheet.stored_shift), dtype=kind)
    unit = 2.0**sheet.stored_shift
    values = demosaic(numbers, sheet.mosaic) if sheet.colour else numbers
    if sheet.isp is not None:
        levels = processed(_curved(values, sheet, balance), sheet.isp) * ((2**sheet.bits - 1) * unit)
    elif sheet.colour:
        levels = delivered_levels(values, sheet, balance)
    else:
        levels = delivered_levels(np.arange(sheet.top_dn + 1), sheet)[numbers]
    return np.asarray(np.rint(levels / unit) * unit, dtype=kind)
