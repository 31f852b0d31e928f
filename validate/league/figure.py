"""The league at one glance: cells of entries by conditions, shaded by how good they are, with the best marked."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from roundel.validate.figures.svg import CURVES, INK, Picture, draw_svg, legend_text
from roundel.validate.league.standings import ALL, Standing
from roundel.validate.scores.summary import number
from roundel.validate.statistics.intervals import Interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# An entry that finds its marker less often than this wins no condition by the errors of what it found.
LEAST_RECALL = 0.5


@dataclass(frozen=True)
class Panel:
    """One table of cells.

    Attributes
    ----------
    title : str
    of : callable
        The interval of a standing.
    shade : callable
        Value to 0 (good) .. 1 (bad).
    text : callable
        Value to the text of its cell.
    larger_is_better : bool
    """

    title: str
    of: Callable[[Standing], Interval]
    shade: Callable[[float], float]
    text: Callable[[float], str]
    larger_is_better: bool = False


def _decades(low: float, high: float) -> Callable[[float], float]:
    """Shade on a logarithmic scale from `low` to `high`."""
    span = math.log(high / low)
    return lambda value: float(np.clip(math.log(max(value, low) / low) / span, 0.0, 1.0))


PANELS = {
    "recall": Panel(
        "found, % of frames",
        lambda s: s.rates["found"],
        lambda v: 1.0 - v,
        lambda v: f"{100 * v:.0f}",
        larger_is_better=True,
    ),
    "chosen": Panel(
        "normal of the pose that the method chooses, median error, deg",
        lambda s: s.errors["chosen_normal_error_deg"],
        _decades(0.03, 10.0),
        lambda v: number(v, 2),
    ),
    "normal": Panel(
        "normal of the better of its poses, median error, deg",
        lambda s: s.errors["normal_error_deg"],
        _decades(0.03, 10.0),
        lambda v: number(v, 2),
    ),
    "position": Panel(
        "position, median error, % of distance",
        lambda s: s.errors["position_error_pct"],
        _decades(0.05, 10.0),
        lambda v: number(v, 2),
    ),
    "focal": Panel(
        "focal length measured without a prior, median error, %",
        lambda s: s.errors["focal_error_pct"],
        _decades(0.3, 30.0),
        lambda v: number(v, 2),
    ),
}


def league_pictures(standings: Sequence[Standing]) -> list[Picture]:
    """One figure for each kind of intrinsics, and one for the focal length."""
    out = []
    for label in dict.fromkeys(s.intrinsics for s in standings):
        mine = [s for s in standings if s.intrinsics == label]
        known = "known" if label == "true" else "default"
        caption = (
            f"Who wins where, with {known} intrinsics: share of frames in which the marker was found, and median "
            "errors over these. Dark cells are bad. A dot marks the best entry of a column, and those whose 95 % "
            f"interval contains its value; errors count for entries that found at least {100 * LEAST_RECALL:.0f} % of "
            "the column's frames."
        )
        out.append(_picture(f"league-{label}", caption, mine, ("recall", "position", "chosen", "normal")))
    measured = [s for s in standings if s.intrinsics == "default" and s.errors["focal_error_pct"].value is not None]
    entries = {(s.entry, s.variant) for s in measured}
    if entries:
        shown = [s for s in standings if s.intrinsics == "default" and (s.entry, s.variant) in entries]
        caption = (
            "Focal length that each entry measures from its images alone, without a prior: huang2015 and pollefeys1999 "
            "from several by the same camera, all others from one. The marks are as above."
        )
        out.append(_picture("league-focal", caption, shown, ("focal",)))
    return out


def _picture(name: str, caption: str, standings: Sequence[Standing], panels: Sequence[str]) -> Picture:
    rows = list(dict.fromkeys((s.variant, s.entry) for s in standings))
    conditions = list(dict.fromkeys(s.condition for s in standings))
    by_key = {(s.variant, s.entry, s.condition): s for s in standings}

    def draw(figure: Figure) -> None:
        axes = figure.subplots(deep, wide, sharey=True, squeeze=False).ravel()
        for which, (panel, axis) in enumerate(zip(panels, axes, strict=True)):
            _draw_panel(axis, PANELS[panel], rows, conditions, by_key, labels=which % wide == 0)

    wide = min(2, len(panels))
    deep = len(panels) // wide
    size = 9.6 if wide > 1 else 6.4, deep * (0.9 + 0.19 * len(rows))
    return Picture(name, caption, draw_svg(name, caption, size, draw))


def _draw_panel(
    axis: Axes,
    panel: Panel,
    rows: list[tuple[str, str]],
    conditions: list[str],
    by_key: dict[tuple[str, str, str], Standing],
    labels: bool,
) -> None:
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba

    axis.set_xlim(-0.5, len(conditions) - 0.5)
    axis.set_ylim(len(rows) - 0.5, -0.5)
    axis.grid(visible=False)
    axis.tick_params(length=0)
    for spine in axis.spines.values():
        spine.set_visible(False)
    axis.set_title(panel.title, loc="left")
    axis.set_xticks(range(len(conditions)), [legend_text(c) for c in conditions], rotation=55, ha="right", fontsize=7)
    axis.set_yticks(range(len(rows)), [legend_text(f"{variant}: {entry}") for variant, entry in rows], fontsize=7)
    axis.tick_params(axis="y", labelleft=labels)
    shades = np.full((len(rows), len(conditions)), np.nan)
    dots: list[tuple[float, float]] = []
    for column, condition in enumerate(conditions):
        cells = {row: by_key.get((*key, condition)) for row, key in enumerate(rows)}
        best = _best(panel, [s for s in cells.values() if s is not None])
        for row, standing in cells.items():
            value = None if standing is None else panel.of(standing).value
            if value is None or standing is None:
                continue
            shades[row, column] = 0.75 * panel.shade(value)
            axis.text(column, row, panel.text(value), ha="center", va="center", fontsize=6, color=INK)
            if best is not None and _as_good(panel, standing, best):
                dots.append((column - 0.4, row - 0.32))
    # One collection of cells and one line of dots: an artist for each would make the file three times as large.
    shown = np.argwhere(shades > 0.01)
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    colours = [to_rgba(CURVES[0], float(shades[row, column])) for row, column in shown]
    axis.add_collection(PolyCollection([np.add(corners, cell[::-1]) for cell in shown], fc=colours, lw=0))
    axis.plot(*np.array(dots).reshape(-1, 2).T, "o", ms=2.2, color=CURVES[1])
    axis.axvline(0.5, color=INK, lw=0.6)


def _counts(panel: Panel, standing: Standing) -> bool:
    """Whether a standing may win: it has a value, and found enough for its errors to count."""
    value, recall = panel.of(standing).value, standing.rates["found"].value
    return value is not None and (panel.larger_is_better or (recall or 0.0) >= LEAST_RECALL)


def _best(panel: Panel, standings: list[Standing]) -> float | None:
    values = [panel.of(s).value for s in standings if _counts(panel, s)]
    known = [value for value in values if value is not None]
    if not known:
        return None
    return max(known) if panel.larger_is_better else min(known)


def _as_good(panel: Panel, standing: Standing, best: float) -> bool:
    if not _counts(panel, standing):
        return False
    interval = panel.of(standing)
    if interval.value == best:
        return True
    if interval.low is None or interval.high is None:
        return False
    return interval.high >= best if panel.larger_is_better else interval.low <= best


def winners(standings: Sequence[Standing], panel: str) -> dict[str, list[str]]:
    """The best entries of each condition by one panel: `VARIANT: ENTRY`, the best first, then those as good."""
    chosen, out = PANELS[panel], {}
    for condition in dict.fromkeys(s.condition for s in standings if s.condition != ALL):
        cells = [s for s in standings if s.condition == condition]
        best = _best(chosen, cells)
        if best is not None:
            good = [s for s in cells if _as_good(chosen, s, best)]
            good.sort(key=lambda s: chosen.of(s).value or 0.0, reverse=chosen.larger_is_better)
            out[condition] = [f"{s.variant}: {s.entry}" for s in good]
    return out
