"""Figures of sweeps: errors and recall over the level of a nuisance, with their intervals and bound."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roundel.validate.claims.robustness import BESIDE, is_logarithmic
from roundel.validate.figures.svg import (
    CURVES,
    INK,
    Picture,
    add_legend,
    colour,
    draw_svg,
    legend_text,
    marker,
    name_of,
)
from roundel.validate.scores.summary import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_ENDS = ("", "_low", "_high")
_SEVERAL = 2  # curves: with fewer, a legend is not needed


def sweep_pictures(sweeps: list[dict[str, Any]]) -> list[Picture]:
    """One figure for each sweep of the summary."""
    found = []
    for sweep in sweeps:
        name = name_of("sweep", sweep["group"], sweep["key"])

        def draw(figure: Figure, sweep: dict[str, Any] = sweep) -> None:
            panels = figure.subplots(2, 2).ravel()
            draw_sweep(panels[0], sweep)
            panels[0].set_ylabel(unit_in_words(sweep))
            for axes, metric in zip(panels[1:], BESIDE, strict=False):
                draw_error(axes, sweep, metric.name)
                axes.set_ylabel(f"{metric.title.lower()} error, median\n[{metric.unit}]")
            draw_recall(panels[3], sweep)
            panels[3].set_ylabel("recall [%]")
            if len(sweep["curves"]) >= _SEVERAL:
                add_legend(figure, loc="outside upper center", ncols=4)

        title = f"Errors and recall over {title_of(sweep)}"
        found.append(Picture(name, sweep_caption(sweep), draw_svg(name, title, (8.6, 5.6), draw)))
    return found


def title_of(sweep: dict[str, Any]) -> str:
    """The nuisance and its unit."""
    title: str = sweep["title"]
    title = title[0].lower() + title[1:] if title[1:2].islower() else title
    return f"{title} [{sweep['unit']}]" if sweep["unit"] else title


def unit_in_words(sweep: dict[str, Any]) -> str:
    """Label of the error's axis."""
    relative = sweep["curves"][0]["unit"] == "bounds"
    return f"normal error / bound\nat the {_reference(sweep)} level" if relative else "normal error, median [deg]"


def sweep_caption(sweep: dict[str, Any]) -> str:
    """Caption: what the figure shows, and at which level each curve doubles."""
    frames = max(sweep["curves"][0]["frames"])
    relative = sweep["curves"][0]["unit"] == "bounds"
    text = (
        f"Normal error of the better candidate over {title_of(sweep)}"
        + (f", divided by the frame's own Cramer-Rao bound at the {_reference(sweep)} level" if relative else "")
        + f": median over the same {frames} circles at every level; an unsolved circle counts as an infinite error. "
        "Bands: 95 % interval (bootstrap over frames); "
        + ("" if sweep.get("words") else "dashed: where the error has doubled; ")
        + "dotted: the bound of each level, a bound of the RMS: the median of a method that reaches it is at 0.67 to "
        "0.83 of it. Beside it, the medians of position and reprojection with the same intervals, and the recall, the "
        "share of circles with a pose, with Wilson's."
    )
    # Nothing lies between two words.
    doublings = [] if sweep.get("words") else [doubling_in_words(sweep, curve) for curve in sweep["curves"]]
    return " ".join([text, *doublings])


def _reference(sweep: dict[str, Any]) -> str:
    return "first" if sweep.get("words") else "mildest"


def doubling_in_words(sweep: dict[str, Any], curve: dict[str, Any]) -> str:
    """The level at which the error has doubled, with its interval."""
    at, unit = curve["doubling"], f" {sweep['unit']}" if sweep["unit"] else ""
    who = f"{curve['method']}, {curve['intrinsics']}"
    if at["level"] is None:
        beyond = " (but does in " + number(100 * at["share"], 2) + " % of resamples)" if at["share"] > 0.025 else ""
        return f"{who}: does not double within these levels{beyond}."
    low, high = ("beyond the levels" if v is None else number(v) for v in (at["low"], at["high"]))
    return f"{who}: has doubled at {number(at['level'])}{unit} ({low} to {high})."


