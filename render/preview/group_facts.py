"""What a group shows: ranges over some of its frames, its light, what is drawn from which distribution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from roundel.render.preview.frame_facts import FrameFacts
from roundel.scenes.study.light_section import LightSection
from roundel.scenes.study.schema import GroupSection
from roundel.scenes.study.values import Spread


@dataclass(frozen=True)
class Drawn:
    """A key whose value is drawn: the distribution as text, and the values in the frames that are shown."""

    key: str
    distribution: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class GroupFacts:
    """A group of a study.

    Attributes
    ----------
    name : str
    frames : int
    rows : dict
        What to know about it, by title: image, marker, its size in pixels, distances, tilts, light, world.
    drawn : tuple of Drawn
    """

    name: str
    frames: int
    rows: dict[str, str]
    drawn: tuple[Drawn, ...]

    @property
    def line(self) -> str:
        """The group in one line, for the terminal."""
        rows = self.rows
        where = f"{rows['Image']}, {rows['Field of view']}; {rows['Marker']}: {rows['Size in the image']}"
        return (
            f"{self.name}: {self.frames} frames; {where}, at {rows['Distance']}, tilt {rows['Tilt']}; {rows['Light']}"
        )


def group_facts(
    name: str, group: GroupSection, frames: int, placed: Sequence[FrameFacts], shown: Sequence[FrameFacts]
) -> GroupFacts:
    """Facts of a group from some frames that were placed, and from those that are shown."""
    camera = group.camera
    marker = placed[0].markers[0]
    # The first marker of each frame is the study's own; further ones are counted.
    own = [facts.markers[0] for facts in placed]
    further = max(len(facts.markers) for facts in placed) - 1
    size_m = getattr(group.marker, "diameter_m", None) or getattr(group.marker, "square_m", None)
    printed = "" if size_m is None else f", {_number(size_m, 1000)} mm"
    distances = _span([m.distance_m for m in own], "m")
    if marker.distance_D is not None:
        distances += f" ({_span([m.distance_D or 0.0 for m in own], 'D')})"
    rows = {
        "Image": f"{camera.width_px}x{camera.height_px} px",
        "Field of view": " x ".join(_span([facts.view_deg[k] for facts in placed], "deg") for k in (0, 1)),
        "Marker": f"{group.marker.kind}{printed}" + (f" and {further} more" if further else ""),
        "Size in the image": _span([m.size_px for m in own], "px"),
        "Distance": distances,
        "Tilt": _span([m.tilt_deg for m in own], "deg"),
        "Light": describe_light(group),
        "World": group.world.kind if group.mode == "images" else "none: points of the contour, no images",
    }
    if group.sweep is not None:
        rows["Sweep"] = f"{group.sweep.key}: {group.sweep.shown_levels}"
    drawn = tuple(
        Drawn(key, describe_spread(spread), tuple(f"{facts.frame.drawn[key]:.4g}" for facts in shown))
        for key, spread in ((".".join(map(str, place)), spread) for place, spread in group.spreads)
    )
    return GroupFacts(name, frames, rows, drawn)


def describe_light(group: GroupSection) -> str:
    """The light of a group in a few words."""
    light: LightSection = group.light
    if group.mode == "points":
        return "no light: points"
    if group.world.kind not in ("plain", "scene"):
        return f"lights of the {group.world.kind}"
    if group.world.kind == "scene" and light == LightSection():
        return "lights of the scene"
    if light.sky is not None:
        around = f"sky, sun at {_number(light.sky.sun_elevation_deg)} deg"
    elif light.map is not None:
        around = f"map {light.map.file}"
    else:
        around = f"uniform {_number(light.environment)}"
    kinds = [lamp.kind for lamp in light.lamps]
    lamps = [f"{kinds.count(kind)} {kind} lamp{'s' * (kinds.count(kind) > 1)}" for kind in dict.fromkeys(kinds)]
    return ", ".join([around, *lamps])


def describe_spread(spread: Spread) -> str:
    """A distribution in words.

    Examples
    --------
    >>> describe_spread(Spread("uniform", (10.0, 50.0)))
    'uniform, 10 to 50'
    >>> describe_spread(Spread("normal", (0.0, 0.1)))
    'normal, 0 ± 0.1'
    """
    numbers = [f"{value:g}" for value in spread.args]
    if spread.kind in ("grid", "choice"):
        return f"{spread.kind} of {', '.join(numbers)}"
    return f"{spread.kind}, {numbers[0]} {'±' if spread.kind == 'normal' else 'to'} {numbers[1]}"


def _number(value: float | Spread, factor: float = 1.0) -> str:
    if isinstance(value, Spread):
        low, high = value.bounds()
        return f"{low * factor:.4g} to {high * factor:.4g}"
    return f"{value * factor:.4g}"


def _span(values: Sequence[float], unit: str) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    if unit in ("px", "deg"):
        low, high = f"{min(values):.0f}", f"{max(values):.0f}"
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"
