"""Response curve of an image: how its levels depend on the light, as a record with its source, and its parser."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.camera.srgb import linear_to_srgb, srgb_to_linear
from roundel.scenes.errors import UsageError, did_you_mean

Array = NDArray[np.float64]

ESTIMATE = "estimate"
_WORDS = ("linear", "srgb", "gamma:2.2", ESTIMATE)
_GAMMA = "gamma:"
_GAMMA_LIMITS = (0.2, 5.0)  # beyond, 8-bit levels have no shades left at one end


@dataclass(frozen=True)
class ResponseCurve:
    """A curve that maps light to levels, both as fractions of their range.

    Attributes
    ----------
    kind : str
        `linear`, `srgb` (IEC 61966-2-1), `gamma` (level = light^(1/gamma)), or `unknown`: linear or sRGB.
    gamma : float
        Exponent of the kind `gamma`; 1 otherwise.
    basis : str
        How the curve is known, such as `as given`; empty if nobody recorded it.
    """

    kind: str
    gamma: float = 1.0
    basis: str = ""

    @property
    def known(self) -> bool:
        """Whether levels can be converted to light."""
        return self.kind != "unknown"

    @property
    def identity(self) -> bool:
        """Whether `light` returns its argument: the curve is linear, or unknown."""
        return self.kind in ("linear", "unknown")

    def light(self, level: ArrayLike) -> Array:
        """Light (...) of levels (...) from 0 to 1; levels themselves if the curve is unknown."""
        levels = np.asarray(level, dtype=np.float64)
        if self.kind == "srgb":
            return srgb_to_linear(levels)
        if self.kind == "gamma":
            return np.asarray(np.maximum(levels, 0.0) ** self.gamma)
        return levels

    def level(self, light: ArrayLike) -> Array:
        """Levels (...) of light (...) from 0 to 1: the inverse of `light`."""
        values = np.asarray(light, dtype=np.float64)
        if self.kind == "srgb":
            return linear_to_srgb(values)
        if self.kind == "gamma":
            return np.asarray(np.maximum(values, 0.0) ** (1.0 / self.gamma))
        return values

    def because(self, basis: str) -> ResponseCurve:
        """The same curve with another basis."""
        return replace(self, basis=basis)

    def __str__(self) -> str:
        return f"{_GAMMA}{self.gamma:g}" if self.kind == "gamma" else self.kind


LINEAR = ResponseCurve("linear")
SRGB = ResponseCurve("srgb")
UNKNOWN = ResponseCurve("unknown")


def gamma_curve(gamma: float, basis: str = "") -> ResponseCurve:
    """The curve level = light^(1/gamma); `linear` if gamma is 1."""
    return ResponseCurve("linear", 1.0, basis) if gamma == 1.0 else ResponseCurve("gamma", float(gamma), basis)


def parse_curve(text: str) -> ResponseCurve | None:
    """The curve of an argument `linear`, `srgb` or `gamma:2.2`; None for `estimate`.

    Raises
    ------
    UsageError
        If there is no such curve, or its exponent is not a number from 0.2 to 5.
    """
    if not isinstance(text, str):
        raise UsageError(f"the curve must be one of {', '.join(_WORDS)}, not {text!r}")
    word = text.strip().lower()
    if word == ESTIMATE:
        return None
    if word in ("linear", "srgb"):
        return ResponseCurve(word, basis="as given")
    if word.startswith(_GAMMA):
        try:
            gamma = float(word.removeprefix(_GAMMA))
        except ValueError:
            gamma = math.nan
        low, high = _GAMMA_LIMITS
        if not low <= gamma <= high:
            raise UsageError(f"curve {text!r}: the exponent must be a number from {low:g} to {high:g}, as in gamma:2.2")
        return gamma_curve(gamma, "as given")
    hint = did_you_mean(word, (*_WORDS, "gamma")) or f"use {', '.join(_WORDS[:-1])} or {_WORDS[-1]}"
    raise UsageError(f"unknown curve {text!r}; {hint.replace('gamma?', 'gamma:2.2?')}")
