"""Figures of sweeps: error over the level of a nuisance, with its interval and bound."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roundel.validate.claims.robustness import is_logarithmic
from roundel.validate.figures.svg import CURVES, INK, Picture, add_legend, colour, draw_svg, marker, name_of
from roundel.validate.scores.summary import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_SEVERAL = 2  # curves: with fewer, a legend is not needed


def sweep_pictures(sweeps: list[dict[str, Any]]) -> list[Picture]:
    """One figure for each sweep of the summary."""
    found = []
    for sweep in sweeps:
        name = name_of("sweep", sweep["group"], sweep["key"])

        def draw(figure: Figure, sweep: dict[str, Any] = sweep) -> None:
            axes = figure.subplots()
            draw_sweep(axes, sweep)
            axes.set_ylabel(unit_in_words(sweep))
            if len(sweep["curves"]) >= _SEVERAL:
                add_legend(figure, loc="outside upper center", ncols=4)

        title = f"Normal error over {title_of(sweep)}"
        found.append(Picture(name, sweep_caption(sweep), draw_svg(name, title, (6.0, 3.2), draw)))
    return found


def title_of(sweep: dict[str, Any]) -> str:
    """The nuisance and its unit."""
    title: str = sweep["title"]
    title = title[0].lower() + title[1:] if title[1:2].islower() else title
    return f"{title} [{sweep['unit']}]" if sweep["unit"] else title


def unit_in_words(sweep: dict[str, Any]) -> str:
    """Label of the error's axis."""
    relative = sweep["curves"][0]["unit"] == "bounds"
    return "normal error / bound at the mildest level" if relative else "normal error, median [deg]"


def sweep_caption(sweep: dict[str, Any]) -> str:
    """Caption: what the figure shows, and at which level each curve doubles."""
    frames = max(sweep["curves"][0]["frames"])
    relative = sweep["curves"][0]["unit"] == "bounds"
    text = (
        f"Normal error of the better candidate over {title_of(sweep)}"
        + (", divided by the frame's own Cramer-Rao bound at the mildest level" if relative else "")
        + f": median over the same {frames} circles at every level; an unsolved circle counts as an infinite error. "
        "Bands: 95 % interval (bootstrap over frames); dashed: where the error has doubled; dotted: "
        "the bound of each level, a bound of the RMS: the median of a method that reaches it is at 0.67 to 0.83 "
        "of it."
    )
    return " ".join([text, *(doubling_in_words(sweep, curve) for curve in sweep["curves"])])


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
    """Draw a sweep into a panel: levels from mild to severe, left to right."""
    levels = np.array(sweep["levels"], dtype=float)
    order = np.argsort(levels)
    for i, curve in enumerate(sweep["curves"]):
        median, low, high, bound = (
            np.array([np.nan if v is None else v for v in curve[f"normal_{n}"]])[order]
            for n in ("median", "median_low", "median_high", "bound")
        )
        x = levels[order]
        # An interval without an upper limit ends at the panel's edge.
        top = np.where(np.isfinite(low) & ~np.isfinite(high), 1e3, high)
        axes.fill_between(x, low, top, color=colour(i), alpha=0.15, lw=0)
        several = len({c["method"] for c in sweep["curves"]}) > 1
        label = f"{curve['method']}, {curve['intrinsics']}" if several else curve["intrinsics"]
        axes.plot(x, median, color=colour(i), marker=marker(i), ms=3.5, lw=1.4, label=label)
        if i == 0:
            axes.plot(x, bound, color=INK, ls=":", lw=1.0)
            if curve["doubling"]["level"] is not None:
                axes.axvline(curve["doubling"]["level"], color=CURVES[-1], ls="--", lw=0.9)
    axes.set_yscale("log")
    known = [
        v
        for c in sweep["curves"]
        for n in ("median", "median_high", "median_low", "bound")
        for v in c[f"normal_{n}"]
        if v is not None and v > 0
    ]
    axes.set_ylim(0.6 * min(known), 1.6 * max(known))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    if is_logarithmic(sweep["levels"]):
        axes.set_xscale("log")
        axes.set_xticks(levels, [f"{v:g}" for v in levels], minor=False)
        axes.xaxis.set_minor_formatter("")
    if sweep["levels"][0] > sweep["levels"][-1]:
        axes.invert_xaxis()
    axes.set_xlabel(title_of(sweep))
