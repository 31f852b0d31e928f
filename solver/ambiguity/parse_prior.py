"""Parse prior knowledge from the text of `--knowledge` and of a study's `solve.knowledge`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from roundel.scenes.errors import UsageError, did_you_mean
from roundel.solver.ambiguity.concentric_circle import ConcentricCircle
from roundel.solver.ambiguity.disambiguation import KNOWLEDGE, Knowledge, check_knowledge, named
from roundel.solver.ambiguity.normal_prior import NormalPrior, on_ceiling, on_floor, on_wall
from roundel.solver.ambiguity.observation import Evidence
from roundel.solver.ambiguity.pattern_cue import orientation_tick

_PLACES: dict[str, Callable[..., Evidence]] = {"floor": on_floor, "ceiling": on_ceiling, "wall": on_wall}
_MARKS: tuple[str, ...] = ("circle", "tick")
_WORDS = ("none", *KNOWLEDGE, "normal", *_PLACES, *_MARKS)


def parse_knowledge(text: str) -> Knowledge:
    """Parse prior knowledge; several pieces are joined by `+`.

    - `none`
    - `same_side`, `opposite_side`
    - `coplanar`: all circles of an image lie in one plane and have one size
    - `normal:X,Y,Z[:SPREAD_DEG]`: out of the printed face, in the camera frame (x right, y down, z forward)
    - `floor`, `ceiling`, `wall`, each with `[:GX,GY,GZ][:SPREAD_DEG]`: gravity in the camera frame; by default the
      image is upright (floor, ceiling) or the camera level (wall)
    - `circle:RATIO`: a dot or the inner edge of a ring, its diameter as a fraction of the outer diameter
    - `tick`: the bar of paper on the marker `disc_with_tick`

    Raises
    ------
    UsageError
        If it is none of these, or a number is missing or out of range.
    """
    words = [word.strip() for word in text.split("+")]
    if words == ["none"]:
        return None
    pieces = tuple(_piece(word) for word in words)
    try:
        check_knowledge(pieces)
    except UsageError as error:
        raise UsageError(f"--knowledge {text}: {error}") from error
    return pieces


def _piece(text: str) -> Evidence:
    name, *values = text.split(":")
    if name in KNOWLEDGE and not values:
        return named(name)
    if name == "normal" and 1 <= len(values) <= 2:
        spread = _number(text, values[1]) if len(values) == 2 else 10.0
        return NormalPrior(np.array(_vector(text, values[0])), spread)
    if name in _PLACES and len(values) <= 2:
        gravity = _vector(text, values[0]) if values and "," in values[0] else None
        rest = values[1:] if gravity is not None else values
        if len(rest) <= 1:
            return _PLACES[name](gravity, *[_number(text, value) for value in rest])
    if name == "circle" and len(values) == 1:
        return ConcentricCircle(_number(text, values[0]))
    if name == "tick" and not values:
        return orientation_tick()
    if name in _WORDS:
        form = {
            "normal": "normal:X,Y,Z or normal:X,Y,Z:SPREAD_DEG",
            "circle": "circle:RATIO, for example circle:0.5",
            **{place: f"{place}, {place}:SPREAD_DEG or {place}:GX,GY,GZ:SPREAD_DEG" for place in _PLACES},
        }.get(name, name)
        raise UsageError(f"--knowledge {text}: write {form}")
    hint = did_you_mean(name, _WORDS) or f"use one of {', '.join(_WORDS)}"
    raise UsageError(f"--knowledge {text}: unknown; {hint}")


def _number(text: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise UsageError(f"--knowledge {text}: {value!r} is not a number")
    return number


def _vector(text: str, values: str) -> tuple[float, ...]:
    parts = values.split(",")
    if len(parts) != 3:
        raise UsageError(f"--knowledge {text}: a direction has three numbers, like 0,1,0; {values!r} has {len(parts)}")
    return tuple(_number(text, part) for part in parts)


def mark_of(kind: str, diameter_m: float, layout: dict[str, Any]) -> Evidence | None:
    """The cue of a marker's own print, by its kind and layout in `cameras.json`; None for a plain disc."""
    if kind == "ring":
        return ConcentricCircle(float(layout["inner_diameter_m"]) / diameter_m)
    if kind == "rings":
        inner = [float(d) / diameter_m for d in layout["diameters_m"][-2:]]
        return ConcentricCircle(inner[1], inner[0])
    if kind == "disc_with_tick":
        radius = diameter_m / 2
        return orientation_tick(*(float(layout[key]) / radius for key in ("tick_from_m", "tick_to_m", "tick_width_m")))
    return None
