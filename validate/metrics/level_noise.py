"""Noise of a pixel by its level, from the data sheet in `cameras.json`, referred to the electrons that it collects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.srgb import linear_to_srgb
from roundel.validate.metrics.jpeg_noise import jpeg_variance_dn2
from roundel.validate.metrics.mosaic_noise import mosaic_variance

Array = NDArray[np.float64]

_ROUNDING = 1.0 / 12.0  # variance of a rounding error, in squared steps
_TINY = 1e-6  # step of a difference quotient, as a fraction of full scale
# Within this part of full scale the slope of a power curve at black is unbounded; levels are taken at it instead.
_DARKEST = 1e-4


def full_scale_e(sensor: dict[str, Any]) -> float:
    """Electrons at which the converter's range ends."""
    top_dn = 2.0 ** int(sensor["adc_bits"]) - 1.0
    return (top_dn - float(sensor["black_level_dn"])) / float(sensor["gain_dn_per_e"])


def saturation_e(sensor: dict[str, Any]) -> float:
    """Electrons, dark signal included, above which pixels clip: a full well, or the end of the converter's range."""
    return min(float(sensor["full_well_e"]), full_scale_e(sensor))


def encoded_dn(sensor: dict[str, Any], electrons: Array) -> Array:
    """Level in steps of the file, without its rounding."""
    light = np.clip(electrons / full_scale_e(sensor), 0.0, 1.0)
    curve = sensor["curve"]
    if curve == "srgb":
        light = linear_to_srgb(light)
    elif curve == "gamma":
        light = light ** (1.0 / float(sensor["gamma"]))
    return np.asarray((2.0 ** sensor["bits"] - 1) * light, dtype=np.float64)


def converter_variance_e2(sensor: dict[str, Any], electrons: Array) -> Array:
    """EMVA 1288: shot and read noise, fixed patterns, and the converter's rounding, without clipping."""
    photo = np.maximum(electrons - float(sensor["dark_e"]), 0.0)
    shot = electrons if sensor["shot_noise"] else 0.0
    fixed = float(sensor["dsnu_e"]) ** 2 + (float(sensor["prnu"]) * photo) ** 2
    rounding = _ROUNDING / float(sensor["gain_dn_per_e"]) ** 2
    return np.asarray(shot + float(sensor["read_noise_e"]) ** 2 + fixed + rounding, dtype=np.float64)


def level_variance(
    sensor: dict[str, Any], levels_e: tuple[float, float], blur_px: float, table: Array | None
) -> Callable[[Array], Array]:
    """Variance, electrons^2, of pixels of a delivered image near an edge, as a function of their mean electrons.

    Parameters
    ----------
    sensor : dict
        The entry of `cameras.json`.
    levels_e : (float, float)
        Electrons on the two sides of the edge.
    blur_px : float
        Gaussian sigma of the edge, with the pixel.
    table : (8, 8) array or None
        Quantisation steps of a JPEG file.
    """
    colour = sensor["mosaic"] != "none" and sensor.get("deliver") == "colour"
    pattern = (levels_e[1] - levels_e[0]) ** 2 * mosaic_variance(round(blur_px, 2)) if colour else 0.0
    curved = sensor["curve"] != "linear" or sensor["adc_bits"] != sensor["bits"]
    if not curved and table is None:
        return lambda electrons: converter_variance_e2(sensor, np.maximum(electrons, 0.0))
    full = full_scale_e(sensor)

    def slope(electrons: Array) -> Array:
        """Steps of the file per electron."""
        middle = np.clip(electrons, _DARKEST * full, (1 - _TINY) * full)
        ends = [encoded_dn(sensor, middle + sign * _TINY * full / 2) for sign in (1, -1)]
        return np.asarray((ends[0] - ends[1]) / (_TINY * full), dtype=np.float64)

    rounding = _ROUNDING
    if table is not None:
        sides = np.array(levels_e)
        low, high = encoded_dn(sensor, sides).tolist()
        before = np.sqrt(converter_variance_e2(sensor, sides) * slope(sides) ** 2).tolist()
        rounding += jpeg_variance_dn2(table, (low, high), (before[0], before[1]), blur_px)
    return lambda electrons: (
        converter_variance_e2(sensor, np.maximum(electrons, 0.0))
        + pattern
        + rounding / slope(np.asarray(electrons)) ** 2
    )
