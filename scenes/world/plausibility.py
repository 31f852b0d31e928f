"""Plausibility of a study: values that are legal, but look as if they were written in another unit.

A warning is not an error: someone may print a marker of three metres, and see it from a thousand diameters. Each is one
line that starts with its place in the file and says what the value would mean, and what was probably meant.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from roundel.scenes.markers.plausible_size import describe_implausible_size
from roundel.scenes.study.schema import GroupSection, Key
from roundel.scenes.study.section import Section
from roundel.scenes.study.study import Study
from roundel.scenes.study.values import Spread

# The largest tilt that may be in radians: a right angle.
_RIGHT_ANGLE_RAD = math.pi / 2 + 0.01
# Rectilinear lenses end at about 120 degrees, across the diagonal; above, a focal length "in px" is rather one in mm.
_WIDEST_RECTILINEAR_DEG = 120.0
_WIDEST_DEG = 150.0
# A telescope; a pixel pitch in mm instead of um gives less.
_NARROWEST_DEG = 0.05
# Focal lengths of lenses in mm, from a phone's to a long telephoto.
_LENS_MM = (1.0, 800.0)
_FARTHEST_D = 1000.0
# Half turn, quarter turn and full turn, as people round them.
_TURNS_RAD = (math.pi / 2, math.pi, 2 * math.pi)

Range = tuple[float, float]


def implausible_values(study: Study) -> list[str]:
    """One line for each value of a study that is probably in a wrong unit.

    The checks: prints larger than 2 m (millimetres given as metres), tilts and rotations that look like
    radians, a focal length in millimetres given in pixels, fields of view beyond 150 degrees or below 0.05, and
    distances beyond 1,000 marker diameters.

    Parameters
    ----------
    study : Study

    Returns
    -------
    list of str
        `path:line:column: sentence`, in the order of the groups, none twice: groups that share a key share its line.
    """
    found: dict[str, None] = {}
    for name, group in study.groups.items():
        for key, sentence in _of_group(group):
            found[str(study.error(f"{'.'.join(map(str, key))}: {sentence}", name, *key))] = None
    return list(found)


def _of_group(group: GroupSection) -> Iterator[tuple[Key, str]]:
    ranges = dict(_ranges(group, ()))
    if group.sweep is not None and not isinstance(group.sweep.levels[0], str):
        # The levels replace the key's own value; the wrong unit is then in the levels.
        ranges[group.sweep.path] = min(group.sweep.levels), max(group.sweep.levels)
    for key, (low, high) in ranges.items():
        sentence = _print_size(key, high) or _tilt(key, high) or _turn(key, group, low, high)
        if sentence:
            yield key, sentence
    yield from _field_of_view(group, ranges)
    yield from _distances(ranges)


def _ranges(node: Any, where: Key) -> Iterator[tuple[Key, Range]]:
    """Every number of a section, with its smallest and largest value."""
    if isinstance(node, Spread):
        yield where, node.bounds()
    elif isinstance(node, bool):
        return
    elif isinstance(node, int | float):
        yield where, (float(node), float(node))
    elif isinstance(node, list | tuple):
        for i, item in enumerate(node):
            yield from _ranges(item, (*where, i))
    elif isinstance(node, Section):
        for name in type(node).model_fields:
            yield from _ranges(getattr(node, name), (*where, name))


def _print_size(key: Key, high: float) -> str:
    """Lengths of a print: `diameter_m`, `square_m`, `spacing_m`; not the bend of its paper, which may be slight."""
    last = str(key[-1])
    if not ({"marker", "kinds"} & set(key) and last.endswith("_m")) or "surface" in key or "motion" in key:
        return ""
    return describe_implausible_size(high)


def _tilt(key: Key, high: float) -> str:
    if key[-1] != "tilt_deg" or not 0 < high <= _RIGHT_ANGLE_RAD:
        return ""
    return f"the largest tilt is {high:.4g} degrees; angles are in degrees: {high:.4g} rad are {math.degrees(high):.0f}"


def _turn(key: Key, group: GroupSection, low: float, high: float) -> str:
    if key[-1] not in ("azimuth_deg", "roll_deg") or high == low:
        return ""
    largest = max(abs(low), abs(high))
    if not any(abs(largest - turn) < 0.01 for turn in _TURNS_RAD):
        return ""
    return (
        f"angles up to {largest:.4g} degrees; angles are in degrees: {largest:.4g} rad are {math.degrees(largest):.0f}"
    )


def _field_of_view(group: GroupSection, ranges: dict[Key, Range]) -> Iterator[tuple[Key, str]]:
    """The field of view across the diagonal, before lens distortion."""
    key, low_px, high_px = _focal_px(ranges)
    diagonal_px = math.hypot(group.camera.width_px, group.camera.height_px)
    fisheye = group.camera.distortion_model == "fisheye"
    widest = angle_of_view_deg(low_px, diagonal_px, fisheye)
    in_mm = key[-1] == "focal_px" and _LENS_MM[0] <= low_px <= _LENS_MM[1]
    size = f"{group.camera.width_px}x{group.camera.height_px} px"
    if in_mm and not fisheye and widest > _WIDEST_RECTILINEAR_DEG:
        yield (
            key,
            (
                f"{low_px:g} px at {size} is a field of view of {widest:.0f} degrees; if the lens has {low_px:g} mm, "
                "give focal_mm and pixel_pitch_um"
            ),
        )
    elif widest > _WIDEST_DEG:
        yield key, f"a field of view of {widest:.0f} degrees at {size}; increase the focal length"
    narrowest = angle_of_view_deg(high_px, diagonal_px, fisheye)
    if narrowest < _NARROWEST_DEG:
        yield (
            key,
            (
                f"a field of view of {narrowest:.2g} degrees at {size}; pixel_pitch_um is in micrometres, focal_mm in "
                "millimetres, focal_px in pixels"
            ),
        )


def _focal_px(ranges: dict[Key, Range]) -> tuple[Key, float, float]:
    """The key of the focal length, its smallest and its largest value in pixels (at infinity, for a lens in mm)."""
    key: Key = ("camera", "focal_px")
    if key in ranges:
        return key, *ranges[key]
    (low_mm, high_mm), (low_um, high_um) = ranges["camera", "focal_mm"], ranges["camera", "pixel_pitch_um"]
    return ("camera", "focal_mm"), 1e3 * low_mm / high_um, 1e3 * high_mm / low_um


def angle_of_view_deg(focal_px: float, extent_px: float, fisheye: bool = False) -> float:
    """Angle of view across an extent of the image, centred, in degrees: of a pinhole, or equidistant of a fisheye.

    Lens distortion is left out.
    """
    half = extent_px / 2 / focal_px
    return math.degrees(2 * half if fisheye else 2 * math.atan(half))


def _distances(ranges: dict[Key, Range]) -> Iterator[tuple[Key, str]]:
    diameter_m = ranges.get(("marker", "diameter_m"))
    for key, (_, high) in ranges.items():
        if key[-1] == "distance_D":
            far_D = high
        elif key[-1] == "distance_m" and diameter_m is not None and "motion" not in key:
            far_D = high / diameter_m[0]
        else:
            continue
        if far_D > _FARTHEST_D:
            yield key, f"up to {far_D:.4g} marker diameters away; distance_m is in metres, distance_D in diameters"
