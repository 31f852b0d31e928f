"""What holds the sheet: a table, a wall, a box or a stand, and the surface below it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.surroundings.bodies import Body, Material, frame_on, pose_from_axes
from roundel.scenes.surroundings.gravity import Footing
from roundel.scenes.surroundings.objects import paint, standing
from roundel.scenes.surroundings.sheet_place import SheetPlace

Array = NDArray[np.float64]

# Half sides of the land around a ground, and how much lower it lies.
_LAND_M, _LOWER_M = (3000.0, 3000.0, 0.5), 0.05


def support_of(
    kind: str,
    sheet: SheetPlace,
    footing: Footing,
    rng: np.random.Generator,
    floor: float = np.inf,
    in_front: bool = True,
) -> tuple[list[Body], Body, str]:
    """What holds the sheet, the surface that objects stand on, and the name of the support.

    A sheet that lies on the surface has nothing else that holds it. The surface is no higher than `floor` (along up);
    `in_front` tells whether everything else is in front of the sheet's plane, so that this may be a wall.
    """
    up, normal, back = footing.up, sheet.normal, sheet.thickness_m
    heights = sheet.corners @ up
    if footing.posture == "flat":
        level = float(heights.mean() if sheet.curve is None else heights.min()) - back
        if floor < level:
            return [_plinth(sheet, up, level, floor, rng)], surface_at(kind, sheet, up, floor, rng), "box"
        return [], surface_at(kind, sheet, up, level, rng), "ground" if kind == "outdoor" else "table"
    across = np.cross(up, normal)
    across /= np.linalg.norm(across)
    along = np.cross(normal, across)
    spans = [np.ptp(sheet.corners @ axis) / 2 for axis in (across, along)]
    middle = sheet.centre
    if footing.posture == "upright" and kind in ("room", "outdoor") and in_front:
        # The wall, and the ground or a table in front of it.
        level = float(heights.min()) - (rng.uniform(0.6, 1.2) if kind == "outdoor" else rng.uniform(0.05, 0.3))
        size = 6.0 + 4.0 * float(np.linalg.norm(middle))
        # No table between a low camera and the sheet.
        level = min(level, -0.2, floor)
        wall_kind = "brick" if kind == "outdoor" else "plaster"
        colour = (0.38, 0.2, 0.14) if kind == "outdoor" else (0.62, 0.58, 0.52)
        wall = Body(
            "box", pose_from_axes(across, along, normal, middle - (back + 0.1) * normal), np.array([size, size, 0.1]),
            Material(wall_kind, colour, 0.5, int(rng.integers(8))),
        )  # fmt: skip
        return [wall], surface_at(kind, sheet, up, level, rng), "wall"
    margins = rng.uniform(0.015, 0.06, 2) + 0.1 * sheet.size_m
    if footing.posture == "upright":
        depth, drop = float(rng.uniform(0.05, 0.12)), float(rng.uniform(0.01, 0.06))
        low, high = (
            min(float((sheet.corners @ along).min()) - drop, floor),
            float((sheet.corners @ along).max()) + margins[1],
        )
        half = np.array([spans[0] + margins[0], (high - low) / 2, depth])
        centre = middle + ((high + low) / 2 - middle @ along) * along - (back + depth) * normal
        held = Body("box", pose_from_axes(across, along, normal, centre), half, _board(kind, rng))
        level = float(centre @ up) - half[1]
        return [held], surface_at(kind, sheet, up, level, rng), "box"
    half = np.array([spans[0] + margins[0], spans[1] + margins[1], 0.006])
    board = Body(
        "box", pose_from_axes(across, along, normal, middle - (back + half[2]) * normal), half, _board(kind, rng)
    )
    level = min(float(middle @ up - abs(along @ up) * half[1] - abs(normal @ up) * (back + 2 * half[2])), floor)
    foot = middle - (back + 0.03) * normal
    height = max(float(foot @ up) - level, 0.02)
    # A block behind the board holds it up.
    prop = standing(
        "box", np.array([0.02, 0.35 * half[0] + 0.01, height / 2]), foot - height * up - 0.04 * normal, up, 0.0,
        Material("wood", (0.4, 0.26, 0.14), 0.4, int(rng.integers(8))),
    )  # fmt: skip
    return [board, prop], surface_at(kind, sheet, up, level, rng), "stand"


def land_around(ground: Body, up: Array) -> Body:
    """Land as far as one sees, a little lower than the ground: a larger ground would be less exact near the camera."""
    pose = ground.camera_from_body.copy()
    pose[:3, 3] -= (_LOWER_M + _LAND_M[2] - ground.half_m[2]) * up
    return Body("box", pose, np.array(_LAND_M), Material("matte", ground.material.colour))


def _plinth(sheet: SheetPlace, up: Array, level: float, floor: float, rng: np.random.Generator) -> Body:
    """A box under a sheet that lies higher than the surface."""
    x, y = sheet.camera_from_sheet[:3, 0], sheet.camera_from_sheet[:3, 1]
    half = np.array([np.ptp(sheet.corners @ x) / 2 + 0.02, np.ptp(sheet.corners @ y) / 2 + 0.02, (level - floor) / 2])
    centre = sheet.centre + ((level + floor) / 2 - float(sheet.centre @ up)) * up
    return Body("box", pose_from_axes(x, y, up, centre), half, _board("", rng))


def top_of(surface: Body, up: Array) -> float:
    """Height of a surface's upper side, along up."""
    return float(surface.camera_from_body[:3, 3] @ up + surface.half_m[2])


