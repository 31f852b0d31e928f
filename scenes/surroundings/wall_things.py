"""What hangs on the wall beside a sheet: pictures and switches indoors; windows, pipes and plates outdoors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.surroundings.bodies import Body, Material, blocks, pose_from_axes
from roundel.scenes.surroundings.objects import paint
from roundel.scenes.surroundings.sheet_place import SheetPlace

Array = NDArray[np.float64]

_THINGS, _TRIES = 5, 30
_GAP_M = 0.03
# A pipe or a tall window may go down to the ground and below.
_TALL_M = 0.5
# The half field of view in which things are hung, in distances: that of a wide lens.
_FIELD = 0.75

# Half sides, how far it stands out, and material, from the outer part inward.
_Plate = tuple[float, float, float, Material]


def on_wall(kind: str, sheets: Sequence[SheetPlace], up: Array, level: float, rng: np.random.Generator) -> list[Body]:
    """Things on the wall that the first sheet hangs on, beside it, none over another or in front of a marker.

    Parameters
    ----------
    kind : str
        `outdoor`, or another for indoors.
    sheets : sequence of SheetPlace
    up : (3,) array
        In the wall's plane.
    level : float
        Height of the table or ground before the wall, along up; nothing hangs below it.
    rng : numpy.random.Generator
    """
    sheet = sheets[0]
    normal = sheet.normal
    across = np.cross(up, normal)
    axes = np.stack([across, up])
    origin = sheet.centre - sheet.thickness_m * normal
    flat = (sheet.corners - origin) @ axes.T
    taken = [(flat.min(axis=0), flat.max(axis=0))]
    points = np.concatenate([s.seen + 1e-3 * s.normal for s in sheets])
    reach = _FIELD * float(np.linalg.norm(sheet.centre))
    bodies: list[Body] = []
    for _ in range(_THINGS):
        plates = _outdoors(rng) if kind == "outdoor" else _indoors(rng)
        half = np.array(plates[0][:2])
        for _ in range(_TRIES):
            at = rng.uniform(-reach, reach, 2)
            low, high = at - half - _GAP_M, at + half + _GAP_M
            if low[1] < level - float(origin @ up) and half[1] < _TALL_M:
                continue
            if any(((low < b) & (a < high)).all() for a, b in taken):
                continue
            made = []
            for w, h, out, material in plates:
                centre = origin + axes.T @ at + out / 2 * normal
                made.append(
                    Body("box", pose_from_axes(across, up, normal, centre), np.array([w, h, out / 2]), material)
                )
            if any(blocks(body, np.zeros(3), points, 1.15).any() for body in made):
                continue
            taken.append((low, high))
            bodies += made
            break
    return bodies


def _indoors(rng: np.random.Generator) -> list[_Plate]:
    if rng.uniform() < 0.3:
        white = Material("plastic", (0.75, 0.75, 0.72), 0.25)
        return [(0.04, 0.04, 0.008, white), (0.026, 0.026, 0.012, white)]
    w, h = rng.uniform(0.06, 0.2, 2)
    border = float(rng.uniform(0.008, 0.02))
    frame = (
        Material("wood", (0.25, 0.15, 0.08), 0.4, int(rng.integers(8)))
        if rng.uniform() < 0.6
        else Material("plastic", (0.08, 0.08, 0.08), 0.3)
    )
    mount = Material("matte", (0.72, 0.7, 0.66))
    picture = Material("fabric", paint(rng), 0.5, int(rng.integers(8)))
    inner = 0.7 * np.array([w, h])
    return [
        (w + border, h + border, 0.018, frame),
        (w, h, 0.019, mount),
        (float(inner[0]), float(inner[1]), 0.0195, picture),
    ]


def _outdoors(rng: np.random.Generator) -> list[_Plate]:
    draw = rng.uniform()
    if draw < 0.3:
        pipe = Material("metal", (0.45, 0.42, 0.4), 0.4)
        return [(0.05, 3.0, 0.1, pipe)]
    if draw < 0.6:
        plate = Material("plastic", paint(rng), 0.3)
        w, h = rng.uniform(0.06, 0.16, 2)
        return [(w, h, 0.006, plate), (0.8 * w, 0.75 * h, 0.007, Material("plastic", (0.7, 0.7, 0.66), 0.3))]
    w, h = rng.uniform(0.3, 0.5), rng.uniform(0.4, 0.7)
    frame = Material("plastic", (0.7, 0.69, 0.66), 0.35)
    # A pane before a dark room: a smooth, dark surface that mirrors the sky.
    pane = Material("plastic", (0.015, 0.018, 0.02), 0.02)
    half = (w - 0.09) / 2
    return [(w, h, 0.06, frame), (2 * half, h - 0.06, 0.061, pane), (0.02, h - 0.06, 0.075, frame)]
