"""Reliability curves: how often a statement is right, over the probability that it was given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from roundel.scenes.display_text import NAME_LIMIT, clean
from roundel.validate.figures.svg import INK, Picture, colour, draw_svg, legend_text
from roundel.validate.scores.summary import CHESSBOARD

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_PANELS = 8
_COLUMNS = 4


@dataclass(frozen=True)
class _Statement:
    """A kind of statement: its key in a run of the summary, the name of its figure, and its words."""

    key: str
    name: str
    title: str
    least: float
    stated: str
    right: str
    counted: str
    caption: str


_CHOICE = _Statement(
    "choice",
    "reliability",
    "Probability of the likelier candidate",
    0.5,
    "stated probability",
    "share right",
    "poses",
    "How often the likelier of two candidates is the right one, over the probability that the method states for it.",
)
_CONFIDENCE = _Statement(
    "confidence",
    "confidence",
    "Confidence of detections",
    0.0,
    "stated confidence",
    "share right",
    "detections",
    "How often a detection is that of a marker, over the confidence that the method states for it.",
)
_STATEMENTS = (_CHOICE, _CONFIDENCE)


def reliability_pictures(runs: Sequence[dict[str, Any]]) -> list[Picture]:
    """A figure for each kind of stated probability, with a panel for each run; empty without any.

    Parameters
    ----------
    runs : sequence of dict
        Of the summary.
    """
    mine = [run for run in runs if run["reference"] == "truth" and run["method"] != CHESSBOARD]
    return [picture for kind in _STATEMENTS if (picture := _picture(kind, mine)) is not None]


def _picture(kind: _Statement, runs: Sequence[dict[str, Any]]) -> Picture | None:
    panels = _panels(kind, runs)
    if not panels:
        return None
    some = panels[:_MAX_PANELS]
    columns = min(_COLUMNS, len(some))
    rows = -(-len(some) // columns)

    def draw(figure: Figure) -> None:
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for at in axes.flat[len(some) :]:
            at.set_visible(False)
        for i, (at, (name, found)) in enumerate(zip(axes.flat, some, strict=False)):
            _curve(at, found, kind.least)
            at.set_title(legend_text(clean(name, NAME_LIMIT)), fontsize=8)
            # Of the lowest panel in its column.
            if i + columns >= len(some):
                at.set_xlabel(kind.stated)
                at.xaxis.set_tick_params(labelbottom=True)
        for at in axes[:, 0]:
            at.set_ylabel(kind.right)

    caption = (
        f"{kind.caption} Marks: bins of like probability, with 95 % intervals over frames; bars: the share of the "
        f"{kind.counted} in each. Dashed: probabilities that hold. A mark below it is stated too surely, above it too "
        "cautiously."
    )
    if len(panels) > len(some):
        caption += f" {len(panels) - len(some)} runs are only in the table."
    size = (max(2.3 * columns, 4.0), 2.1 * rows + 0.5)
    return Picture(kind.name, caption, draw_svg(kind.name, kind.title, size, draw))


def _panels(kind: _Statement, runs: Sequence[dict[str, Any]]) -> list[tuple[str, dict[str, Any]]]:
    """Names and statistics of the runs that state this; intrinsics that share the numbers share a panel."""
    shared: dict[tuple[str, str], tuple[list[str], dict[str, Any]]] = {}
    for run in runs:
        found = run.get(kind.key)
        if found:
            shared.setdefault((run["method"], repr(found)), ([], found))[0].append(run["intrinsics"])
    return [(f"{method}, {', '.join(labels)}", found) for (method, _), (labels, found) in shared.items()]


def _curve(at: Axes, found: dict[str, Any], least: float) -> None:
    """A panel: marks over the diagonal, and the share of each bin as a bar at its mean."""
    bins = found["bins"]
    stated, right, low, high = (
        np.array([np.nan if b[key] is None else b[key] for b in bins]) for key in ("stated", "rate", "low", "high")
    )
    share = np.array([b["n"] for b in bins]) / found["n"]
    at.bar(stated, share, width=0.04 * (1 - least), color=colour(6), alpha=0.35)
    at.plot([least, 1.0], [least, 1.0], color=INK, lw=0.9, ls="--")
    at.vlines(stated, low, high, color=colour(0), lw=2.2, alpha=0.55)
    at.plot(stated, right, color=colour(0), marker="o", ms=4, lw=1.0)
    edge = 0.03 * (1 - least)
    at.set_xlim(least - edge, 1 + edge)
    at.set_ylim(0.0, 1.03)
