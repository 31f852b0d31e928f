"""Further sheets of a frame: listed with their poses, or a count of them at random places where none hides another.

Sheets whose images do not overlap lie in separate cones through the camera's centre: none is in front of another, and
none goes through another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.marker import Sheet
from roundel.scenes.markers.surfaces import lifted
from roundel.scenes.study.marker_section import Marker
from roundel.scenes.study.pose_section import PoseSection
from roundel.scenes.study.schema import GroupSection
from roundel.scenes.study.values import Spread
from roundel.scenes.world.placement import Fail, border_points, faces_camera, part_outline, placed
from roundel.scenes.world.sheets import sheet_of

Array = NDArray[np.float64]

# Places that are tried for a random marker before the frame is given up.
_TRIES = 400
# Two sheets in front of each other are at least this far apart.
_APART_M = 1e-3
# A marker keeps this distance from the border of the image.
_INSIDE_PX = 2.0
_SIDE_POINTS = 8


@dataclass(frozen=True, eq=False)
class PlacedSheet:
    """A sheet in the camera frame at time 0, and the keys of its marker with all values drawn."""

    marker: Marker
    sheet: Sheet
    camera_from_sheet: Array


def further_sheets(
    settings: GroupSection,
    spread: PoseSection,
    first: PlacedSheet,
    camera: Camera,
    seeds: Callable[[int], np.random.SeedSequence],
    fail: Fail,
) -> tuple[PlacedSheet, ...]:
    """The further sheets of a frame; their markers are numbered on from those before.

    Parameters
    ----------
    settings : GroupSection
        With all values of the frame drawn.
    spread : PoseSection
        The group's pose with its distributions, from which each random marker draws what it has no keys of its own for.
    first : PlacedSheet
        The study's own sheet.
    camera : Camera
    seeds : callable
        Seed of the k-th further sheet.
    fail : callable
        Makes the error of the frame.

    Raises
    ------
    StudyError
        If two listed sheets meet, or a random marker finds no place.
    """
    keys = settings.markers
    found = [first]
    for k, listed in enumerate(keys.others):
        where = ("markers", k, "pose")
        sheet = _numbered(_sheet(listed.marker or settings.marker, seeds(k), fail), found)
        _, pose = placed(listed.pose, camera, sheet, fail, where)
        own = PlacedSheet(listed.marker or settings.marker, sheet, pose)
        meets = next((i for i, other in enumerate(found) if _meet(own, other, camera)), None)
        if meets is not None:
            raise fail(
                f"markers.{k}.pose: its sheet meets sheet {meets}, or passes it too closely; move them apart", *where
            )
        found.append(own)
    for k in range(keys.count):
        kind = keys.kinds[k % len(keys.kinds)] if keys.kinds else settings.marker
        free = _at_random(settings, spread, kind, found, camera, seeds(len(keys.others) + k), fail)
        if free is None:
            raise fail(
                f"markers.count: only {k} of {keys.count} find a place where none hides another; give fewer, smaller "
                "or more distant markers",
                "markers",
                "count",
            )
        found.append(free)
    return tuple(found[1:])


def _sheet(marker: Marker, seed: np.random.SeedSequence, fail: Fail) -> Sheet:
    try:
        return sheet_of(marker, int(seed.generate_state(1)[0]))
    except ValueError as error:
        raise fail(str(error), "markers") from error


def _numbered(sheet: Sheet, before: Sequence[PlacedSheet]) -> Sheet:
    start = sum(len(placed.sheet.parts) for placed in before)
    return replace(sheet, parts=tuple(replace(p, marker_id=p.marker_id + start) for p in sheet.parts))


def _at_random(
    settings: GroupSection,
    spread: PoseSection,
    marker: Marker,
    found: Sequence[PlacedSheet],
    camera: Camera,
    seed: np.random.SeedSequence,
    fail: Fail,
) -> PlacedSheet | None:
    rng = np.random.default_rng(seed)
    marker = type(marker).model_validate(_drawn(marker.model_dump(exclude_none=True), rng))
    sheet = _numbered(_sheet(marker, seed, fail), found)
    keys, pose = settings.markers, settings.pose
    taken = [image_hull(other, camera) for other in found]
    for _ in range(_TRIES):
        own_distance = keys.distance_D is not None or keys.distance_m is not None
        values = {}
        for name in ("distance_D", "distance_m", "tilt_deg", "azimuth_deg", "roll_deg"):
            raw = getattr(keys, name)
            if raw is None and not (own_distance and name.startswith("distance")):
                raw = getattr(spread, name)
                # A grid has one value for a frame.
                raw = getattr(pose, name) if isinstance(raw, Spread) and raw.kind == "grid" else raw
            values[name] = _drawn(raw, rng)
        at = rng.uniform([-0.5, -0.5], [camera.width_px - 0.5, camera.height_px - 0.5])
        offset = at - camera.K[:2, 2]
        drawn = PoseSection(
            **values, offset_x_px=float(offset[0]), offset_y_px=float(offset[1]), tilt_from=pose.tilt_from
        )
        _, camera_from_sheet = placed(drawn, camera, sheet, fail, ("markers",))
        own = PlacedSheet(marker, sheet, camera_from_sheet)
        if not _inside(own, camera):
            continue
        hull = image_hull(own, camera)
        if np.isfinite(hull).all() and all(gap_px(hull, other) >= keys.gap_px for other in taken):
            return own
    return None


def _drawn(raw: Any, rng: np.random.Generator) -> Any:
    """A section's values with every distribution replaced by a draw."""
    if isinstance(raw, Spread):
        return raw.draw(float(rng.random()))
    if isinstance(raw, dict):
        return {key: _drawn(value, rng) for key, value in raw.items()}
    return [_drawn(value, rng) for value in raw] if isinstance(raw, list | tuple) else raw


