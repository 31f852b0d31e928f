"""From linear radiance to the delivered image: glare, exposure, sensor, colours, curve, processing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.render.sensor.curve import delivered, delivered_levels
from roundel.render.sensor.data_sheet import DataSheet, data_sheet
from roundel.render.sensor.exposure import balance_of, exposure_of, sheet_pixels, whites
from roundel.render.sensor.glare import with_glare
from roundel.render.sensor.photometry import edge_photometry, noise_dn
from roundel.render.sensor.sensor import expose
from roundel.scenes.world.frame import Frame

# A sheet is flagged `saturated` if at least this fraction of it is saturated.
_BURNT_OUT = 0.99


@dataclass(frozen=True)
class Developed:
    """A developed frame.

    Attributes
    ----------
    image : (H, W) or (H, W, 3) array
        As stored in its file, uint8 or uint16.
    light : (H, W) array
        Radiance that reaches the sensor: that of the scene, with the glare of the lens.
    exposure_e : float
        Electrons collected for a radiance of 1.
    sheet : DataSheet
    balance : (3,) array, optional
        Factors of red, green, blue; for a colour image only.
    saturated_fraction : float
        Fraction of the pixels that saturate at the converter.
    flags : tuple of str
        `saturated`: at least 99 % of the marker's sheet is. `dark`: there was no light to expose for, or the brightest
        pixel of the sheet is less than 1 DN above black.
    """

    image: NDArray[Any]
    light: NDArray[np.float32]
    exposure_e: float
    sheet: DataSheet
    balance: NDArray[np.float64] | None
    saturated_fraction: float
    flags: tuple[str, ...]

    def noise_dn(self) -> NDArray[np.float32]:
        """Standard deviation (H, W) of each pixel in the file's DN; see `photometry.noise_dn`."""
        return noise_dn(self.light, self.exposure_e, self.sheet).astype(np.float32)

    def edge(self, coverage: NDArray[np.float32]) -> dict[str, float | None]:
        """Contrast and noise at the edge of the marker of this coverage; see `photometry.edge_photometry`."""
        return edge_photometry(self.light, coverage, self.exposure_e, self.sheet, self.balance)

    def record(self) -> dict[str, Any]:
        """The sensor's entry in cameras.json: its data sheet, processing, where the file saturates, white balance."""
        full = float(delivered_levels(self.sheet.saturation_dn, self.sheet))
        kept = {**self.sheet.record(), "saturation_dn": round(full)}
        if self.balance is not None:
            kept["white_balance"] = self.balance.tolist()
        return kept


def develop(frame: Frame, radiance: NDArray[np.float32]) -> Developed:
    """Develop a frame from its linear radiance (H, W), that of the scene: the glare of the lens is added here.

    The same frame and radiance give the same bytes: noise and fixed patterns come from the frame's own seeds.
    """
    section = frame.settings.sensor
    sheet = data_sheet(section, frame.motion.exposure_s)
    pixels = sheet_pixels(frame)
    light = with_glare(radiance, frame.settings.camera, sheet.mosaic)
    white = whites(light, pixels, sheet.mosaic)
    exposure_e = exposure_of(white, section)
    balance = balance_of(white, section) if sheet.colour else None
    numbers = expose(light, exposure_e, sheet, frame.noise_seed, frame.sensor_seed)
    saturated = numbers >= max(sheet.saturation_dn, 1)
    flags = []
    if saturated[pixels].mean() >= _BURNT_OUT:
        flags.append("saturated")
    # Evaluated without noise, so that it does not depend on the seed.
    one_dn = (2**sheet.adc_bits - 1) / (2**sheet.bits - 1)
    if float(light[pixels].max()) * exposure_e * sheet.gain_dn_per_e < one_dn:
        flags.append("dark")
    return Developed(
        delivered(numbers, sheet, balance), light, exposure_e, sheet, balance, float(saturated.mean()), tuple(flags)
    )