def lowest_of(body: Body, up: Array) -> float:
    """Height of the lowest point of a box or cylinder, along up."""
    along = np.abs(body.camera_from_body[:3, :3].T @ up)
    reach = float(along @ body.half_m)
    if body.shape == "cylinder":
        reach = float(np.hypot(along[0], along[1]) * body.half_m[0] + along[2] * body.half_m[2])
    return float(body.camera_from_body[:3, 3] @ up) - reach


def _board(kind: str, rng: np.random.Generator) -> Material:
    if kind == "workshop":
        return (
            Material("metal", (0.5, 0.52, 0.55), 0.35) if rng.uniform() < 0.5 else Material("plastic", paint(rng), 0.3)
        )
    return Material("cardboard", (0.42, 0.28, 0.16), 0.6, int(rng.integers(8)))


def surface_at(kind: str, sheet: SheetPlace, up: Array, level: float, rng: np.random.Generator) -> Body:
    """Table top, bench, shelf board or ground."""
    far = float(np.linalg.norm(sheet.centre))
    turn = float(rng.uniform(-0.4, 0.4))
    seed = int(rng.integers(8))
    centre = sheet.centre + (level - float(sheet.centre @ up)) * up
    if kind == "outdoor":
        half = np.array([20 + 10 * far, 20 + 10 * far, 0.5])
        material = Material(str(rng.choice(["concrete", "wood"], p=[0.8, 0.2])), (0.3, 0.29, 0.27), 0.6, seed)
    else:
        side = max(0.5, 2.2 * sheet.size_m)
        half = np.array([side * rng.uniform(1.3, 1.9), side * rng.uniform(0.9, 1.2), 0.015])
        wood = (0.32, 0.19, 0.1) if rng.uniform() < 0.5 else (0.55, 0.4, 0.24)
        material = {
            "workshop": Material("metal", (0.55, 0.56, 0.58), 0.3),
            "shelf": Material("wood", (0.6, 0.48, 0.33), 0.35, seed),
        }.get(kind, Material("wood", wood, 0.25, seed))
        x, y = frame_on(up, turn)
        centre = centre + float(rng.uniform(-0.3, 0.3)) * half[0] * x + float(rng.uniform(-0.3, 0.3)) * half[1] * y
    return standing("box", half, centre - 2 * half[2] * up, up, turn, material)
