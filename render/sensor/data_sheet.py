"""Data sheet of a sensor: the section of a study with all values drawn.

Terms of EMVA 1288 (release 4.0, linear model): overall gain K in DN per electron, dark signal, PRNU, DSNU.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from roundel.scenes.study.sensor_section import IspSection, SensorSection

# Images that are developed further (a curve, colours) are read out with at least this many bits.
_DEVELOPED_BITS = 12


@dataclass(frozen=True)
class DataSheet:
    """Values of one sensor. `adc_bits`, `gain_dn_per_e`, `black_level_dn` belong to its analogue-to-digital converter.

    Attributes
    ----------
    bits, adc_bits : int
        Bits of the delivered numbers and of the converter; they differ if the image is developed further.
    stored_shift : int
        A file of 10 or 12 bits stores them in the upper bits of 16: its numbers are DN << stored_shift.
    gain_dn_per_e : float
        Converter's DN per electron, EMVA's K.
    black_level_dn : float
        Converter's DN without any signal.
    full_well_e, read_noise_e, dark_e, dsnu_e : float
        Electrons; `dark_e` is the mean dark signal of one exposure.
    prnu : float
        Standard deviation of the pixels' sensitivity, as a fraction.
    isp : IspSection, optional
        Processing after the curve; None if there is none.
    """

    bits: int
    adc_bits: int
    stored_shift: int
    gain_dn_per_e: float
    black_level_dn: float
    full_well_e: float
    read_noise_e: float
    dark_e: float
    prnu: float
    dsnu_e: float
    shot_noise: bool
    mosaic: str
    deliver: str
    curve: str
    gamma: float
    isp: IspSection | None = None

    @property
    def top_dn(self) -> int:
        """The converter's largest number."""
        return int(2**self.adc_bits - 1)

    @property
    def saturation_dn(self) -> int:
        """The converter's number for a full well: its largest, or less if the gain leaves room."""
        return min(self.top_dn, round(self.full_well_e * self.gain_dn_per_e + self.black_level_dn))

    @property
    def colour(self) -> bool:
        """Whether a colour image is delivered."""
        return self.mosaic != "none" and self.deliver == "colour"

    @property
    def developed(self) -> bool:
        """Whether the delivered numbers are computed from the converter's rather than equal to them."""
        return self.colour or self.curve != "linear" or self.isp is not None

    def record(self) -> dict[str, Any]:
        """Plain values for cameras.json."""
        kept = asdict(self)
        if self.curve != "gamma":
            del kept["gamma"]
        if self.mosaic == "none":
            del kept["deliver"]
        del kept["isp"]
        if self.isp is not None:
            kept["isp"] = self.isp.model_dump(exclude={"preset"})
        return kept


def data_sheet(sensor: SensorSection, exposure_s: float) -> DataSheet:
    """The data sheet of a sensor section with all values drawn.

    A study gives `gain_dn_per_e` and `black_level_dn` for numbers of `bits`. If the converter has more bits than are
    delivered, both scale with its range, so that a curve, colour or processing changes neither exposure nor saturation.

    Parameters
    ----------
    sensor : SensorSection
    exposure_s : float
        Seconds during which dark current is collected.
    """
    colour = sensor.mosaic != "none" and sensor.deliver == "colour"
    developed = colour or sensor.curve != "linear" or sensor.isp.active
    adc_bits = max(sensor.bits, _DEVELOPED_BITS) if developed else sensor.bits
    scale = (2**adc_bits - 1) / (2**sensor.bits - 1)
    black_dn = float(sensor.black_level_dn)
    gain = sensor.gain_dn_per_e
    if gain is None:
        gain = (2**sensor.bits - 1 - black_dn) / float(sensor.full_well_e)
    return DataSheet(
        bits=int(sensor.bits),
        adc_bits=int(adc_bits),
        stored_shift=16 - sensor.bits if sensor.bits in (10, 12) else 0,
        gain_dn_per_e=float(gain) * scale,
        black_level_dn=black_dn * scale,
        full_well_e=float(sensor.full_well_e),
        read_noise_e=float(sensor.read_noise_e),
        dark_e=float(sensor.dark_current_e_s) * exposure_s,
        prnu=float(sensor.prnu),
        dsnu_e=float(sensor.dsnu_e),
        shot_noise=sensor.shot_noise,
        mosaic=sensor.mosaic,
        deliver=sensor.deliver,
        curve=sensor.curve,
        gamma=float(sensor.gamma),
        isp=sensor.isp if sensor.isp.active else None,
    )
