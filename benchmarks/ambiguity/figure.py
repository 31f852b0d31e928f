"""The figure of `ambiguity.py`: share decided over distance, tilt and offset, and reliability of the probabilities."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import beta
from scores import DECIDED, Stated, reliability

from roundel.validate.figures.svg import GRID, Picture, add_legend, colour, draw_svg, line, marker, standalone_svg

FILE = Path(__file__).parents[2] / "docs" / "ambiguity" / "ambiguity.svg"

SHOWN = (
    "same_side / opposite_side",
    "normal, 10 deg",
    "wall with gravity, 10 deg",
    "circle:0.25 (a dot)",
    "circle:0.5 (a ring)",
    "tick",
    "coplanar, two discs",
    "coplanar, six discs",
)
CLASSES = 5  # of equally many circles, along each axis
AXES = {
    "distance_D": "distance, diameters",
    "tilt_deg": "tilt from the line of sight, deg",
    "offset_px": "off the axis, px",
}


def write_figure(stated: Sequence[Stated], intrinsics: str = "default") -> None:
    """Draw and write the figure for one kind of intrinsics."""
    by_kind = {s.kind: s for s in stated if s.intrinsics == intrinsics and len(s.probability)}
    shown = [by_kind[kind] for kind in SHOWN if kind in by_kind]

    def draw(page: Figure) -> None:
        panels = page.subplots(2, 2).ravel()
        for axes, (name, label) in zip(panels, AXES.items(), strict=False):
            for i, s in enumerate(shown):
                _decided(axes, s, name, i)
            axes.set(xlabel=label, ylabel=f"stated with {DECIDED:.0%} or more, %", ylim=(-3, 103))
        panels[0].set_xscale("log")
        panels[0].set_xticks([6, 10, 20, 40], ["6", "10", "20", "40"], minor=False)
        panels[0].minorticks_off()
        for i, s in enumerate(shown):
            _reliability(panels[3], s, i)
        panels[3].plot([50, 100], [50, 100], color=GRID, lw=1, zorder=0)
        panels[3].set(
            xlabel="stated probability of the likelier pose, %", ylabel="right, %", xlim=(49, 101), ylim=(30, 103)
        )
        add_legend(page, loc="outside lower center", ncols=4)

    title = (
        "Share of circles whose pose is decided, over distance, tilt and offset, and reliability of the probabilities"
    )
    FILE.parent.mkdir(exist_ok=True)
    svg = standalone_svg(Picture("ambiguity", "", draw_svg("ambiguity", title, (9.0, 7.6), draw)))
    FILE.write_text(svg, encoding="utf-8")


def _decided(axes: Axes, s: Stated, name: str, i: int) -> None:
    values = getattr(s, name)
    edges = np.quantile(values, np.linspace(0, 1, CLASSES + 1))
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, CLASSES - 1)
    sure = np.maximum(s.probability, 1 - s.probability) >= DECIDED
    middle = [float(np.median(values[index == k])) for k in range(CLASSES)]
    share = [100 * float(sure[index == k].mean()) for k in range(CLASSES)]
    label = s.kind if name == "distance_D" else None
    axes.plot(middle, share, color=colour(i), marker=marker(i), ls=line(i), ms=4, lw=1.2, label=label)


def _reliability(axes: Axes, s: Stated, i: int) -> None:
    """Bins of ten circles or more, with intervals of 90 % (Clopper and Pearson)."""
    bins = [b for b in reliability(s.probability) if b[0] >= 10]
    if not bins:
        return
    count, stated, right = np.array(bins).T
    hits = right * count
    low = np.where(hits > 0, beta.ppf(0.05, hits, count - hits + 1), 0.0)
    high = np.where(hits < count, beta.ppf(0.95, hits + 1, count - hits), 1.0)
    axes.errorbar(
        100 * stated,
        100 * right,
        yerr=100 * np.abs(np.array([right - np.nan_to_num(low), np.nan_to_num(high, nan=1.0) - right])),
        color=colour(i),
        marker=marker(i),
        ls="none",
        ms=4,
        lw=0.8,
    )
