"""Keys of a sensor, in the terms of EMVA 1288 (release 4.0, linear camera model), and of the image file."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from roundel.scenes.study.section import Section
from roundel.scenes.study.values import Fraction, NonNegative, Positive, Quality, Share


def filters_of(mosaic: str) -> tuple[int, ...]:
    """Filter (0 red, 1 green, 2 blue) of the four pixels of a Bayer cell, row by row, from its name such as `rggb`."""
    return tuple("rgb".index(letter) for letter in mosaic)


class SensorSection(Section):
    """Photons to electrons to digital numbers (DN)."""

    white_level: Positive = Field(
        default=0.8, description="auto-exposure: fraction of the full well that the sheet's white reaches"
    )
    exposure_e: Positive | None = Field(default=None, description="fixed exposure, in electrons for a radiance of 1")
    exposure_ph: Positive | None = Field(
        default=None, description="fixed exposure, in photons for a radiance of 1; quantum_efficiency applies"
    )
    quantum_efficiency: Fraction = Field(default=0.6, description="electrons per photon")
    full_well_e: Positive = Field(default=10_000.0, description="full well, electrons")
    gain_dn_per_e: Positive | None = Field(
        default=None, description="gain, DN per electron; default: the full well spans the range"
    )
    read_noise_e: NonNegative = Field(default=5.0, description="standard deviation of the read noise, electrons")
    dark_current_e_s: NonNegative = Field(
        default=0.0, description="dark current, electrons per second, over motion.exposure_s"
    )
    shot_noise: bool = Field(default=True, description="whether to add photon shot noise (Poisson)")
    prnu: Fraction = Field(
        default=0.0, description="photo response non-uniformity: relative standard deviation of the pixels' sensitivity"
    )
    dsnu_e: NonNegative = Field(
        default=0.0, description="dark signal non-uniformity: standard deviation of the pixels' dark signal, electrons"
    )
    black_level_dn: NonNegative = Field(default=0.0, description="digital number without light, DN")
    bits: Literal[8, 10, 12, 16] = Field(default=8, description="bits per channel of the converter and of the file")
    fill_factor: Share = Field(
        default=1.0, description="fraction of a pixel's area that collects light; the area is a centred square"
    )
    mosaic: Literal["none", "rggb", "bggr", "grbg", "gbrg"] = Field(
        default="none", description="Bayer pattern, named by its first four pixels"
    )
    deliver: Literal["colour", "raw"] = Field(
        default="colour", description="for a mosaic: the demosaiced image, or the raw mosaic"
    )
    white_balance: Literal["auto", "none"] | list[Positive] = Field(
        default="auto", description="auto: makes the sheet's white grey; none; or factors for red, green, blue"
    )
    curve: Literal["linear", "srgb", "gamma"] = Field(default="linear", description="tone curve of the delivered image")
    gamma: Positive = Field(default=2.2, description="exponent of the curve `gamma`: out = in^(1/gamma)")
    jpeg_quality: Quality | None = Field(default=None, description="JPEG quality, 1 to 100; default: a PNG file")

    @property
    def image_suffix(self) -> str:
        """Of the delivered files: .jpg or .png."""
        return ".png" if self.jpeg_quality is None else ".jpg"

    @model_validator(mode="after")
    def _consistent(self) -> SensorSection:
        if self.exposure_e is not None and self.exposure_ph is not None:
            raise ValueError("give exposure_e or exposure_ph, not both")
        if isinstance(self.white_balance, list) and len(self.white_balance) != 3:
            raise ValueError("white_balance takes three factors: red, green, blue")
        colour = self.mosaic != "none" and self.deliver == "colour"
        if self.jpeg_quality is not None and self.bits != 8:
            raise ValueError("a JPEG has 8 bits; leave jpeg_quality out, or set bits: 8")
        if colour and self.bits != 8:
            raise ValueError("a colour image has 8 bits here; deliver: raw keeps the mosaic at 10, 12 or 16")
        if isinstance(self.black_level_dn, float | int) and self.black_level_dn >= 2**self.bits - 1:
            raise ValueError("black_level_dn leaves no range; make it smaller")
        return self
