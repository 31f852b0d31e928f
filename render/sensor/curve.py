"""Digital numbers of the file: white balance, tone curve, and bit depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.render.sensor.data_sheet import DataSheet
from roundel.render.sensor.demosaic import demosaic
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


def delivered_levels(numbers: ArrayLike, sheet: DataSheet, balance: Array | None = None) -> Array:
    """Levels in the file's DN, not rounded, for the converter's numbers; `balance` broadcasts against these.

    Developed images have the black level subtracted; each channel is clipped separately.
    """
    values = np.asarray(numbers, dtype=np.float64)
    if not sheet.developed:
        return np.asarray(values * 2.0**sheet.stored_shift)
    signal = (values - sheet.black_level_dn) / (sheet.top_dn - sheet.black_level_dn)
    if balance is not None:
        signal = signal * balance
    top = 2**sheet.bits - 1
    return np.asarray(encoded(np.clip(signal, 0.0, 1.0), sheet.curve, sheet.gamma) * (top * 2.0**sheet.stored_shift))


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
    if sheet.colour:
        levels = delivered_levels(demosaic(numbers, sheet.mosaic), sheet, balance)
    else:
        levels = delivered_levels(np.arange(sheet.top_dn + 1), sheet)[numbers]
    unit = 2.0**sheet.stored_shift
    return np.asarray(np.rint(levels / unit) * unit, dtype=kind)
