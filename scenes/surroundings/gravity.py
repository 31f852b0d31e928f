"""Which way is up: gravity and a support for a sheet whose pose in the camera is given.

The pose comes first. Up is then chosen such that the sheet rests on something plausible (flat on a table, upright on a
wall or a box, leaning on a stand) and the camera is held upright, within some 30 degrees, where the pose allows it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Beyond this, a camera is not held upright any more.
UPRIGHT_DEG = 30.0
_STEEPEST_DEG = 65.0


@dataclass(frozen=True, eq=False)
class Footing:
    """The direction against gravity in the camera frame, and how the sheet is held: `flat`, `upright`, `leaning`."""

    up: Array
    posture: str


def roll_deg(up: Array) -> float:
    """Angle by which the camera is rolled about its axis; 0 where it looks straight up or down, and has none."""
    across = math.hypot(float(up[0]), float(up[1]))
    return 0.0 if across < 0.35 else abs(math.degrees(math.atan2(float(up[0]), -float(up[1]))))


def pitch_deg(up: Array) -> float:
    """Angle by which the camera looks below the horizon."""
    return math.degrees(math.asin(float(np.clip(-up[2], -1.0, 1.0))))


def footing_of(
    normal: Array, centre: Array, size_m: float, rng: np.random.Generator, prefer: str, on_wall: bool = False
) -> Footing:
    """Up and posture of a sheet.

    Parameters
    ----------
    normal : (3,) array
        Out of the printed face, camera frame.
    centre : (3,) array
        The middle of the sheet.
    size_m : float
        Its longest extent from there.
    rng : numpy.random.Generator
    prefer : str
        The posture to take where several are plausible.
    on_wall : bool
        Whether an upright sheet hangs on a wall; it stands on a table otherwise, whose top the camera must see.
    """
    tilt, roll = math.radians(rng.uniform(8.0, 35.0)), math.radians(rng.uniform(-6.0, 6.0))
    held = np.array([math.sin(roll) * math.cos(tilt), -math.cos(roll) * math.cos(tilt), -math.sin(tilt)])
    upright = held - (held @ normal) * normal
    length = float(np.linalg.norm(upright))
    candidates = {"flat": normal, "leaning": held}
    if length > 0.3:
        candidates["upright"] = upright / length
    costs = {name: _cost(name, up, normal) - 0.5 * (name == prefer) for name, up in candidates.items()}
    for name, up in candidates.items():
        if centre @ up > 0.7 * size_m and not (on_wall and name == "upright"):
            costs[name] += 5.0  # the camera is below the table
    posture = min(costs, key=lambda name: costs[name])
    return Footing(candidates[posture], posture)


def _cost(posture: str, up: Array, normal: Array) -> float:
    """How implausible a posture is: 0 is what one sees every day."""
    cost = 10.0 if roll_deg(up) > UPRIGHT_DEG else 0.0
    # Straight down is how one photographs a table: there, steepness is no fault.
    if posture != "flat":
        cost += max(0.0, abs(pitch_deg(up)) - _STEEPEST_DEG) / 10.0
    if posture == "leaning":
        # A sheet that leans is less usual than one that lies or hangs, and one that faces the floor hardly ever is.
        cost += 0.6 + max(0.0, -float(normal @ up)) * 5.0
    return cost
