"""Radiance to digital numbers: photons, electrons, DN (EMVA 1288 release 4.0, linear camera model).

mean electrons = radiance * exposure * (1 + PRNU pattern) + dark signal; their number is Poisson (shot noise); DSNU
pattern and read noise are added; the full well clips; gain and black level convert to DN; the result is rounded.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.sensor.data_sheet import DataSheet

# One stream of random numbers for each noise source: changing one does not affect the others in paired frames.
_SHOT, _READ = 0, 1
_PRNU, _DSNU = 0, 1

# The image is exposed in this many bands of rows with their own streams: results do not depend on the thread count.
_BANDS = 8

_COUNTED = 1e12


def _generator(seed: int, *purpose: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *purpose])))


# Cache of both patterns of the current sensor.
@lru_cache(maxsize=2)
def pattern(sensor_seed: int, purpose: int, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Fixed pattern (H, W) of a sensor's pixels, in standard deviations; `purpose` 0 is PRNU, 1 is DSNU."""
    made = _generator(sensor_seed, purpose).standard_normal(shape, dtype=np.float32)
    made.setflags(write=False)
    return made


def expose(
    radiance: NDArray[Any], exposure_e: float, sheet: DataSheet, noise_seed: int, sensor_seed: int
) -> NDArray[np.uint16]:
    """The converter's numbers (H, W) for linear radiance (H, W).

    Parameters
    ----------
    radiance : (H, W) array
        Radiance seen through each pixel's own filter.
    exposure_e : float
        Electrons collected for a radiance of 1.
    sheet : DataSheet
    noise_seed, sensor_seed : int
        Seeds of the frame and of the sensor's fixed patterns; the same seeds give the same numbers.
    """
    shape = (radiance.shape[0], radiance.shape[1])
    prnu = sheet.prnu * pattern(sensor_seed, _PRNU, shape) if sheet.prnu > 0 else None
    dsnu_e = sheet.dsnu_e * pattern(sensor_seed, _DSNU, shape) if sheet.dsnu_e > 0 else None
    numbers = np.empty(shape, dtype=np.uint16)
    edges = np.linspace(0, shape[0], _BANDS + 1).round().astype(int)

    def expose_band(band: int) -> None:
        rows = slice(edges[band], edges[band + 1])
        electrons = radiance[rows].astype(np.float64) * exposure_e
        if prnu is not None:
            # Clamp at zero: sensitivity cannot be negative.
            electrons *= np.maximum(1.0 + prnu[rows], 0.0)
        electrons += sheet.dark_e
        np.maximum(electrons, 0.0, out=electrons)
        if sheet.shot_noise:
            # numpy refuses means near 2^63. For so many electrons the relative noise is a millionth, and is left out.
            drawn = _generator(noise_seed, _SHOT, band).poisson(np.minimum(electrons, _COUNTED))
            electrons = np.where(electrons < _COUNTED, drawn, electrons)
        if dsnu_e is not None:
            electrons += dsnu_e[rows]
        if sheet.read_noise_e > 0:
            electrons += sheet.read_noise_e * _generator(noise_seed, _READ, band).standard_normal(electrons.shape)
        np.minimum(electrons, sheet.full_well_e, out=electrons)
        electrons *= sheet.gain_dn_per_e
        electrons += sheet.black_level_dn
        numbers[rows] = np.clip(np.rint(electrons, out=electrons), 0, sheet.top_dn)

    # numpy releases the GIL while it draws.
    with ThreadPoolExecutor(min(os.cpu_count() or 1, _BANDS)) as pool:
        list(pool.map(expose_band, range(_BANDS)))
    return numbers
