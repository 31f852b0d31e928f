"""Data sheet of a sensor: the section of a study with all numbers drawn.

The terms are those of EMVA 1288 (release 4.0, linear model): overall gain K in DN an electron, dark signal, PRNU, DSNU.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from roundel.scenes.study.sensor_section import SensorSection

# What is developed further (a curve, colours) is read out with at least as many bits.
_DEVELOPED_BITS = 12


@dataclass(frozen=True)
class DataSheet:
    """Numbers of one sensor. `adc_bits`, `gain_dn_per_e`, `black_level_dn` are of its analogue-to-digital converter.

    Attributes
    ----------
    bits, adc_bits : int
        Of the delivered numbers and of the converter's; they differ where the converter's are developed further.
    stored_shift : int
        A file of 10 or 12 bits holds them in the upper bits of 16: its numbers are DN << stored_shift.
    gain_dn_per_e : float
        Converter's DN an electron, EMVA's K.
    black_level_dn : float
        Converter's DN without any signal.
    full_well_e, read_noise_e, dark_e, dsnu_e : float
        Electrons; `dark_e` is the mean dark signal of one exposure.
    prnu : float
        Standard deviation of the pixels' sensitivity, as a fraction.
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

    @property
    def top_dn(self) -> int:
        """The converter's largest number."""
        return int(2**self.adc_bits - 1)

    @property
    def saturation_dn(self) -> int:
        """The converter's number of a full well: its largest, or less where the gain leaves room."""
        return min(self.top_dn, round(self.full_well_e * self.gain_dn_per_e + self.black_level_dn))

    @property
    def colour(self) -> bool:
        """Whether a colour image is delivered."""
        return self.mosaic != "none" and self.deliver == "colour"

    @property
    def developed(self) -> bool:
        """Whether the delivered numbers are made from the converter's, and not these themselves."""
        return self.colour or self.curve != "linear"

    def record(self) -> dict[str, Any]:
        """As plain values, for cameras.json."""
        kept = asdict(self)
        if self.curve != "gamma":
            del kept["gamma"]
        if self.mosaic == "none":
            del kept["deliver"]
        return kept


def data_sheet(sensor: SensorSection, exposure_s: float) -> DataSheet:
    """The data sheet of a sensor section with all spreads drawn.

    A study gives `gain_dn_per_e` and `black_level_dn` in numbers of `bits`. Where the converter has more bits than are
    delivered both grow with its range, so that a curve or colour changes neither exposure nor saturation.

    Parameters
    ----------
    sensor : SensorSection
    exposure_s : float
        Seconds that the dark current is collected.
    """
    colour = sensor.mosaic != "none" and sensor.deliver == "colour"
    adc_bits = max(sensor.bits, _DEVELOPED_BITS) if colour or sensor.curve != "linear" else sensor.bits
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
    )
