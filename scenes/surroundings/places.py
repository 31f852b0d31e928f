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
from roundel.scenes.surroundings.posts import can_footing, carrier_of, post_of
from roundel.scenes.surroundings.rooms import room_of, sun_of
from roundel.scenes.surroundings.sheet_place import SheetPlace
from roundel.scenes.surroundings.supports import land_around, lowest_of, support_of, surface_at, top_of
from roundel.scenes.surroundings.wall_things import on_wall

Array = NDArray[np.float64]

_PREFERRED = {"tabletop": "flat", "room": "upright", "shelf": "upright", "workshop": "flat", "outdoor": "upright"}
_MAKERS: dict[str, tuple[Maker, ...]] = {"workshop": WORKSHOP, "outdoor": STREET}
_PLACEMENTS = 8
_TRIES = 40
# An object's box grows by this factor before it is tested, so that none touches the line of sight.
_CLEARANCE = 1.15
# Further sheets hang at least this far above the surface.
_FREE_M = 0.02
_BELOW_CAMERA_M = 0.1


def surroundings_of(kind: str, sheets: Sequence[SheetPlace], objects: int, rng: np.random.Generator) -> Surroundings:
    """The world around a sheet, or several.

    Parameters
    ----------
    kind : str
        `tabletop`, `room`, `shelf`, `workshop` or `outdoor`.
    sheets : sequence of SheetPlace
        The first decides what is up and what it rests on; others stand on posts.
    objects : int
        How many are tried; one that would hide the marker or stand in another is left out after some tries.
    rng : numpy.random.Generator

    Raises
    ------
    ValueError
        If nothing can be built so that the marker is seen.
    """
    reason = ""
    for i, attempt in enumerate(rng.spawn(_PLACEMENTS)):
        try:
            # What holds the first of several may hide another: it then stands on a post, like these.
            return _placed(kind, sheets, objects, attempt, on_post=len(sheets) > 1 and i >= _PLACEMENTS // 2)
        except ValueError as error:
            reason = str(error)
    raise ValueError(f"{reason} ({_PLACEMENTS} placements were tried)")


def _placed(
    kind: str, sheets: Sequence[SheetPlace], objects: int, rng: np.random.Generator, on_post: bool
) -> Surroundings:
    sheet, others = sheets[0], sheets[1:]
    footing = footing_of(
        sheet.normal, sheet.centre, sheet.size_m, rng, _PREFERRED[kind], on_wall=kind in ("room", "outdoor")
    )
    round_a_can = sheet.curve is not None and sheet.curve.kind == "cylinder"
    if round_a_can:
        footing = can_footing(sheet, footing)
    up = footing.up
    points = np.concatenate([s.corners for s in sheets])
    floor = min((float((s.corners @ up).min()) for s in others), default=np.inf) - _FREE_M
    if others or round_a_can:
        # No table between a low camera and a marker.
        floor = min(floor, -_BELOW_CAMERA_M)
    carriers: list[Body] = []
    supports: list[Body] = []
    if round_a_can or on_post:
        carrier = carrier_of(sheet, rng)
        carriers.append(carrier)
        floor = min(floor, lowest_of(carrier, up))
        surface, support = surface_at(kind, sheet, up, floor, rng), "can" if round_a_can else "stand"
    else:
        in_front = not others or bool(((points - sheet.centre) @ sheet.normal).min() > -sheet.thickness_m)
        supports, surface, support = support_of(kind, sheet, footing, rng, floor, in_front)
    shell: list[Body] = []
    panels: list[Panel] = []
    sun = None
    level = top_of(surface, up)
    if kind == "outdoor":
        sun = sun_of(sheet, up, rng)
    else:
        shell, panels = room_of(kind, sheet, up, level, support, rng, points[len(sheet.corners) :])
    carriers += [carrier_of(other, rng) for other in others]
    posts = _posts(carriers, sheets, up, level, float((points @ up).max()) + 3.0)
    _check_seen([*supports, *shell, surface, *posts], sheets)
    for i, carrier in enumerate(carriers, start=len(sheets) - len(carriers)):
        _check_seen([carrier], [s for j, s in enumerate(sheets) if j != i])
    if support == "wall":
        # A generator of its own, so that the objects are those of a bare wall.
        supports = [*supports, *on_wall(kind, sheets, up, level, rng.spawn(1)[0])]
    fixed = [*supports, *shell, *carriers, *posts]
    things = _objects(_MAKERS.get(kind, HOUSEHOLD), sheets, up, surface, fixed, objects, rng)
    if kind == "outdoor":
        things.append(land_around(surface, up))
    return Surroundings(up, support, [*fixed, surface, *things], panels, sun, sheet.thickness_m)


def _posts(
    carriers: Sequence[Body], sheets: Sequence[SheetPlace], up: Array, level: float, ceiling: float
) -> list[Body]:
    """A post for each carrier that does not stand on the surface itself; one that would hide a marker hangs freely."""
    seen = [s.seen for s in sheets]
    posts = [
        post_of(carrier, up, level, ceiling, seen)
        for carrier in carriers
        if lowest_of(carrier, up) > level + _FREE_M / 2
    ]
    return [post for post in posts if post is not None]


def _check_seen(bodies: Sequence[Body], sheets: Sequence[SheetPlace]) -> None:
    eye = np.zeros(3)
    for sheet in sheets:
        # Just before the paper: its support touches it.
        points = sheet.seen + 1e-3 * sheet.normal
        if any(blocks(body, eye, points).any() for body in bodies):
            raise ValueError("the marker is hidden by its own support; give it another world, or another pose")


def _objects(
    makers: Sequence[Maker],
    sheets: Sequence[SheetPlace],
    up: Array,
    surface: Body,
    fixed: Sequence[Body],
    count: int,
    rng: np.random.Generator,
) -> list[Body]:
    """Objects on the surface, each where it neither hides the marker nor stands in another body."""
    eye, sheet = np.zeros(3), sheets[0]
    points = np.concatenate([s.seen + 1e-3 * s.normal for s in sheets])
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
            if any(_near(body, other) for other in (*fixed, *placed)) or any(_over_sheet(body, s) for s in sheets):
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
