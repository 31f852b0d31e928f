"""Runs side by side: a figure of their errors, and paired comparisons on shared frames.

Frames are paired, so that their individual difficulty cancels. No claim is made about runs that share no frames.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.scenes.display_text import NAME_LIMIT, clean
from roundel.validate.figures.log_ticks import set_log_ticks
from roundel.validate.figures.svg import Picture, colour, draw_svg, legend_text, marker
from roundel.validate.metrics.metric import HEADLINE, NORMAL, Metric
from roundel.validate.metrics.rows import Rows, circle_keys, flag_column, shared
from roundel.validate.scores.comparisons import shared_rows, stated_difference
from roundel.validate.scores.stated_uncertainty import ASKED, JUDGED
from roundel.validate.scores.summary import CHESSBOARD, run_rows
from roundel.validate.statistics.intervals import holm
from roundel.validate.statistics.paired_tests import mcnemar_test, rms_ratio_test
from roundel.validate.tables.table import Cell, Column, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

ALPHA = 0.05
# With fewer shared frames there is no test.
MIN_SHARED = 20
_MAX_SHOWN = 24
# Column of p in the rows of the table of stated uncertainty.
_STATED_P = 15
NO_DIFFERENCE = ("no difference shown", "identical")

ERRORS = HEADLINE


@dataclass(frozen=True)
class Entry:
    """One run: its displayed name, its kind (one colour each), its summary, and its rows of scores."""

    label: str
    kind: str
    run: dict[str, Any]
    rows: Rows


@dataclass(frozen=True)
class Pair:
    """Two runs on their shared frames.

    `frames` has the frame of each row of both, if these show the same scenes in different images.
    """

    first: Entry
    second: Entry
    about: str
    frames: tuple[Labels, Labels] | None = None

    def shared(self) -> tuple[Rows, Rows]:
        """The rows of the circles that both should find, in the same order."""
        if self.frames is None:
            return shared_rows(self.first.rows, self.second.rows)
        keys = [circle_keys(entry.rows) for entry in (self.first, self.second)]
        for key, frame in zip(keys, self.frames, strict=True):
            key["frame_id"] = frame
        i, j = shared(*keys)
        return self.first.rows.take(pa.array(i)), self.second.rows.take(pa.array(j))


@dataclass(frozen=True)
class Wording:
    """Names and headings of the tables of pairs."""

    prefix: str
    comparisons: str
    solved_by_one: str
    about: str
    first: str
    second: str
    scale: str


RUNS = Wording(
    "",
    "Paired comparisons",
    "Circles solved by only one method",
    "Intrinsics",
    "First",
    "Second",
    "divided by its own Cramer-Rao bound if all have one",
)
# The two images of a circle differ: its bound, too.
ONE_SCALE = "divided by the circle's Cramer-Rao bound in the first, if all have one, so that both have one scale"


def side_by_side_pictures(entries: Sequence[Entry], title: str) -> list[Picture]:
    """One figure with the median, its interval and the 95th percentile of every run; empty for fewer than two runs."""
    shown = [e for e in entries if e.run["oracle"][NORMAL.column]["n"]][:_MAX_SHOWN]
    if len(shown) < 2:
        return []
    kinds = list(dict.fromkeys(e.kind for e in shown))

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, len(ERRORS), sharey=True, squeeze=False)[0]
        for at, error in zip(axes, ERRORS, strict=True):
            middles = []
            for y, entry in enumerate(shown):
                found = entry.run["oracle"][error.column]
                if not found["n"]:
                    continue
                k, middle, p95 = kinds.index(entry.kind), found["median"], found["p95"]
                middles.append(middle)
                at.plot([middle, p95], [y, y], color=colour(k), lw=1.0, alpha=0.5)
                at.plot([p95], [y], color=colour(k), marker="|", ms=7, ls="none")
                if found.get("median_low") is not None:
                    at.plot([found["median_low"], found["median_high"]], [y, y], color=colour(k), lw=3.5, alpha=0.6)
                at.plot([middle], [y], color=colour(k), marker=marker(k), ms=5, ls="none")
            at.set_xlabel(error.label)
            if middles and min(middles) > 0 and max(middles) > 8 * min(middles):
                at.set_xscale("log")
                set_log_ticks(at.xaxis, *at.get_xlim())
            else:
                at.set_xlim(left=0)
        axes[0].set_yticks(range(len(shown)), [legend_text(e.label) for e in shown])
        axes[0].set_ylim(len(shown) - 0.5, -0.5)

    size = (9.0, 0.28 * len(shown) + 0.9)
    caption = (
        f"{title}. Mark: median of the better candidate's error; thick line: its 95 % interval; thin line: up to the "
        "95th percentile. Camera frame; reprojection in the delivered image."
    )
    if len(entries) > len(shown):
        caption += f" {len(entries) - len(shown)} runs are only in the table."
    return [Picture("side-by-side", caption, draw_svg("side-by-side", title, size, draw))]


def pair_tables(pairs: Sequence[Pair], wording: Wording = RUNS) -> list[Table]:
    """Errors and failures of pairs of runs, frame by frame; empty if too few frames are shared."""
    errors: list[list[Any]] = []
    solved: list[list[Any]] = []
    stated: list[list[Any]] = []
    for pair in pairs:
        a, b = pair.shared()
        if a.num_rows >= MIN_SHARED:
            solved.append(_solved(pair, a, b))
            # Of another image, a better score need not be a better statement.
            if pair.frames is None and (stating := _stated(pair, a, b)) is not None:
                stated.append(stating)
            errors += [row for error in ERRORS if (row := _compared(pair, a, b, error)) is not None]
    for rows, at in ((errors, 9), (solved, 6), (stated, _STATED_P)):
        for row, p in zip(rows, holm([row[at] for row in rows]), strict=True):
            row[at] = float(p)
            row.append(_better(row, at))
    about = (Column("about", wording.about), Column("first", wording.first), Column("second", wording.second))
    end = (Column("p_holm", "p", "Holm"), Column("better", "Smaller error"))
    ratio = Table(
        f"{wording.prefix}comparisons",
        wording.comparisons,
        (
            *about,
            Column("error", "Error"),
            Column("frames", "Circles", "both solved"),
            Column("ratio_rms", f"{wording.second} / {wording.first.lower()}", "RMS"),
            Column("ratio_low", "", role="low"),
            Column("ratio_high", "", role="high"),
            Column("detectable_pct", "Detectable", "% change"),
            *end,
        ),
        _plain(errors),
        "Ratio of the RMS errors of the better candidate over the circles that both solved, each error "
        f"{wording.scale}, with its 95 % interval over frames in brackets. p: two-sided, "
        "Holm-corrected over this table. Detectable: the change that these circles would show in 95 of 100 cases at "
        f"level {ALPHA:g}. Camera frame; reprojection in the delivered image.",
    )
    lost = Table(
        f"{wording.prefix}solved_by_one",
        wording.solved_by_one,
        (
            *about,
            Column("circles", "Circles", "shared"),
            Column("only_first", f"{wording.first} alone", "count"),
            Column("only_second", f"{wording.second} alone", "count"),
            Column("p_holm", "p", "Holm"),
            Column("better", "Solves more"),
        ),
        _plain(solved),
        "Circles that both should find. p: McNemar's exact test, two-sided, Holm-corrected over this table.",
    )
    return [table for table in (ratio, lost, _stated_table(about, stated)) if table.rows]


def _stated_table(about: Sequence[Column], stated: Sequence[Sequence[Any]]) -> Table:
    """Which of two runs states its uncertainty better, from their compared rows."""
    shares = [
        column
        for which in ("first", "second")
        for column in (
            Column(f"{which}_within_95_pct", f"{which.capitalize()} in 95 % region", "%"),
            Column(f"{which}_low_pct", "", "%", "low"),
            Column(f"{which}_high_pct", "", "%", "high"),
            Column(f"{which}_verdict", "", role="file"),
        )
    ]
    return Table(
        "stated_pairs",
        "Stated uncertainty, pose by pose",
        (
            *about,
            Column("poses", "Poses", "both stated"),
            *shares,
            Column("log_score_difference", "Second - first", "log score", signed=True),
            Column("log_score_low", "", role="low", signed=True),
            Column("log_score_high", "", role="high", signed=True),
            Column("p_holm", "p", "Holm"),
            Column("better", "Better stated"),
        ),
        _plain(stated),
        "Poses of the better candidate for which both state a covariance. The 95 % region should hold the truth of "
        f"95 % of them; within {ASKED} it holds. Difference of the mean log scores, minus the logarithm of the "
        "density that each states at the truth, with its 95 % interval over frames in brackets: smaller is better, "
        "and an error that is small and known counts, as well as one that is large and known to be. p: two-sided, "
        "paired t-test, Holm-corrected over this table.",
    )


def _stated(pair: Pair, a: Rows, b: Rows) -> list[Any] | None:
    found = stated_difference(a, b)
    if found is None or found["n"] < MIN_SHARED:
        return None
    row = [pair.about, pair.first.label, pair.second.label, found["n"]]
    for key in ("a", "b"):
        share = next(entry for entry in found[key]["levels"] if entry["level"] == JUDGED)
        row += [*(100 * share[end] for end in ("rate", "low", "high")), found[key]["verdict"]]
    return [*row, found["difference"], found["low"], found["high"], found["p_value"]]


def _compared(pair: Pair, a: Rows, b: Rows, error: Metric) -> list[Any] | None:
    first, second = _over_bounds(pair, a, b, error)
    plain = [error.values(t) for t in (a, b)]
    bounded = np.isfinite(plain[0]) & np.isfinite(plain[1])
    x, y = (first, second) if np.array_equal(np.isfinite(first) & np.isfinite(second), bounded) else plain
    x, y = x[bounded], y[bounded]
    if len(x) < MIN_SHARED:
        return None
    frame = a["frame_id"].to_numpy()[bounded]
    test = rms_ratio_test(y, x, alpha=ALPHA / 2, clusters=frame)
    if not math.isfinite(test.effect):
        return None
    low, high = (math.exp(test.effect + z * test.standard_error) for z in (-1.96, 1.96))
    p = 2 * min(test.p_value, 1 - test.p_value) if test.standard_error else 1.0
    head = [pair.about, pair.first.label, pair.second.label, error.label, len(x)]
    return [*head, math.exp(test.effect), low, high, 100 * math.expm1(test.detectable), p]


def _over_bounds(pair: Pair, a: Rows, b: Rows, error: Metric) -> tuple[Array, Array]:
    """Errors over their bounds; NaN without one. Different images of a circle have one scale, that of the first."""
    if pair.frames is None:
        return error.over_bound(a), error.over_bound(b)
    bound = np.where((found := error.bounds(a)) > 0, found, np.nan)
    return error.values(a) / bound, error.values(b) / bound


def _solved(pair: Pair, a: Rows, b: Rows) -> list[Any]:
    one, two = (flag_column(rows, "solved") for rows in (a, b))
    only = int(np.sum(one & ~two)), int(np.sum(two & ~one))
    p = min(1.0, 2 * min(mcnemar_test(x, y, alpha=ALPHA).p_value for x, y in ((two, one), (one, two))))
    return [pair.about, pair.first.label, pair.second.label, len(one), *only, p]


def _better(row: Sequence[Any], at: int) -> str:
    """Which run is better; neither if chance explains the difference."""
    if at == _STATED_P:
        if row[at - 3] == row[at - 2] == row[at - 1] == 0:
            return NO_DIFFERENCE[1]
        return NO_DIFFERENCE[0] if row[at] >= ALPHA else str(row[2] if row[at - 3] < 0 else row[1])
    if at == 9 and row[6] == row[7] == 1:
        return NO_DIFFERENCE[1]
    if row[at] >= ALPHA:
        return NO_DIFFERENCE[0]
    second = row[5] < 1 if at == 9 else row[5] > row[4]
    return str(row[2] if second else row[1])


def _plain(rows: Sequence[Sequence[Any]]) -> tuple[tuple[Cell, ...], ...]:
    return tuple(tuple(row) for row in rows)


def runs_to_compare(table: Rows, runs: Sequence[dict[str, Any]], of: str = "") -> list[Entry]:
    """Runs of one table of scores against the truth; `of` is the report's label if there are several reports."""
    found = []
    for run in runs:
        key = (run["method"], run["intrinsics"], run["reference"])
        if key[0] != CHESSBOARD and key[2] == "truth":
            name = clean(": ".join(filter(None, (of, f"{key[0]}, {key[1]}"))), NAME_LIMIT)
            found.append(Entry(name, of or key[0], run, run_rows(table, key)))
    return found


def method_pairs(entries: Sequence[Entry], first: str) -> list[Pair]:
    """Each other method against the method `first`, for the same intrinsics."""
    by_intrinsics: dict[str, dict[str, Entry]] = {}
    for entry in entries:
        by_intrinsics.setdefault(entry.run["intrinsics"], {})[entry.kind] = entry
    return [
        Pair(
            replace(found[first], label=clean(first, NAME_LIMIT)), replace(entry, label=clean(kind, NAME_LIMIT)), label
        )
        for label, found in by_intrinsics.items()
        if first in found
        for kind, entry in found.items()
        if kind != first
    ]
