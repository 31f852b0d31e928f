"""The places: tabletop, room, shelf, workshop and outdoors, built around a sheet that stands already.

Every number comes from one generator, which nothing else uses: the world changes no pose.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.surroundings.bodies import Body, Panel, Surroundings, blocks, frame_on
from roundel.scenes.surroundings.gravity import footing_of
from roundel.scenes.surroundings.objects import HOUSEHOLD, STREET, WORKSHOP, Maker
from roundel.scenes.surroundings.rooms import room_of, sun_of
from roundel.scenes.surroundings.sheet_place import SheetPlace
from roundel.scenes.surroundings.supports import support_of, top_of

Array = NDArray[np.float64]

_PREFERRED = {"tabletop": "flat", "room": "upright", "shelf": "upright", "workshop": "flat", "outdoor": "upright"}
_MAKERS: dict[str, tuple[Maker, ...]] = {"workshop": WORKSHOP, "outdoor": STREET}
_PLACEMENTS = 8
_TRIES = 40
# An object's box grows by this factor before it is tested, so that none touches the line of sight.
_CLEARANCE = 1.15


def surroundings_of(kind: str, sheet: SheetPlace, objects: int, rng: np.random.Generator) -> Surroundings:
    """The world around a sheet.

    Parameters
    ----------
    kind : str
        `tabletop`, `room`, `shelf`, `workshop` or `outdoor`.
    sheet : SheetPlace
    objects : int
        How many are tried; one that would hide the marker or stand in another is left out after some tries.
    rng : numpy.random.Generator

    Raises
    ------
    ValueError
        If nothing can be built so that the marker is seen.
    """
    reason = ""
    for attempt in rng.spawn(_PLACEMENTS):
        try:
            return _placed(kind, sheet, objects, attempt)
        except ValueError as error:
            reason = str(error)
    raise ValueError(f"{reason} ({_PLACEMENTS} placements were tried)")


def _placed(kind: str, sheet: SheetPlace, objects: int, rng: np.random.Generator) -> Surroundings:
    footing = footing_of(
        sheet.normal, sheet.centre, sheet.size_m, rng, _PREFERRED[kind], on_wall=kind in ("room", "outdoor")
    )
    up = footing.up
    supports, surface, support = support_of(kind, sheet, footing, rng)
    shell: list[Body] = []
    panels: list[Panel] = []
    sun = None
    if kind == "outdoor":
        sun = sun_of(sheet, up, rng)
    else:
        shell, panels = room_of(kind, sheet, up, top_of(surface, up), support, rng)
    fixed = [*supports, *shell]
    _check_seen([*fixed, surface], sheet)
    things = _objects(_MAKERS.get(kind, HOUSEHOLD), sheet, up, surface, fixed, objects, rng)
    return Surroundings(up, support, [*fixed, surface, *things], panels, sun, sheet.thickness_m)


def _check_seen(bodies: Sequence[Body], sheet: SheetPlace) -> None:
    eye = np.zeros(3)
    # Just before the paper: its support touches it.
    points = sheet.seen + 1e-3 * sheet.normal
    if any(blocks(body, eye, points).any() for body in bodies):
        raise ValueError("the marker is hidden by its own support; give it another world, or another pose")


def _objects(
    makers: Sequence[Maker],
    sheet: SheetPlace,
    up: Array,
    surface: Body,
    fixed: Sequence[Body],
    count: int,
    rng: np.random.Generator,
) -> list[Body]:
    """Objects on the surface, each where it neither hides the marker nor stands in another body."""
    eye, points = np.zeros(3), sheet.seen + 1e-3 * sheet.normal
    placed: list[Body] = []
    ground = sheet.centre + (top_of(surface, up) - float(sheet.centre @ up)) * up
    reach = 0.95 * float(min(surface.half_m[:2].max(), 2.5))
    x, y = frame_on(up, 0.0)
    for _ in range(count):
        for _ in range(_TRIES):
            a, r = rng.uniform(0.0, 2 * np.pi), reach * np.sqrt(rng.uniform(0.02, 1.0))
            foot = ground + r * (np.cos(a) * x + np.sin(a) * y)
            body = makers[int(rng.integers(len(makers)))](rng, foot, up)
            if not _rests_on(body, surface):
                continue
            if blocks(body, eye, points, _CLEARANCE).any() or float(np.linalg.norm(foot)) < 0.25:
                continue
            if any(_near(body, other) for other in (*fixed, *placed)) or _over_sheet(body, sheet):
                continue
            placed.append(body)
            break
    return placed


def _radius(body: Body) -> float:
    return float(np.linalg.norm(body.half_m))


def _rests_on(body: Body, surface: Body) -> bool:
    inside = surface.camera_from_body[:3, :3].T @ (body.camera_from_body[:3, 3] - surface.camera_from_body[:3, 3])
    return bool((np.abs(inside[:2]) < surface.half_m[:2] - 0.6 * min(_radius(body), 0.08)).all())


def _near(a: Body, b: Body) -> bool:
    """Whether a sphere of three quarters of a body's extent reaches into the box of another."""
    local = b.camera_from_body[:3, :3].T @ (a.camera_from_body[:3, 3] - b.camera_from_body[:3, 3])
    beyond = np.maximum(np.abs(local) - b.half_m, 0.0)
    return float(np.linalg.norm(beyond)) < 0.75 * _radius(a)


def _over_sheet(body: Body, sheet: SheetPlace) -> bool:
    local = sheet.camera_from_sheet[:3, :3].T @ (body.camera_from_body[:3, 3] - sheet.camera_from_sheet[:3, 3])
    corners = (sheet.corners - sheet.camera_from_sheet[:3, 3]) @ sheet.camera_from_sheet[:3, :3]
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    beyond = np.maximum(np.maximum(low - local[:2], local[:2] - high), 0.0)
    return float(np.linalg.norm(beyond)) < _radius(body) and abs(local[2]) < _radius(body) + 0.02
