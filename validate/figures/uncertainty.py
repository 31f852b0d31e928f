"""Percentiles of the truth in the regions that a run states: alike in every bin if its covariance holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from roundel.scenes.display_text import NAME_LIMIT, clean
from roundel.validate.figures.svg import INK, Picture, colour, draw_svg, legend_text
from roundel.validate.scores.summary import CHESSBOARD

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAX_PANELS = 8
_COLUMNS = 4


def uncertainty_pictures(runs: Sequence[dict[str, Any]]) -> list[Picture]:
    """A panel for each run against the truth that states covariances; empty without any.

    Parameters
    ----------
    runs : sequence of dict
        Of the summary.
    """
    shown = [
        (run, run["coverage"]["oracle"])
        for run in runs
        if run["reference"] == "truth" and run["method"] != CHESSBOARD and (run.get("coverage") or {}).get("oracle")
    ]
    if not shown:
        return []
    some = shown[:_MAX_PANELS]
    columns = min(_COLUMNS, len(some))
    rows = -(-len(some) // columns)

    def draw(figure: Figure) -> None:
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True)
        for at in axes.flat[len(some) :]:
            at.set_visible(False)
        for at, (run, found) in zip(axes.flat, some, strict=False):
            counts = np.array(found["percentiles"], dtype=np.float64)
            edges = np.linspace(0, 100, len(counts) + 1)
            at.bar(edges[:-1], counts / counts.mean(), width=np.diff(edges), align="edge", color=colour(0), alpha=0.75)
            at.axhline(1.0, color=INK, lw=0.9, ls="--")
            at.set_xlim(0, 100)
            at.set_title(legend_text(clean(f"{run['method']}, {run['intrinsics']}", NAME_LIMIT)), fontsize=8)
        for at in axes[-1]:
            at.set_xlabel("percentile")
        for at in axes[:, 0]:
            at.set_ylabel("frequency")

    caption = (
        "Percentile of the truth in the region that each pose states (chi-square, 5 degrees of freedom; the better "
        "candidate), relative to its mean frequency. Dashed: a covariance that holds. High at the right: errors are "
        "larger than stated; high at the left: smaller."
    )
    if len(shown) > len(some):
        caption += f" {len(shown) - len(some)} runs are only in the table."
    size = (max(2.3 * columns, 4.0), 1.8 * rows + 0.5)
    return [Picture("uncertainty", caption, draw_svg("uncertainty", "Stated uncertainty", size, draw))]
