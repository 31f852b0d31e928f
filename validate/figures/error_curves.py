"""The paper's figure: errors over distance, a panel for each tilt.

The bytes depend only on the scores.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.scenes.display_text import clean
from roundel.validate.figures.svg import Picture, colour, draw_svg, legend_text, line, marker, name_of
from roundel.validate.metrics.metric import PAPER, Metric
from roundel.validate.metrics.rows import Rows, column, distinct, text_column, texts_of, those, where_text
from roundel.validate.scores.summary import CHESSBOARD, grid_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# Half-width of a 95 % interval in standard errors, for cells with enough frames for a normal distribution.
_BAND = 1.96
_MIN_FOR_BAND = 5


# With more panels than this the figure is unreadable: each frame is then drawn as a dot.
_MAX_PANELS = 6
# A page with more figures than this is too large to read or to mail.
_MAX_PICTURES = 12
_MAX_DOTS = 500


def pictures(table: Rows, first: str = "") -> list[Picture]:
    """The paper's figure for each method (`first` before the others), reference and group of a table of scores."""
    found = []
    keys = distinct(table, ("method", "reference", "group"))
    several = len({key[2] for key in keys}) > 1
    for method, reference, group in sorted(keys, key=lambda k: (k[0] != first, k[0], k[1] != "truth", k[2])):
        if method == CHESSBOARD:
            continue
        part = those(table, where_text(table, method=method, reference=reference, group=group))
        if not np.isfinite(PAPER[0].values(part)).any():
            continue
        name, folded = name_of(method, reference, group), reference != "truth"
        about = f"Method {clean(method, 40)} against the {reference}"
        about += f", group {clean(group, 40)}" if several else ""
        grid = grid_of(part)
        if grid is not None and len(grid[0]) > 1 and len(grid[1]) <= _MAX_PANELS:
            caption = (
                f"{about}: mean error of the better candidate over distance, one panel per tilt, one curve per kind of "
                "intrinsics. Camera frame; D: marker diameters; reprojection in the delivered image."
            )
            if part.num_rows >= _MIN_FOR_BAND * len(grid[0]) * len(grid[1]) * len(texts_of(part, "intrinsics")):
                caption += " Bands: 95 % interval of the mean."
            found.append(Picture(name, caption, _drawn(name, about, part, grid), folded))
        else:
            caption = (
                f"{about}: each frame's error of the better candidate over distance, and medians of frames of like "
                "distance."
            )
            found.append(Picture(name, caption, _drawn(name, about, part, None), folded))
        if len(found) == _MAX_PICTURES:
            break
    return found


def _drawn(name: str, title: str, table: Rows, grid: tuple[Array, Array] | None) -> str:
    panels = 1 if grid is None else len(grid[1])
    # With one panel per row the figure would be tall and narrow, so the three errors are placed side by side.
    shape = (1, len(PAPER)) if panels == 1 else (len(PAPER), panels)
    labels = sorted(texts_of(table, "intrinsics"), key=lambda label: IntrinsicsLabel.of(label).rank)

    def draw(figure: Figure) -> None:
        axes = figure.subplots(*shape, squeeze=False, sharex=True, sharey="row" if panels > 1 else False)
        for r, row in enumerate(PAPER):
            for p in range(panels):
                at = axes[0, r] if panels == 1 else axes[r, p]
                if grid is None:
                    _scatter(at, table, row, labels)
                else:
                    _curves(at, table, row, labels, grid[0], float(grid[1][p]))
                if r == 0 and grid is not None and panels > 1:
                    at.set_title(f"tilt {grid[1][p]:g}\N{DEGREE SIGN}")
                if p == 0:
                    at.set_ylabel(row.label)
                if panels == 1 or r == len(PAPER) - 1:
                    at.set_xlabel("distance [D]")
            _scale(axes[0, r] if panels == 1 else axes[r, 0])
        figure.align_ylabels()
        by_name = dict(zip(*reversed(axes[0, 0].get_legend_handles_labels()), strict=True))
        names = [text for text in dict.fromkeys(map(legend_text, labels)) if text in by_name]
        handles = [by_name[label] for label in names]
        figure.legend(handles, names, loc="outside upper center", ncols=min(len(names), 5))

    return draw_svg(name, title, (max(3.0 * shape[1], 6.0), 2.1 * shape[0] + 0.7), draw)


def _scale(axes: Axes) -> None:
    """A logarithmic axis if the curves differ by more than a linear axis can show."""
    middles = [float(np.median(known)) for line in axes.lines if len(known := _positive(line.get_ydata()))]
    if middles and max(middles) > 20 * min(middles):
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0)


def _positive(values: Any) -> Array:
    known = np.asarray(values, dtype=np.float64)
    return known[np.isfinite(known) & (known > 0)]


def _curves(axes: Axes, table: Rows, row: Metric, labels: list[str], distances: Array, tilt: float) -> None:
    intrinsics = text_column(table, "intrinsics")
    distance, at_tilt = np.round(column(table, "distance_D"), 6), np.round(column(table, "tilt_deg"), 6) == tilt
    values = row.values(table)
    # The true focal length is drawn last, on top of the others.
    for i, label in sorted(enumerate(labels), key=lambda pair: IntrinsicsLabel.of(pair[1]).is_right):
        cells = [values[(intrinsics == label) & at_tilt & (distance == d) & np.isfinite(values)] for d in distances]
        mean = np.array([cell.mean() if len(cell) else np.nan for cell in cells])
        enough = np.array([len(cell) >= _MIN_FOR_BAND for cell in cells])
        half = np.array([_BAND * cell.std(ddof=1) / np.sqrt(len(cell)) if len(cell) > 1 else 0.0 for cell in cells])
        low = np.where(enough, np.maximum(mean - half, mean * 0.05), np.nan)
        axes.fill_between(distances, low, np.where(enough, mean + half, np.nan), color=colour(i), alpha=0.13, lw=0)
        axes.plot(
            distances, mean, color=colour(i), ls=line(i), marker=marker(i), ms=3.5, lw=1.4, label=legend_text(label)
        )


def _scatter(axes: Axes, table: Rows, row: Metric, labels: list[str]) -> None:
    intrinsics = text_column(table, "intrinsics")
    distance, values = column(table, "distance_D"), row.values(table)
    for i, label in enumerate(labels):
        rows = (intrinsics == label) & np.isfinite(values) & np.isfinite(distance)
        x, y = distance[rows], values[rows]
        # 500 dots show the distribution; more only enlarge the file. They are drawn at random, because every second
        # point of a low-discrepancy sequence lies in one half of its range.
        some = np.sort(np.random.default_rng(0).permutation(len(x))[:_MAX_DOTS])
        size, alpha = (2.5, 0.45) if len(x) > 60 else (4.5, 0.9)
        axes.plot(x[some], y[some], ls="none", marker=marker(i), ms=size, mew=0, color=colour(i), alpha=alpha)
        bins = np.array_split(np.argsort(x, kind="stable"), min(8, len(x) // 5)) if len(x) >= 10 else []
        middles = ([np.median(x[b]) for b in bins], [np.median(y[b]) for b in bins])
        # The legend needs its entry even without a line.
        axes.plot(*middles, color=colour(i), ls=line(i), marker=marker(i), ms=4, lw=1.4, label=legend_text(label))
