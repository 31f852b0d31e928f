"""A closed room with a window and a lamp, or the sun outdoors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.surroundings.bodies import Body, Material, Panel, frame_on, pose_from_axes
from roundel.scenes.surroundings.sheet_place import SheetPlace

Array = NDArray[np.float64]

_TABLE_M = 0.75
_TRIES = 40


def room_of(
    kind: str,
    sheet: SheetPlace,
    up: Array,
    level: float,
    support: str,
    rng: np.random.Generator,
    others: Array,
) -> tuple[list[Body], list[Panel]]:
    """Floor, walls and ceiling around camera and sheet, with a window and a lamp on the sheet's bright side.

    `others` (n, 3) are points that must be in the room, too.
    """
    x, y = frame_on(up, float(rng.uniform(-0.3, 0.3)))
    if support == "wall":
        # The sheet's wall is one of the room's.
        y = sheet.normal
        x = np.cross(y, up)
    elif sheet.centre @ y > 0:
        # The camera looks along -y, roughly: the wall at the low end stands behind the sheet.
        x, y = -x, -y
    points = np.vstack([sheet.corners, np.zeros((1, 3)), others])
    margin = float(rng.uniform(1.0, 1.8))
    low, high = (points @ np.stack([x, y, up]).T).min(axis=0), (points @ np.stack([x, y, up]).T).max(axis=0)
    low, high = low - margin, high + margin
    if support == "wall":
        low[1] = float((sheet.corners @ y).mean()) - sheet.thickness_m
        high[1] += 1.0
    if kind == "shelf":
        # The board is fixed to a wall that stands close behind it.
        low[1] = float((np.vstack([sheet.corners, others]) @ y).min()) - float(rng.uniform(0.25, 0.4))
    low[2] = min(level - (_TABLE_M if support != "ground" else 0.0), -0.25)
    high[2] = max(high[2] - margin + 0.6, low[2] + 2.5)
    middle, half = (low + high) / 2, (high - low) / 2
    axes = np.stack([x, y, up])
    shade = float(rng.uniform(0.45, 0.72))
    wall = {"workshop": ("concrete", (0.45, 0.45, 0.44)), "shelf": ("plaster", (0.66, 0.62, 0.55))}.get(
        kind, ("plaster", (shade, 0.96 * shade, 0.9 * shade))
    )
    floor = ("concrete", (0.35, 0.35, 0.34)) if kind == "workshop" else ("wood", (0.33, 0.22, 0.13))
    bodies = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            if support == "wall" and axis == 1 and sign < 0:
                continue
            thick = half + 0.1
            thick[axis] = 0.05
            place = middle.copy()
            place[axis] += sign * (half[axis] + 0.05)
            kind_of, colour = floor if axis == 2 and sign < 0 else wall
            if axis == 2 and sign > 0:
                kind_of, colour = "matte", (0.78, 0.78, 0.76)
            material = Material(kind_of, colour, 0.5, int(rng.integers(8)))
            bodies.append(Body("box", pose_from_axes(x, y, up, place @ axes), thick, material))
    return bodies, _lights(sheet, axes, middle, half, rng)


def _lights(sheet: SheetPlace, axes: Array, middle: Array, half: Array, rng: np.random.Generator) -> list[Panel]:
    """A window in the wall that the sheet faces most, beside it or opposite, and a lamp on the ceiling."""
    centre = axes @ sheet.centre
    facing = axes @ sheet.normal
    choices = []
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            place = middle.copy()
            place[axis] = middle[axis] + sign * (half[axis] - 0.002)
            place[2] = min(middle[2] + half[2] - 0.9, max(centre[2] + 0.4, middle[2]))
            toward = place - centre
            choices.append(
                (float(toward @ facing) / float(np.linalg.norm(toward)) + rng.uniform(0, 0.25), axis, sign, place)
            )
    _, axis, sign, place = max(choices, key=lambda choice: choice[0])
    other = 1 - axis
    place[other] = np.clip(
        centre[other] + rng.uniform(-0.5, 0.5), middle[other] - half[other] + 0.8, middle[other] + half[other] - 0.8
    )
    inward = np.zeros(3)
    inward[axis] = -sign
    upward = np.array([0.0, 0.0, 1.0])
    window = Panel(
        pose_from_axes(axes.T @ np.cross(upward, inward), axes.T @ upward, axes.T @ inward, place @ axes),
        (float(rng.uniform(0.5, 0.8)), float(rng.uniform(0.5, 0.7))),
        float(rng.uniform(6.0, 11.0)),
        (0.9, 0.97, 1.1),
    )
    spot = middle.copy()
    spot[:2] = np.clip(
        centre[:2] + facing[:2] * 0.8 + rng.uniform(-0.4, 0.4, 2),
        middle[:2] - half[:2] + 0.4,
        middle[:2] + half[:2] - 0.4,
    )
    spot[2] = middle[2] + half[2] - 0.02
    lamp = Panel(
        pose_from_axes(axes[0], -axes[1], -axes[2], spot @ axes),
        (0.3, 0.3),
        float(rng.uniform(5.0, 12.0)),
        (1.15, 0.98, 0.78),
    )
    return [window, lamp]


def sun_of(sheet: SheetPlace, up: Array, rng: np.random.Generator) -> Array:
    """A direction of the sun that lights the printed face, between 20 and 65 degrees above the horizon."""
    best, x_y = None, frame_on(up, 0.0)
    for _ in range(_TRIES):
        elevation, azimuth = np.radians(rng.uniform(20.0, 65.0)), rng.uniform(0.0, 2 * np.pi)
        toward = np.cos(elevation) * (np.cos(azimuth) * x_y[0] + np.sin(azimuth) * x_y[1]) + np.sin(elevation) * up
        if toward @ sheet.normal > 0.35:
            return np.asarray(toward)
        best = toward if best is None or toward @ sheet.normal > best @ sheet.normal else best
    assert best is not None
    return np.asarray(best)
