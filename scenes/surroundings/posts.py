"""What holds a sheet that is bent, or that stands beside the first: a board or a can, on a post."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.surroundings.bodies import Body, Material, blocks, pose_from_axes
from roundel.scenes.surroundings.gravity import UPRIGHT_DEG, Footing, pitch_deg, roll_deg
from roundel.scenes.surroundings.objects import paint
from roundel.scenes.surroundings.sheet_place import SheetPlace

Array = NDArray[np.float64]

# Paper is this far from the can that it is glued to, so that a ray never meets the can first.
_GLUE_M = 2e-4
_BOARD_M = 0.004
_POST_M = 0.006
_STEEPEST_DEG = 65.0


def can_axis(sheet: SheetPlace) -> Array:
    """Direction (3,) of the axis of a bent sheet, camera frame, pointing up in the image."""
    assert sheet.curve is not None
    x, y = sheet.curve.axes()[1]
    axis = sheet.camera_from_sheet[:3, :2] @ [x, y]
    return np.asarray(axis if axis[1] < 0 else -axis)


def can_footing(sheet: SheetPlace, footing: Footing) -> Footing:
    """A can stands where the camera then is upright enough; otherwise it is held at a slant."""
    axis = can_axis(sheet)
    if roll_deg(axis) <= UPRIGHT_DEG and abs(pitch_deg(axis)) <= _STEEPEST_DEG:
        return Footing(axis, "standing")
    return footing


def carrier_of(sheet: SheetPlace, rng: np.random.Generator) -> Body:
    """What a sheet is fixed to: a can, if it is bent round one, or else a board behind it."""
    pose, curve = sheet.camera_from_sheet, sheet.curve
    if curve is not None and curve.kind == "cylinder":
        axis = can_axis(sheet)
        along = sheet.corners @ axis
        radius = curve.radius_m - sheet.thickness_m - _GLUE_M
        middle = pose[:3, 3] - curve.radius_m * pose[:3, 2]
        middle = middle + ((along.max() + along.min()) / 2 - middle @ axis) * axis
        half = (along.max() - along.min()) / 2 + float(rng.uniform(0.005, 0.03))
        material = Material("plastic", paint(rng), 0.3) if rng.uniform() < 0.6 else Material("metal", (0.6,) * 3, 0.25)
        place = pose_from_axes(pose[:3, 2], np.cross(axis, pose[:3, 2]), axis, middle)
        return Body("cylinder", place, np.array([radius, radius, half]), material)
    local = (sheet.corners - pose[:3, 3]) @ pose[:3, :3]
    low, high = local.min(axis=0), local.max(axis=0)
    edge = float(rng.uniform(0.004, 0.015))
    half = np.array([*(high[:2] - low[:2]) / 2 + edge, _BOARD_M / 2])
    centre = pose[:3, 3] + pose[:3, :3] @ np.array(
        [*(high[:2] + low[:2]) / 2, low[2] - sheet.thickness_m - _GLUE_M - _BOARD_M / 2]
    )
    material = Material("cardboard", (0.42, 0.28, 0.16), 0.6, int(rng.integers(8)))
    return Body("box", pose_from_axes(pose[:3, 0], pose[:3, 1], pose[:3, 2], centre), half, material)


def post_of(carrier: Body, up: Array, level: float, ceiling: float, others: Sequence[Array]) -> Body | None:
    """A post from a carrier down to the surface, or up to the ceiling where that would hide a marker.

    Parameters
    ----------
    carrier : Body
    up : (3,) array
    level, ceiling : float
        Heights of the surface and of the ceiling, along up.
    others : sequence of (n, 3) arrays
        Points of markers that must be seen.

    Returns
    -------
    Body or None
        None if both would hide a marker.
    """
    back = carrier.camera_from_body[:3, 2] if carrier.shape == "box" else carrier.camera_from_body[:3, 0]
    start = carrier.camera_from_body[:3, 3]
    if carrier.shape == "box":
        start = start - (carrier.half_m[2] + _POST_M) * back
    for end in (level, ceiling):
        length = end - float(start @ up)
        if end == level and length > -_POST_M:
            return None
        axis = up * math.copysign(1.0, length)
        helper = back if abs(back @ axis) < 0.9 else np.roll(back, 1)
        x = helper - (helper @ axis) * axis
        x /= np.linalg.norm(x)
        place = pose_from_axes(x, np.cross(axis, x), axis, start + length / 2 * up)
        post = Body(
            "cylinder", place, np.array([_POST_M, _POST_M, abs(length) / 2]), Material("metal", (0.5, 0.5, 0.52), 0.3)
        )
        if not any(blocks(post, np.zeros(3), points, 1.3).any() for points in others):
            return post
    return None
