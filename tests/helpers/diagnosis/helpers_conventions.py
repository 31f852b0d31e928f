"""Files of estimates in ten wrong conventions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

STUDY = """\
schema: 1
name: spread
seed: 8
mode: points
camera: {width_px: 1280, height_px: 720, focal_px: 1000}
marker: {kind: disc, diameter_m: 0.08}
pose:
  tilt_deg: {uniform: [20, 55]}
  distance_D: {uniform: [6, 20]}
  azimuth_deg: {uniform: [-180, 180]}
  offset_x_px: {uniform: [-450, 450]}
  offset_y_px: {uniform: [-240, 240]}
frames: 60
"""
NORMAL = [f"normal_{a}" for a in "xyz"]
CENTRE = [f"centre_{a}_m" for a in "xyz"]
ELLIPSE = [f"ellipse_{n}" for n in ("x_px", "y_px", "a_px", "b_px", "angle_deg")]
Row = dict[str, Any]
Change = Callable[[Row, str], Row]


def scaled(names: list[str], factor: float) -> Change:
    return lambda row, part: {name: factor * row[name] for name in names}


def shifted(by_px: float) -> Change:
    def change(row: Row, part: str) -> Row:
        if part == "ellipse":
            return {name: row[name] + by_px for name in ELLIPSE[:2]}
        return {name: row[name] + by_px * row["centre_z_m"] / row["fx_px"] for name in CENTRE[:2]}

    return change


def upwards(row: Row, part: str) -> Row:
    if part == "ellipse":
        return {ELLIPSE[1]: 719 - row[ELLIPSE[1]], ELLIPSE[4]: -row[ELLIPSE[4]]}
    return {name: -row[name] for name in ("normal_y", "centre_y_m")}


# What a program does wrong, and the parts of its estimates that show it.
WRONG = {
    "full_axes": (scaled(ELLIPSE[2:4], 2), ("ellipse",)),
    "radians": (scaled(ELLIPSE[4:], np.pi / 180), ("ellipse",)),
    "half_pixel": (shifted(0.5), ("ellipse", "pose")),
    "frame_numbers": (lambda row, part: {"frame_id": row["frame_id"] + 1}, ("ellipse", "pose")),
    "y_upwards": (upwards, ("ellipse", "pose")),
    "swapped_xy": (
        lambda row, part: {
            ELLIPSE[0]: row[ELLIPSE[1]], ELLIPSE[1]: row[ELLIPSE[0]], ELLIPSE[4]: 90 - row[ELLIPSE[4]]
        },
        ("ellipse",),
    ),
    "centimetres": (scaled(CENTRE, 100), ("pose",)),
    "millimetres": (scaled(CENTRE, 1000), ("pose",)),
    "opengl_axes": (
        lambda row, part: {n: -row[n] for n in ("normal_y", "normal_z", "centre_y_m", "centre_z_m")}, ("pose",)
    ),
    "flipped_normals": (scaled(NORMAL, -1), ("pose",)),
}  # fmt: skip


def write(file: Path, rows: list[Row], part: str) -> Path:
    names = ELLIPSE if part == "ellipse" else [*NORMAL, *CENTRE]
    pa_csv.write_csv(pa.Table.from_pylist([{n: row[n] for n in ("frame_id", *names)} for row in rows]), file)
    return file
