"""Every variable against every error: a matrix of small plots.

FMAC plots every degree of freedom against every error for square markers (arXiv 2601.07723).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.display_text import clean
from roundel.validate.claims.robustness import is_logarithmic
from roundel.validate.figures.log_ticks import set_log_ticks
from roundel.validate.figures.svg import INK, Picture, colour, draw_svg
from roundel.validate.metrics.metric import ELLIPSE_CENTRE, HEADLINE, Metric
from roundel.validate.metrics.rows import Rows, column, flag_column
from roundel.validate.scores.summary import run_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# Minimum number of frames for a distribution; bins with fewer than _MIN_IN_BIN have no useful quantiles.
_MIN_FRAMES, _MIN_IN_BIN, _MAX_BINS = 24, 8, 10
# A variable whose values differ by less than this share of their magnitude counts as not varied.
_MIN_SPREAD = 0.02
# Bins closer than this share of the panel's width are merged.
_APART = 0.03


@dataclass(frozen=True)
class Degree:
    """A degree of freedom: a column of scores.parquet or a ratio of two, and its axis label."""

    column: str
    label: str
    over: str = ""


DEGREES = (
    Degree("distance_D", "distance [D]"),
    Degree("tilt_deg", "tilt [deg]"),
    Degree("azimuth_deg", "azimuth [deg]"),
    Degree("image_x_px", "image x [px]"),
    Degree("image_y_px", "image y [px]"),
    Degree("edge_blur_px", "edge blur [px]"),
    Degree("edge_contrast_dn", "contrast / noise", "edge_noise_dn"),
    Degree("sweep_level", "level of the sweep"),
)


ERRORS = (*HEADLINE, ELLIPSE_CENTRE)
MISSED = "not solved [%]"


def variable_pictures(table: Rows, method: str, intrinsics: str) -> list[Picture]:
    """The matrix of one run against the truth; empty if too few frames were scored or nothing was varied.

    Parameters
    ----------
    table : Rows
        Scores.
    method, intrinsics : str
        The run.
    """
    part = run_rows(table, (method, intrinsics, "truth"))
    degrees = [(degree, values) for degree in DEGREES if (values := _varied(part, degree)) is not None]
    errors = [error for error in ERRORS if np.isfinite(error.values(part)).sum() >= _MIN_FRAMES]
    if not degrees or not errors:
        return []
    solved = flag_column(part, "solved")
    size = (max(1.55 * len(degrees) + 0.6, 4.0), 1.35 * (len(errors) + (not solved.all())) + 0.4)

    def draw(figure: Figure) -> None:
        rows = len(errors) + (not solved.all())
        axes = figure.subplots(rows, len(degrees), squeeze=False, sharex="col", sharey="row")
        for c, (degree, values) in enumerate(degrees):
            bins = _bins(values)
            for r, error in enumerate(errors):
                _panel(axes[r, c], values, part, error, bins)
            if not solved.all():
                _misses(axes[-1, c], values, solved, bins)
            axes[-1, c].set_xlabel(degree.label)
            _scale_x(axes[-1, c], values)
        for r, error in enumerate(errors):
            axes[r, 0].set_ylabel(error.label)
            _scale_y(axes[r, 0], error.values(part))
        if not solved.all():
            axes[-1, 0].set_ylabel(MISSED)
            axes[-1, 0].set_ylim(bottom=0)
        for at in axes.flat:
            at.tick_params(labelsize=7)
            at.xaxis.label.set_size(8)
            at.yaxis.label.set_size(8)
        figure.align_ylabels()
        # Margins in inches around the panels; matplotlib's layout engine takes seconds for so many panels.
        figure.subplots_adjust(
            left=0.72 / size[0], right=1 - 0.1 / size[0], bottom=0.42 / size[1], top=1 - 0.1 / size[1],
            wspace=0.1, hspace=0.12,
        )  # fmt: skip

    caption = (
        f"Method {clean(method, 40)} with {clean(intrinsics, 40)} intrinsics, {part.num_rows} circles: every variable "
        "of the frames against every error of the better candidate. Line: median; bands: 25 to 75 % and 5 to 95 % of "
        "the frames with similar values. Dashed: median of the frames' own Cramer-Rao bounds, the lower limit of the "
        "RMS of any unbiased method. Camera frame; reprojection and ellipse centre in the delivered image; D: marker "
        "diameters. Variables that were not varied are left out."
    )
    return [Picture("matrix", caption, draw_svg("matrix", "Errors by variable", size, draw, layout=None))]


def _varied(part: Rows, degree: Degree) -> Array | None:
    """Values of a degree of freedom; None if it has none or was not varied."""
    if degree.column not in part.column_names:
        return None
    values = column(part, degree.column)
    if degree.over:
        noise = column(part, degree.over)
        values = np.divide(values, noise, out=np.full(len(values), np.nan), where=noise > 0)
    known = values[np.isfinite(values)]
    if len(known) < _MIN_FRAMES:
        return None
    low, high = np.percentile(known, [2, 98])
    # For a position in the image the absolute range counts: a few pixels are no variation, wherever they are.
    least = 4.0 if degree.column.startswith("image_") else _MIN_SPREAD * np.abs(known).max()
    return values if high - low > least else None


def _bins(values: Array) -> list[NDArray[np.int64]]:
    """Rows with similar values, ordered by value: one bin per level of a grid, or bins of equal count.

    Bins that a panel cannot resolve are merged: many frames with nearly the same value would give a vertical line.
    """
    known = np.flatnonzero(np.isfinite(values))
    levels = np.unique(np.round(values[known], 6))
    if len(levels) <= _MAX_BINS and len(known) >= _MIN_IN_BIN * len(levels):
        return [known[np.round(values[known], 6) == level] for level in levels]
    count = int(np.clip(len(known) // (2 * _MIN_IN_BIN), 3, _MAX_BINS))
    bins: list[NDArray[np.int64]] = []
    drawn = np.log(values) if is_logarithmic(values) else values
    apart = _APART * np.ptp(drawn[known])
    for rows in np.array_split(known[np.argsort(values[known], kind="stable")], count):
        if bins and np.median(drawn[rows]) - np.median(drawn[bins[-1]]) < apart:
            bins[-1] = np.concatenate([bins[-1], rows])
        else:
            bins.append(rows)
    return bins


def _panel(axes: Axes, values: Array, part: Rows, error: Metric, bins: list[NDArray[np.int64]]) -> None:
    wrong = error.values(part)
    found = [rows[np.isfinite(wrong[rows])] for rows in bins]
    found = [rows for rows in found if len(rows) >= _MIN_IN_BIN]
    if not found:
        return
    x = np.array([np.median(values[rows]) for rows in found])
    q = np.array([np.percentile(wrong[rows], [5, 25, 50, 75, 95]) for rows in found]).T
    axes.fill_between(x, q[0], q[4], color=colour(0), alpha=0.14, lw=0)
    axes.fill_between(x, q[1], q[3], color=colour(0), alpha=0.28, lw=0)
    axes.plot(x, q[2], color=colour(0), lw=1.4, marker="o", ms=2.5)
    bound = error.bounds(part)
    if all(np.isfinite(bound[rows]).any() for rows in found):
        axes.plot(x, [np.nanmedian(bound[rows]) for rows in found], color=INK, lw=0.9, ls="--")


def _misses(axes: Axes, values: Array, solved: NDArray[np.bool_], bins: list[NDArray[np.int64]]) -> None:
    x = [np.median(values[rows]) for rows in bins]
    axes.plot(x, [100 * np.mean(~solved[rows]) for rows in bins], color=colour(1), lw=1.4, marker="s", ms=2.5)


def _scale_x(axes: Axes, values: Array) -> None:
    from matplotlib.ticker import MaxNLocator

    known = values[np.isfinite(values)]
    if is_logarithmic(known):
        axes.set_xscale("log")
        set_log_ticks(axes.xaxis, float(known.min()), float(known.max()), most=3)
    else:
        axes.xaxis.set_major_locator(MaxNLocator(3))


def _scale_y(axes: Axes, values: Array) -> None:
    """A logarithmic axis if the frames differ by more than a linear axis can show."""
    from matplotlib.ticker import MaxNLocator, NullLocator

    known = values[np.isfinite(values)]
    low, high = np.percentile(known, [5, 95])
    if low > 0 and high > 20 * low:
        axes.set_yscale("log")
        axes.yaxis.set_minor_locator(NullLocator())
    else:
        axes.set_ylim(bottom=0)
        axes.yaxis.set_major_locator(MaxNLocator(4))
