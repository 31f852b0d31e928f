"""Values of a study: a number, or a distribution that each frame draws from.

focal_px: 1280                     a constant
tilt_deg: {grid: [15, 30, 45]}     every combination of all grids is a cell
azimuth_deg: {uniform: [-180, 180]}
distance_D: {loguniform: [5, 50]}
focus_m: {normal: [1.0, 0.1]}      mean and sigma, truncated at 4 sigma
f_number: {choice: [1.8, 2.8, 4]}
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import PlainSerializer, PlainValidator, WithJsonSchema

KINDS = ("grid", "choice", "uniform", "loguniform", "normal")

# A normal distribution is truncated here: 6e-5 of the mass, and a bound that a reader of the study can check.
NORMAL_CUT_SIGMAS = 4.0


@dataclass(frozen=True)
class Spread:
    """A distribution of one value: `kind` is one of KINDS, `args` its numbers."""

    kind: str
    args: tuple[float, ...]

    def bounds(self) -> tuple[float, float]:
        """Smallest and largest value that can be drawn."""
        if self.kind == "normal":
            mean, sigma = self.args
            return mean - NORMAL_CUT_SIGMAS * sigma, mean + NORMAL_CUT_SIGMAS * sigma
        return min(self.args), max(self.args)

    def draw(self, u: float) -> float:
        """The value at quantile u in [0, 1); a grid has no quantile (it is enumerated)."""
        if self.kind == "choice":
            return self.args[min(int(u * len(self.args)), len(self.args) - 1)]
        low, high = self.args
        if self.kind == "uniform":
            return low + (high - low) * u
        if self.kind == "loguniform":
            return math.exp(math.log(low) + (math.log(high) - math.log(low)) * u)
        from scipy.special import ndtr, ndtri

        mean, sigma = self.args
        tail = float(ndtr(-NORMAL_CUT_SIGMAS))
        smallest, largest = self.bounds()
        return min(max(mean + sigma * float(ndtri(tail + (1 - 2 * tail) * u)), smallest), largest)


Value = float | Spread


def is_spread(raw: Any) -> bool:
    """Whether a raw YAML value is a distribution rather than a mapping of keys."""
    return isinstance(raw, dict) and len(raw) == 1 and next(iter(raw)) in KINDS


def _number(raw: Any) -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise ValueError(f"{raw!r} is not a number")
    if not np.isfinite(raw):
        raise ValueError(f"{raw!r} is not finite; give a finite number")
    return float(raw)


def parse_value(raw: Any) -> Value:
    """Read a raw YAML value: a number, or a mapping with one of the five kinds of distribution."""
    if isinstance(raw, Spread):
        return raw
    if not isinstance(raw, dict):
        return _number(raw)
    if len(raw) != 1 or next(iter(raw)) not in KINDS:
        raise ValueError(f"a distribution is one of {', '.join(KINDS)}, as in {{uniform: [1, 2]}}")
    kind, args = next(iter(raw.items()))
    if not isinstance(args, list | tuple) or not args:
        raise ValueError(f"{kind} takes a list of numbers")
    numbers = tuple(_number(a) for a in args)
    if kind in ("uniform", "loguniform", "normal") and len(numbers) != 2:
        raise ValueError(f"{kind} takes two numbers, not {len(numbers)}")
    if kind in ("uniform", "loguniform") and numbers[0] > numbers[1]:
        raise ValueError(f"{kind}: the first number must be the smaller one")
    if kind == "loguniform" and numbers[0] <= 0:
        raise ValueError("loguniform takes positive numbers")
    if kind == "normal" and numbers[1] < 0:
        raise ValueError("normal takes a mean and a sigma that is not negative")
    return Spread(kind, numbers)


def _bounded(low: float, high: float, open_low: bool, what: str) -> Callable[[Any], Value]:
    def check(raw: Any) -> Value:
        value = parse_value(raw)
        smallest, largest = value.bounds() if isinstance(value, Spread) else (value, value)
        if smallest < low or (open_low and smallest <= low) or largest > high:
            offender = smallest if smallest < low or (open_low and smallest <= low) else largest
            raise ValueError(f"{offender:g} is out of range; {what}")
        return value

    return check


def _whole(raw: Any) -> Value:
    """An identity: a whole number, or a `choice` or `grid` of them; no identity is between two others."""
    value = parse_value(raw)
    if isinstance(value, Spread) and value.kind not in ("choice", "grid"):
        raise ValueError(f"an identity has no {value.kind} distribution; use choice or grid")
    for number in value.args if isinstance(value, Spread) else (value,):
        if number < 0 or number != int(number):
            raise ValueError(f"{number:g} is no identity; use a whole number from 0")
    return value


def _level(raw: Any) -> float | str:
    """A level of a sweep: a number, or the word that a key takes, such as `srgb`."""
    if isinstance(raw, str):
        return raw
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise ValueError(f"{raw!r} is not a level; give a number, or a word that the key takes")
    return _number(raw)


def _plain(value: Value) -> Any:
    return {value.kind: list(value.args)} if isinstance(value, Spread) else value


_MEANINGS = {
    "grid": "one cell for each combination of all grids",
    "choice": "one of these, all equally likely",
    "uniform": "smallest and largest value",
    "loguniform": "smallest and largest value; the logarithm is uniform",
    "normal": "mean and standard deviation, cut at 4 standard deviations",
}

_SPREAD_SCHEMA = {
    "anyOf": [
        {"type": "number"},
        *(
            {
                "type": "object",
                "properties": {
                    kind: {"type": "array", "items": {"type": "number"}, "minItems": 1, "description": meaning}
                },
                "required": [kind],
                "additionalProperties": False,
            }
            for kind, meaning in _MEANINGS.items()
        ),
    ]
}


def _value_type(check: Callable[[Any], Value]) -> Any:
    return Annotated[
        Any, PlainValidator(check), PlainSerializer(_plain), WithJsonSchema(_SPREAD_SCHEMA, mode="validation")
    ]


AnyValue = _value_type(parse_value)
Positive = _value_type(_bounded(0.0, math.inf, True, "it must be positive"))
NonNegative = _value_type(_bounded(0.0, math.inf, False, "it must not be negative"))
Fraction = _value_type(_bounded(0.0, 1.0, False, "it must be between 0 and 1"))
Tilt = _value_type(_bounded(0.0, 85.0, False, "a tilt must be between 0 and 85 degrees"))
Turn = _value_type(_bounded(-360.0, 360.0, False, "an angle must be between -360 and 360 degrees"))
Contrast = _value_type(_bounded(-1.0, 1.0, False, "a contrast must be between -1 and 1"))
Magnification = _value_type(_bounded(0.98, 1.02, False, "a relative magnification must be between 0.98 and 1.02"))
Quality = _value_type(_bounded(1.0, 100.0, False, "a JPEG quality must be between 1 and 100"))
# Below this, the sky model's colours are outside the RGB gamut.
Elevation = _value_type(_bounded(5.0, 90.0, False, "an elevation must be between 5 and 90 degrees"))
Turbidity = _value_type(_bounded(1.0, 10.0, False, "a turbidity must be between 1 (clear) and 10 (haze)"))
Roughness = _value_type(_bounded(0.01, 1.0, False, "a roughness must be between 0.01 (a mirror) and 1 (matte)"))
Index = _value_type(_bounded(1.05, 4.0, False, "a refractive index must be between 1.05 and 4"))
Share = _value_type(_bounded(0.0, 1.0, True, "it must be positive and at most 1"))
Identity = _value_type(_whole)
Level = Annotated[
    Any,
    PlainValidator(_level),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}]}, mode="validation"),
]
