"""What is known about the levels of one image: response curve, rounding, and processing by the camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.response_curve import LINEAR, ResponseCurve
from roundel.solver.photometry.jpeg_rounding import JpegEdge, jpeg_edge
from roundel.solver.photometry.processing_displacement import processing_displacement_px

ROUNDING = 1 / 12  # variance of a rounding to whole steps, in steps^2
_SAMPLE = 4096
_EIGHT_BITS = 255.0
# Interpolation between the pixels of a mosaic leaves colours along an edge. JPEG smooths them away in encoded levels,
# whose mean is darker than that of the light: as much as its quantisation displaces the edge itself, up to a limit.
# Measured with `benchmarks/solver/uncertainty/bayer_jpeg.yaml`: 0.005 px at a quality of 98, 0.017 px at 75 and 60.
_COLOUR_PX, _COLOUR_LOST_PX = 0.005, 0.012


@dataclass(frozen=True)
class Photometry:
    """How the levels of an image came about.

    Attributes
    ----------
    curve : ResponseCurve
        The curve that was undone; `unknown` if the levels are as delivered and may be linear or sRGB.
    top_dn : float
        The level that the curve maps to 1; the range of delivered and of linear levels.
    step_dn : float
        Distance of neighbouring delivered levels; 0 if they are not rounded.
    averaged : float
        Fraction of the rounding's variance that is left in grey: the sum of the squared weights of the colours.
    jpeg : tuple of 64 int, or None
        The luminance table of a JPEG file.
    sharpened, toned : bool
        Whether the camera is known to have sharpened the image, or to have applied a tone curve beside `curve`.
    """

    curve: ResponseCurve = LINEAR
    top_dn: float = 255.0
    step_dn: float = 0.0
    averaged: float = 1.0
    jpeg: tuple[int, ...] | None = None
    sharpened: bool = False
    toned: bool = False

    def with_curve(self, curve: ResponseCurve) -> Photometry:
        """The same image with another curve undone."""
        return replace(self, curve=curve)

    def light_per_level(self, light_dn: float) -> float:
        """Derivative of the linear level by the delivered level, at a linear level."""
        if self.curve.identity:
            return 1.0
        level = float(self.curve.level(min(max(light_dn / self.top_dn, 0.0), 1.0)))
        # Over one step of the file, because a pure power has no slope at 0.
        half = max(self.step_dn / self.top_dn, 1e-4) / 2
        low, high = self.curve.light([max(level - half, 0.0), level + half])
        return float(high - low) / (level + half - max(level - half, 0.0))

    def noise_floor(self, inside_dn: float, outside_dn: float, blur_px: float) -> Callable[[float], float]:
        """Variance of a pixel by rounding alone, dn^2, as a function of its linear level.

        Rounding to levels, and, for a JPEG, the rounding of the coefficients of blocks with an edge between the two
        given levels.

        Parameters
        ----------
        inside_dn, outside_dn : float
            Linear levels on both sides of the edge.
        blur_px : float
            Gaussian sigma of its blur.
        """
        variance = ROUNDING * self.step_dn**2 * self.averaged
        if self.jpeg is not None:
            variance += self._jpeg_edge(inside_dn, outside_dn, blur_px).variance * (self.top_dn / _EIGHT_BITS) ** 2

        def at(level_dn: float) -> float:
            return variance * self.light_per_level(level_dn) ** 2

        return at

    def displacement_px(self, inside_dn: float, outside_dn: float, blur_px: float) -> float:
        """Distance, toward the outside, by which a JPEG displaces an edge between two linear levels.

        Its quantisation, and in a colour image the loss of the colours along the edge.
        """
        if self.jpeg is None:
            return 0.0
        shift = self._jpeg_edge(inside_dn, outside_dn, blur_px).displacement_px
        if self.averaged < 1.0 and not self.curve.identity:
            shift += math.copysign(_COLOUR_PX + min(abs(shift), _COLOUR_LOST_PX), outside_dn - inside_dn)
        return shift

    def processed_px(self, inside_dn: float, outside_dn: float, blur_px: float, sharpened: bool) -> float:
        """Standard deviation of an edge's place, toward either side, by the camera's processing.

        That of typical strength, because the strength is not known; `sharpened` if the image is.
        """
        light = inside_dn / self.top_dn, outside_dn / self.top_dn
        return abs(processing_displacement_px(self.curve, *light, blur_px, sharpened, self.toned))

    def _jpeg_edge(self, inside_dn: float, outside_dn: float, blur_px: float) -> JpegEdge:
        assert self.jpeg is not None
        light = np.clip(np.array([inside_dn, outside_dn]) / self.top_dn, 0.0, 1.0)
        inside, outside = (float(v) for v in self.curve.level(light) * _EIGHT_BITS)
        return jpeg_edge(self.jpeg, self.curve, inside, outside, blur_px)


PLAIN = Photometry()


def level_step(image: NDArray[Any], top_dn: float) -> float:
    """Distance of neighbouring levels of an array: 1 for integers; 0 for real numbers that are no 8-bit levels."""
    if image.dtype.kind in "iub":
        return 1.0
    if top_dn not in (1.0, _EIGHT_BITS):
        return 0.0
    # Images divided by 255 are common.
    flat = image.reshape(-1)
    some = flat[:: max(1, len(flat) // _SAMPLE)].astype(np.float64) * (_EIGHT_BITS / top_dn)
    rounded = bool(np.all(np.abs(some - np.rint(some)) < 1e-3))
    return top_dn / _EIGHT_BITS if rounded else 0.0


def processing_of(isp: Mapping[str, Any] | None) -> tuple[bool, bool]:
    """Whether a processor's record, as in cameras.json, says that it sharpened and that it changed the tone."""
    if not isp:
        return False, False
    toned = (isp.get("black_point", 0.0), isp.get("white_point", 1.0), isp.get("contrast", 0.0)) != (0.0, 1.0, 0.0)
    return bool(isp.get("sharpen_amount", 0.0)), toned