def _inside(own: PlacedSheet, camera: Camera) -> bool:
    """Whether every part faces the camera and is imaged inside the image."""
    for part in own.sheet.parts:
        points = transform_points(own.camera_from_sheet, part_outline(own.sheet, part, 32))
        if points[:, 2].min() <= 0 or not faces_camera(own.sheet, own.camera_from_sheet, part):
            return False
        px = project(camera, points)
        low, high = _INSIDE_PX - 0.5, np.array([camera.width_px, camera.height_px]) - 0.5 - _INSIDE_PX
        if not np.all((px >= low) & (px <= high)):
            return False
    return True


def image_hull(own: PlacedSheet, camera: Camera) -> Array:
    """Vertices (n, 2) of the convex hull of a sheet's image, px; NaN where the sheet reaches behind the camera."""
    from scipy.spatial import ConvexHull, QhullError

    (x0, y0), (x1, y1) = own.sheet.low_m, own.sheet.high_m
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    along = np.linspace(0, 1, _SIDE_POINTS, endpoint=False)[:, None]
    flat = np.concatenate([corners[i] + along * (corners[(i + 1) % 4] - corners[i]) for i in range(4)])
    points = transform_points(own.camera_from_sheet, lifted(own.sheet.curve, flat[:, 0], flat[:, 1]))
    if points[:, 2].min() <= 0:
        return np.full((1, 2), np.nan)
    px = project(camera, points)
    if not np.isfinite(px).all():
        return np.full((1, 2), np.nan)
    try:
        return np.asarray(px[ConvexHull(px).vertices])
    except QhullError:
        return np.asarray(px)


def gap_px(a: Array, b: Array) -> float:
    """Distance between two convex polygons (n, 2) by the separating axes of their sides; negative if they overlap."""
    widest = -np.inf
    for polygon in (a, b):
        side = np.roll(polygon, -1, axis=0) - polygon
        length = np.linalg.norm(side, axis=1, keepdims=True)
        outward = np.stack([side[:, 1], -side[:, 0]], axis=-1) / np.where(length > 0, length, 1.0)
        along_a, along_b = outward @ a.T, outward @ b.T
        gaps = np.maximum(along_b.min(axis=1) - along_a.max(axis=1), along_a.min(axis=1) - along_b.max(axis=1))
        widest = max(widest, float(gaps.max()))
    return widest


def _meet(a: PlacedSheet, b: PlacedSheet, camera: Camera) -> bool:
    """Whether two sheets may go through each other: their images overlap, and neither is on one side of the other."""
    hulls = image_hull(a, camera), image_hull(b, camera)
    if all(np.isfinite(h).all() for h in hulls) and gap_px(*hulls) > 0:
        return False
    for one, other in ((a, b), (b, a)):
        there = transform_points(
            np.linalg.inv(one.camera_from_sheet), transform_points(other.camera_from_sheet, border_points(other.sheet))
        )
        here = border_points(one.sheet)[:, 2]
        if there[:, 2].min() > here.max() + _APART_M or there[:, 2].max() < here.min() - _APART_M:
            return False
    return True