def draw_sweep(axes: Axes, sweep: dict[str, Any]) -> None:
    """Draw the normal's error of a sweep into a panel: levels from mild to severe, left to right."""
    draw_error(axes, sweep, "normal")
    first = sweep["curves"][0]
    doubled = None if sweep.get("words") else first["doubling"]["level"]
    x, bound = _ordered(sweep, first["normal_bound"])
    axes.plot(x, bound, color=INK, ls=":", lw=1.0)
    if doubled is not None:
        axes.axvline(doubled, color=CURVES[-1], ls="--", lw=0.9)
    _limit(axes, [*_known(sweep, "normal"), *(v for c in sweep["curves"] for v in c["normal_bound"] if v)])


def draw_error(axes: Axes, sweep: dict[str, Any], name: str) -> None:
    """Draw the medians of an error over the levels, with their intervals; unsolved circles are infinitely wrong."""
    for i, curve in enumerate(sweep["curves"]):
        (x, median), (_, low), (_, high) = (_ordered(sweep, curve[f"{name}_median{end}"]) for end in _ENDS)
        # An interval without an upper limit ends at the panel's edge.
        top = np.where(np.isfinite(low) & ~np.isfinite(high), 1e6, high)
        axes.fill_between(x, low, top, color=colour(i), alpha=0.15, lw=0)
        axes.plot(x, median, color=colour(i), marker=marker(i), ms=3.5, lw=1.4, label=_label(sweep, curve, name))
    axes.set_yscale("log")
    _limit(axes, _known(sweep, name))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    _level_axis(axes, sweep)


def draw_recall(axes: Axes, sweep: dict[str, Any]) -> None:
    """Draw the share of circles with a pose over the levels, in percent, with Wilson's intervals."""
    for i, curve in enumerate(sweep["curves"]):
        share = [
            100 * solved / count if count else None
            for solved, count in zip(curve["solved"], curve["frames"], strict=True)
        ]
        x, rate = _ordered(sweep, share)
        low, high = (100 * _ordered(sweep, curve[f"solved_rate_{end}"])[1] for end in ("low", "high"))
        axes.fill_between(x, low, high, color=colour(i), alpha=0.15, lw=0)
        axes.plot(x, rate, color=colour(i), marker=marker(i), ms=3.5, lw=1.4)
    axes.set_ylim(-3, 103)
    _level_axis(axes, sweep)


def _label(sweep: dict[str, Any], curve: dict[str, Any], name: str) -> str:
    """The curve's name in the legend, of one panel alone."""
    if name != "normal":
        return "_"  # matplotlib leaves it out
    several = len({c["method"] for c in sweep["curves"]}) > 1
    return f"{curve['method']}, {curve['intrinsics']}" if several else str(curve["intrinsics"])


def _ordered(sweep: dict[str, Any], values: list[float | None]) -> tuple[Array, Array]:
    """Levels, ascending, and values at them; NaN for None."""
    levels = np.array(sweep["levels"], dtype=float)
    order = np.argsort(levels)
    return levels[order], np.array([np.nan if v is None else v for v in values], dtype=float)[order]


def _known(sweep: dict[str, Any], name: str) -> list[float]:
    return [v for c in sweep["curves"] for end in _ENDS for v in c[f"{name}_median{end}"] if v is not None and v > 0]


def _limit(axes: Axes, known: list[float]) -> None:
    if known:
        axes.set_ylim(0.6 * min(known), 1.6 * max(known))


def _level_axis(axes: Axes, sweep: dict[str, Any]) -> None:
    levels = sorted(sweep["levels"])
    if words := sweep.get("words"):  # reports of older versions do not have it
        axes.set_xticks(levels, [legend_text(word) for word in words])
    elif is_logarithmic(levels):
        axes.set_xscale("log")
        axes.set_xticks(levels, [f"{v:g}" for v in levels], minor=False)
        axes.xaxis.set_minor_formatter("")
    else:
        axes.locator_params(axis="x", nbins=4)  # wide numbers such as 1.0005 side by side
    if sweep["levels"][0] > sweep["levels"][-1]:
        axes.invert_xaxis()
    axes.set_xlabel(title_of(sweep))
