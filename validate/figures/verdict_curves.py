"""Parts of the verdicts' figures: curves of means with intervals, reference laws, axes and panels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.claims.conditions import Condition
from roundel.validate.figures.svg import INK, Picture, colour, draw_svg, marker
from roundel.validate.statistics.trends import Array, Estimate, mean_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DISTANCE = "distance [D]"
_MIN_DF = 4
BANDS = "Means of the better candidate; bands: 95 % interval if there are enough frames. D: marker diameters."


@dataclass(frozen=True)
class Curve:
    """Estimates along an axis; `style` is the number of its colour and marker."""

    label: str
    x: Array
    y: Sequence[Estimate | None]
    style: int
    as_ratio: bool = False


def curve_by_distance(s: Condition, values: Array, label: str, style: int) -> Curve:
    """Mean of the values at each distance."""
    distances, at = s.distances()
    means = [mean_of(np.where(at == d, values, np.nan), s.frame) for d in range(len(distances))]
    return Curve(label, distances, means, style)


def curves_of_cases(s: Condition, name: str) -> list[Curve]:
    """A curve for each kind of intrinsics, the calibrated one first."""
    labels = [s.right, *s.wrong]
    names = ["calibrated", *(IntrinsicsLabel.of(label).short for label in s.wrong)]
    return [curve_by_distance(s, s.of(n, name), names[i], i) for i, n in enumerate(labels)]


def draw_curve(axes: Axes, curve: Curve) -> None:
    """Draw line, markers and the band of the intervals."""
    known = [(x, e) for x, e in zip(curve.x.tolist(), curve.y, strict=True) if e is not None]
    if not known:
        return
    # With so few frames the interval would fill the panel.
    bounds = np.array([(x, e.value, *(e.interval() if e.df >= _MIN_DF else (np.nan, np.nan))) for x, e in known])
    if curve.as_ratio:
        bounds[:, 1:] = np.exp(bounds[:, 1:])
    else:
        # On a logarithmic axis, intervals that reach zero are clipped.
        bounds[:, 2] = np.maximum(bounds[:, 2], 0.3 * bounds[:, 1])
    c, above = colour(curve.style), 2.5 - 0.01 * curve.style
    axes.fill_between(bounds[:, 0], bounds[:, 2], bounds[:, 3], color=c, alpha=0.16, lw=0, zorder=above - 1)
    axes.plot(
        bounds[:, 0], bounds[:, 1], color=c, marker=marker(curve.style), ms=3.5, lw=1.4, label=curve.label, zorder=above
    )


def draw_law(axes: Axes, x: Array, y: Array, label: str = "") -> None:
    """Draw a dashed line for the law of theory."""
    axes.plot(x, y, color=INK, lw=0.9, ls=(0, (4, 3)), label=label or "_", zorder=3)


def logarithmic(axes: Axes, x: Array) -> None:
    """Log-log axes with plain numbers as ticks; powers of ten would leave most of these axes without ticks."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

    axes.set_xscale("log")
    axes.set_yscale("log")
    ticks = [float(x[-1])]
    for tick in x[-2::-1].tolist():
        # Closer labels would overlap.
        if tick * 1.2 < ticks[-1]:
            ticks.append(tick)
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.3g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    _plain_log_y(axes)


def _plain_log_y(axes: Axes) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    subs = (1.0, 2.0, 5.0) if high < 200 * low else (1.0,)
    axes.yaxis.set_major_locator(LogLocator(subs=subs))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _columns(labels: Iterable[str], width_in: float) -> int:
    """Number of legend entries that fit side by side: letters of 9 points, plus the line of each entry."""
    widest = max(len(text) for text in labels)
    return max(1, min(6, int(width_in / (0.068 * widest + 0.5))))


Panel = Callable[["Axes", Condition], None]


def panels_of(
    name: str, title: str, settings: Sequence[Condition], panels: Sequence[Panel], y_labels: Sequence[str], words: str
) -> Picture:
    """Conditions side by side, each with all panels, and one legend above."""
    pairs = [(s, panel, label) for s in settings for panel, label in zip(panels, y_labels, strict=True)]

    size = (max(3.0 * len(pairs), 6.0), 2.9)

    def draw(figure: Figure) -> None:
        rows = figure.subplots(1, len(pairs), squeeze=False, sharey=len(panels) == 1)[0]
        handles: dict[str, Any] = {}
        for axes, (s, panel, label) in zip(rows, pairs, strict=True):
            panel(axes, s)
            if len(settings) > 1:
                axes.set_title(s.name)
            axes.set_xlabel(DISTANCE)
            if axes is rows[0] or len(panels) > 1:
                axes.set_ylabel(label)
            for handle, text in zip(*axes.get_legend_handles_labels(), strict=True):
                handles.setdefault(text, handle)
        # With one frame per cell there are no intervals and fits, so a legend is not needed.
        if handles:
            figure.legend(
                handles.values(), handles.keys(), loc="outside upper center", ncols=_columns(handles, size[0])
            )

    caption = f"{words} {BANDS}"
    return Picture(name, caption, draw_svg(name, title, size, draw))
