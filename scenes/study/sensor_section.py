"""Keys of a sensor, in the terms of EMVA 1288 (release 4.0, linear camera model), of its processor, and of the file."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from roundel.scenes.study.section import Section
from roundel.scenes.study.values import Contrast, Fraction, NonNegative, Positive, Quality, Share, Spread


def filters_of(mosaic: str) -> tuple[int, ...]:
    """Filter (0 red, 1 green, 2 blue) of the four pixels of a Bayer cell, row by row, from its name such as `rggb`."""
    return tuple("rgb".index(letter) for letter in mosaic)


# What a phone's pictures look like: smooth areas without grain, hard edges with a bright and a dark seam, rich colours.
ISP_PRESETS: dict[str, dict[str, float]] = {
    "none": {},
    "phone": {
        "luma_denoise": 0.012,
        "chroma_denoise": 0.05,
        "black_point": 0.02,
        "white_point": 0.97,
        "contrast": 0.25,
        "saturation": 1.15,
        "sharpen_amount": 0.7,
        "sharpen_radius_px": 1.0,
    },
}


class IspSection(Section):
    """What a camera's image signal processor does to the image after the curve, in this order.

    `isp: phone` is short for `isp: {preset: phone}`. Levels are fractions of the encoded range, from black to white.
    """

    preset: Literal["none", "phone"] = Field(default="none", description="values that the other keys override")
    luma_denoise: Fraction = Field(
        default=0.0,
        description="smoothing of brightness: detail of this standard deviation is halved, weaker detail vanishes; a "
        "fraction of the range",
    )
    chroma_denoise: Fraction = Field(
        default=0.0, description="smoothing of colours, where brightness varies less than this; colour images only"
    )
    denoise_radius_px: int = Field(default=2, ge=1, le=32, description="half width of the window of both, px")
    black_point: Fraction = Field(default=0.0, description="level that becomes black")
    white_point: Fraction = Field(default=1.0, description="level that becomes white")
    contrast: Contrast = Field(
        default=0.0, description="S-curve, from -1 (flat) to 1: the slope of middle grey is 1 + contrast / 2"
    )
    saturation: NonNegative = Field(default=1.0, description="factor on the colours' difference from grey")
    sharpen_amount: NonNegative = Field(
        default=0.0, description="unsharp mask: this times the difference from the blurred brightness is added"
    )
    sharpen_radius_px: Positive = Field(default=1.0, description="standard deviation of that blur, px")

    @property
    def active(self) -> bool:
        """Whether it changes any image; a distribution counts."""
        strengths = (
            "luma_denoise",
            "chroma_denoise",
            "black_point",
            "white_point",
            "contrast",
            "saturation",
            "sharpen_amount",
        )
        return any(getattr(self, name) != type(self).model_fields[name].default for name in strengths)

    @model_validator(mode="before")
    @classmethod
    def _from_preset(cls, raw: Any) -> Any:
        own = {"preset": raw} if isinstance(raw, str) else raw
        if not isinstance(own, dict) or not isinstance(own.get("preset", "none"), str):
            return own
        return {**ISP_PRESETS.get(own.get("preset", "none"), {}), **own}

    @model_validator(mode="after")
    def _white_above_black(self) -> IspSection:
        black, white = self.black_point, self.white_point
        most = black.bounds()[1] if isinstance(black, Spread) else black
        least = white.bounds()[0] if isinstance(white, Spread) else white
        if most >= least:
            raise ValueError("white_point must be above black_point")
        return self


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
    isp: IspSection = Field(
        default=IspSection(), description="processing of the developed image: a preset (none, phone), or its keys"
    )
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
        if self.isp.active and self.mosaic != "none" and not colour:
            raise ValueError("isp: a raw mosaic is delivered as it is; leave isp out, or deliver: colour")
        if isinstance(self.black_level_dn, float | int) and self.black_level_dn >= 2**self.bits - 1:
            raise ValueError("black_level_dn leaves no range; make it smaller")
        return self
