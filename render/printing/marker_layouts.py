"""Marker layouts for printing: all sizes follow from one diameter."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from roundel.scenes.errors import StudyError, UsageError, did_you_mean
from roundel.scenes.study.marker_section import CIRCULAR, KINDS
from roundel.scenes.study.study import validated

DEFAULT_DIAMETER_M = 0.08

# Default sizes, in diameters.
_OF_DIAMETER: dict[str, dict[str, float]] = {
    "ring": {"inner_diameter_m": 0.5},
    "two_discs": {"second_diameter_m": 0.5, "spacing_m": 1.0},
    "dot_ring": {"ring_diameter_m": 2.5},
    "disc_with_chessboard": {"gap_m": 0.25},
    "disc_with_charuco": {"gap_m": 0.25},
}
_RINGS = (1.0, 0.7, 0.4)
# simittag's s16m, ID 0x1234: four rings of 24 cells.
_CODE = ("111010110010110100010010", "000000000101011110010010", "000000110001001011010001", "000000001111000010000111")
_BOARDS: dict[str, dict[str, Any]] = {
    "chessboard": {"columns": 8, "rows": 5, "square_m": 0.02},
    "charuco": {"columns": 8, "rows": 5, "square_m": 0.022, "tag_m": 0.016},
    "tags": {"tag_m": 0.08},
    "stag": {"tag_m": 0.08},
    "circle_grid": {"columns": 7, "rows": 5, "spacing_m": 0.025, "diameter_m": 0.015},
    "dot_ring": {"dots": 6},
    "coded_rings": {"code": list(_CODE)},
}
# Keys that apply to rendering only: printer, paper and surroundings determine them.
RENDERED = ("ink", "paper", "wall", "edge_softness_m", "grain", "grain_m", "surface", "clutter")


def marker_to_print(kind: str, diameter_m: float | None, keys: dict[str, Any]) -> Any:
    """Section of the marker to print.

    Parameters
    ----------
    kind : str
        One of `scenes.marker_section.KINDS`.
    diameter_m : float or None
        Outer diameter of the circle, that of the circle around a dot code, or of a dot in a ring of dots.
    keys : dict
        Keys of the section, which override the defaults.

    Raises
    ------
    UsageError
        If a kind or key is unknown, or a value is wrong.
    """
    if kind not in KINDS:
        hint = did_you_mean(kind, KINDS) or f"use one of {', '.join(KINDS)}"
        raise UsageError(f"unknown kind of marker {kind!r}; {hint}")
    if diameter_m is not None and kind not in CIRCULAR:
        raise UsageError(f"a {kind} has no diameter; give its sizes with --set, such as --set square_m=0.02")
    for key in keys:
        if key in RENDERED:
            raise UsageError(f"--set {key}: applies to rendering only, not to printing")
    try:
        section: Any = validated(KINDS[kind], _raw(kind, diameter_m, keys), Path(kind), {}, None)
    except StudyError as error:
        raise UsageError(f"marker {kind}: {error.reason}") from error
    drawn = [name for name, value in section if type(value).__name__ == "Spread"]
    if drawn:
        raise UsageError(f"--set {drawn[0]}: a printed marker has a fixed size; give a number")
    return section


def _raw(kind: str, diameter_m: float | None, keys: dict[str, Any]) -> dict[str, Any]:
    raw: dict[str, Any] = {"kind": kind, **_BOARDS.get(kind, {})}
    if kind in CIRCULAR:
        diameter = DEFAULT_DIAMETER_M if diameter_m is None else diameter_m
        if kind == "rings":
            raw["diameters_m"] = [round(diameter * share, 9) for share in _RINGS]
        else:
            raw["diameter_m"] = diameter
            raw |= {name: round(diameter * share, 9) for name, share in _OF_DIAMETER.get(kind, {}).items()}
        if kind == "disc_with_chessboard":
            raw["chessboard"] = {"columns": 4, "rows": 3, "square_m": round(diameter / 4, 9)}
        if kind == "disc_with_charuco":
            square, tag = round(diameter / 4, 9), round(diameter * 0.18, 9)
            raw["charuco"] = {"columns": 5, "rows": 4, "square_m": square, "tag_m": tag}
    for name, value in keys.items():
        outer, dot, inner = name.partition(".")
        if dot:
            raw[outer] = (
                {**raw.get(outer, {}), inner: value} if isinstance(raw.get(outer, {}), dict) else {inner: value}
            )
        else:
            raw[name] = value
    return raw


def parse_set(texts: list[str]) -> dict[str, Any]:
    """Arguments `KEY=VALUE` as a mapping; values are numbers, true, false, or lists as in JSON.

    Raises
    ------
    UsageError
        If an argument does not have this form.
    """
    out: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or not key.strip() or not value.strip():
            raise UsageError(f"--set {text}: give KEY=VALUE, such as inner_diameter_m=0.04")
        try:
            out[key.strip()] = json.loads(value)
        except ValueError:
            out[key.strip()] = value.strip()
    return out
