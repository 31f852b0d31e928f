"""Differences between images of the same frames: levels of a sweep, or several sensors that saw the same radiance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from roundel.validate.figures.log_ticks import set_log_ticks
from roundel.validate.figures.side_by_side import ERRORS, ONE_SCALE, Entry, Pair, Wording
from roundel.validate.figures.svg import CURVES, Picture, add_legend, colour, draw_svg, legend_text, marker
from roundel.validate.metrics.rows import column, those, where_text
from roundel.validate.statistics.paired_tests import rate_difference
from roundel.validate.tables.table import Cell, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEVELS = Wording(
    "level_",
    "Differences between levels",
    "Circles solved at only one of two levels",
    "Run",
    "Reference",
    "Level",
    ONE_SCALE,
)
SENSORS = Wording(
    "sensor_",
    "The same radiance under different sensors",
    "Circles solved under only one of two sensors",
    "Run",
    "First",
    "Second",
    ONE_SCALE,
)
# More are only in the table.
_MAX_SHOWN = 24

# Places in the rows of `side_by_side.pair_tables`.
_ABOUT, _FIRST, _SECOND, _ERROR, _RATIO = 0, 1, 2, 3, slice(5, 8)
_SHARED, _ONLY_FIRST, _ONLY_SECOND = 3, 4, 5


def level_pairs(entries: Sequence[Entry], sweeps: Sequence[dict[str, Any]]) -> list[Pair]:
    """Each level of each sweep against the reference level, run by run.

    Parameters
    ----------
    entries : sequence of Entry
        Runs of one report.
    sweeps : sequence of dict
        As in summary.json.
    """
    found = []
    for sweep in sweeps:
        shown = sweep["words"] or [f"{level:g}" for level in sweep["levels"]]
        reference = sweep["levels"].index(sweep["reference"])
        prefix = f"{sweep['group']}: " if len(sweeps) > 1 else ""
        for entry in entries:
            rows = those(entry.rows, where_text(entry.rows, group=sweep["group"]))
            at = column(rows, "sweep_level")
            parts = [those(rows, at == level) for level in sweep["levels"]]
            frames = [part["sweep_frame"].to_numpy() for part in parts]
            levels = [
                Entry(f"{prefix}{text}", entry.kind, entry.run, part) for text, part in zip(shown, parts, strict=True)
            ]
            about = entry.label
            found += [
                Pair(levels[reference], level, about, (frames[reference], frame))
                for i, (level, frame) in enumerate(zip(levels, frames, strict=True))
                if i != reference
            ]
    return found


def change_pictures(name: str, title: str, tables: Sequence[Table], beside: str = "") -> list[Picture]:
    """One figure of the tables of pairs: errors and solved circles of each second image against the first.

    Parameters
    ----------
    name, title : str
    tables : sequence of Table
        From `side_by_side.pair_tables`; without comparisons there is no figure.
    beside : str
        Label of the axis of the second images.
    """
    errors = next((t.rows for t in tables if t.name.endswith("comparisons")), ())
    solved = next((t.rows for t in tables if t.name.endswith("solved_by_one")), ())
    seconds = list(dict.fromkeys(str(row[_SECOND]) for row in errors))[:_MAX_SHOWN]
    firsts = list(dict.fromkeys(str(row[_FIRST]) for row in errors))
    if not seconds:
        return []
    runs = list(dict.fromkeys(str(row[_ABOUT]) for row in errors))

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(ERRORS) + 1, sharey=True, squeeze=False)[0]
        for axes, error in zip(panels, ERRORS, strict=False):
            mine = [row for row in errors if row[_ERROR] == error.label]
            # A legend has each run once: matplotlib leaves out names with an underscore.
            names = {run: legend_text(run) if axes is panels[0] else "_" for run in runs}
            _draw(axes, seconds, names, 1.0, [(row, _ratio(row)) for row in mine])
            axes.set_xscale("log")
            low, high = axes.get_xlim()
            # Hardly any change is not stretched over the panel.
            axes.set_xlim(min(low, 0.8), max(high, 1.25))
            set_log_ticks(axes.xaxis, *axes.get_xlim())
            axes.set_xlabel(f"{error.words} error\n[ratio of the RMS]")
        _draw(panels[-1], seconds, dict.fromkeys(runs, "_"), 0.0, [(row, _points(row)) for row in solved])
        panels[-1].set_xlim(*_around_zero(*panels[-1].get_xlim()))
        panels[-1].set_xlabel("solved circles\n[percentage points]")
        panels[0].set_yticks(range(len(seconds)), [legend_text(text) for text in seconds])
        panels[0].set_ylabel(beside)
        panels[0].set_ylim(len(seconds) - 0.5, -0.5)
        if len(runs) > 1:
            add_legend(figure, loc="outside upper center", ncols=4)

    first = f" against {firsts[0]}" if len(firsts) == 1 else " against its first"
    caption = (
        f"{title}: each{first}, on the same frames. RMS errors of the better candidate over the circles that both "
        "solved, and the share of solved circles; bars: 95 % intervals, paired over frames."
    )
    size = 9.0, (0.24 + 0.1 * len(runs)) * len(seconds) + 1.3
    return [Picture(name, caption, draw_svg(name, title, size, draw))]


def _draw(
    axes: Axes,
    seconds: Sequence[str],
    names: Mapping[str, str],
    same: float,
    rows: Sequence[tuple[Sequence[Cell], tuple[float, float, float]]],
) -> None:
    """Draw values with their intervals, beside a line where nothing has changed; `names` has each run's in a legend."""
    axes.axvline(same, color=CURVES[-1], ls="--", lw=0.9)
    for k, (run, name) in enumerate(names.items()):
        mine = [(row, change) for row, change in rows if row[_ABOUT] == run and row[_SECOND] in seconds]
        if not mine:
            continue
        y = np.array([seconds.index(str(row[_SECOND])) for row, _ in mine]) + 0.24 * (k - (len(names) - 1) / 2)
        value, low, high = np.array([change for _, change in mine]).T
        axes.hlines(y, low, high, color=colour(k), lw=2.5, alpha=0.6)
        axes.plot(value, y, color=colour(k), marker=marker(k), ms=4.5, ls="none", label=name)


def _around_zero(low: float, high: float) -> tuple[float, float]:
    return min(low, -5.0), max(high, 5.0)


def _ratio(row: Sequence[Cell]) -> tuple[float, float, float]:
    value, low, high = (float(v or math.nan) for v in row[_RATIO])
    return value, low, high


def _points(row: Sequence[Cell]) -> tuple[float, float, float]:
    found = rate_difference(*(int(row[k] or 0) for k in (_ONLY_FIRST, _ONLY_SECOND, _SHARED)))
    value, low, high = (100 * float(v or 0.0) for v in (found.value, found.low, found.high))
    return value, low, high
