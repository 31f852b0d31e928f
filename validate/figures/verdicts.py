"""A figure for each verdict: means with 95 % intervals over distance, a panel for each condition."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.claims.claim import trend_conditions
from roundel.validate.claims.conditions import NORMAL, POSITION, REPROJECTION, Condition, conditions_of
from roundel.validate.claims.normal import SAME_DEG, added
from roundel.validate.claims.position import predicted_D
from roundel.validate.claims.reprojection import NEAR, ratios_over_distance
from roundel.validate.claims.verdicts import Verdict
from roundel.validate.figures.svg import Picture, add_legend, colour, draw_svg, marker
from roundel.validate.figures.verdict_curves import (
    BANDS,
    DISTANCE,
    Curve,
    curve_by_distance,
    curves_of_cases,
    draw_curve,
    draw_law,
    logarithmic,
    panels_of,
)
from roundel.validate.metrics.rows import Rows
from roundel.validate.scores.summary import number
from roundel.validate.statistics.trends import Estimate, mean_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_PANELS = 3
# Closer to the axis, the part of the bias that falls with the square of the distance dominates.
_FAR_DEG = 5.0


def verdict_pictures(table: Rows, study: dict[str, Any], verdicts: Sequence[Verdict]) -> list[Picture]:
    """A picture for each verdict, with the name that the verdict gives.

    Parameters
    ----------
    table : Rows
        Scores.
    study : dict
        The resolved study.
    verdicts : sequence of Verdict
        From `verdicts_of` of the same table and study.
    """
    if not verdicts:
        return []
    settings = conditions_of(table, study)
    return [_FIGURES[v.claim.key](v.picture, v.claim.claim, _shown_conditions(v.claim.key, settings)) for v in verdicts]


def _shown_conditions(key: str, settings: Sequence[Condition]) -> list[Condition]:
    return list(settings) if key == "normal-focal" else trend_conditions(settings)[:_MAX_PANELS]


def _normal_distance(name: str, title: str, settings: Sequence[Condition]) -> Picture:
    def panel(axes: Axes, s: Condition) -> None:
        distances, (tilts, at_tilt) = s.distances()[0], s.tilts()
        for i, tilt in enumerate(tilts):
            values = np.where(at_tilt == i, s.of(s.right, NORMAL), np.nan)
            draw_curve(axes, curve_by_distance(s, values, f"tilt {tilt:.3g}\N{DEGREE SIGN}", i))
        start = float(np.nanmean(np.where(s.distances()[1] == 0, s.of(s.right, NORMAL), np.nan)))
        draw_law(axes, distances, start * (distances / distances[0]), "proportional to distance")
        logarithmic(axes, distances)

    words = "Error of the normal with the right focal length over distance, one curve per tilt."
    return panels_of(name, title, settings, [panel], ["normal [deg]"], words)


def _normal_tilt(name: str, title: str, settings: Sequence[Condition]) -> Picture:
    def panel(axes: Axes, s: Condition) -> None:
        (distances, at), (tilts, at_tilt) = s.distances(), s.tilts()
        for t in range(1, len(tilts)):
            ratios: list[Estimate | None] = []
            for d in range(len(distances)):
                pair = [
                    mean_of(np.where((at == d) & (at_tilt == i), s.of(s.right, NORMAL), np.nan), s.frame)
                    for i in (0, t)
                ]
                ratios.append(pair[0].log() - pair[1].log() if pair[0] and pair[1] else None)
            label = f"{tilts[0]:.3g}\N{DEGREE SIGN} over {tilts[t]:.3g}\N{DEGREE SIGN}"
            draw_curve(axes, Curve(label, distances, ratios, t, as_ratio=True))
        draw_law(axes, distances, np.ones(len(distances)))
        logarithmic(axes, distances)

    words = (
        "Ratio of the error of the normal at the lowest tilt to that at each other tilt, by distance; above the dashed "
        "line the lowest tilt is worse."
    )
    return panels_of(name, title, settings, [panel], ["ratio of normal errors"], words)


def _position_calibrated(name: str, title: str, settings: Sequence[Condition]) -> Picture:
    def draw(figure: Figure) -> None:
        strict, lenient = figure.subplots(1, 2)
        for i, s in enumerate(settings):
            draw_curve(strict, curve_by_distance(s, s.of(s.right, POSITION), s.name, i))
        logarithmic(strict, settings[0].distances()[0])
        for curve in curves_of_cases(settings[0], POSITION):
            draw_curve(lenient, curve)
        lenient.set_ylim(bottom=0)
        strict.set_title("calibrated, alone")
        lenient.set_title("on the paper's axis" + (f", {settings[0].name}" if len(settings) > 1 else ""))
        for axes in (strict, lenient):
            axes.set_xlabel(DISTANCE)
            axes.set_ylabel("position [D]")
        if len(settings) > 1:
            add_legend(strict)
        add_legend(lenient)

    caption = (
        "The calibrated curve twice: alone on logarithmic axes, and on the paper's axis, which extends to the "
        f"uncalibrated curves. {BANDS}"
    )
    return Picture(name, caption, draw_svg(name, title, (7.0, 2.9), draw))


def _position_uncalibrated(name: str, title: str, settings: Sequence[Condition]) -> Picture:
    def panel(axes: Axes, s: Condition) -> None:
        distances, at = s.distances()
        for curve in curves_of_cases(s, POSITION):
            draw_curve(axes, curve)
        for label in s.wrong:
            predicted = predicted_D(s, label)
            means = np.array([np.nanmean(predicted[at == d]) for d in range(len(distances))])
            draw_law(axes, distances, means, "noise-free |k - 1| r")
        logarithmic(axes, distances)

    words = "Error of position over distance; dashed: the error due to the focal length alone, without noise."
    return panels_of(name, title, settings, [panel], ["position [D]"], words)


def _reprojection_calibrated(name: str, title: str, settings: Sequence[Condition]) -> Picture:
    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for i, s in enumerate(settings):
            draw_curve(axes, curve_by_distance(s, s.of(s.right, REPROJECTION), s.name, i))
        axes.set_xlabel(DISTANCE)
        axes.set_ylabel("reprojection [px]")
        axes.set_ylim(bottom=0)
        if len(settings) > 1:
            add_legend(figure, loc="outside upper center", ncols=len(settings))

    words = "Reprojection error with the right focal length over distance"
    words += ", one curve per condition." if len(settings) > 1 else "."
    caption = f"{words} {BANDS}"
    return Picture(name, caption, draw_svg(name, title, (6.0, 2.9), draw))


def _reprojection(name: str, title: str, settings: Sequence[Condition]) -> Picture:
    def panel(axes: Axes, s: Condition) -> None:
        distances = s.distances()[0]
        curves = curves_of_cases(s, REPROJECTION)
        for curve in curves:
            draw_curve(axes, curve)
        top = max(c.y[0].value for c in curves if c.y[0] is not None)
        power = 2 if s.on_axis or np.median(s.off_axis_deg) < _FAR_DEG else 1
        law = "1/distance" + ("\N{SUPERSCRIPT TWO}" if power == 2 else "")
        draw_law(axes, distances, 1.4 * top * (distances[0] / distances) ** power, f"falls as {law}")
        logarithmic(axes, distances)

    words = "Reprojection error over distance, the paper's figure; dashed: how the bias of a wrong focal length falls."
    return panels_of(name, title, settings, [panel], ["reprojection [px]"], words)


def _reprojection_meets(name: str, title: str, settings: Sequence[Condition]) -> Picture:
    def panel(axes: Axes, s: Condition) -> None:
        distances = s.distances()[0]
        for i, label in enumerate(s.wrong, start=1):
            draw_curve(
                axes,
                Curve(IntrinsicsLabel.of(label).short, distances, ratios_over_distance(s, label), i, as_ratio=True),
            )
        draw_law(axes, distances, np.full(len(distances), NEAR), f"{NEAR:g} times")
        logarithmic(axes, distances)

    words = "Reprojection error with a wrong focal length over that with the right one, on the same frames."
    return panels_of(name, title, settings, [panel], ["uncalibrated / calibrated"], words)


def _points(pairs: Sequence[tuple[float, Estimate]]) -> tuple[list[float], list[float], list[float]]:
    """x, y and half-width of the interval."""
    return (
        [k for k, _ in pairs],
        [e.value for _, e in pairs],
        [e.interval()[1] - e.value for _, e in pairs],
    )


def _normal_focal(name: str, title: str, settings: Sequence[Condition]) -> Picture:
    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for i, s in enumerate(settings[:7]):
            changes = {n: e for n in s.wrong if (e := mean_of(added(s, n), s.frame)) is not None}
            angle = f"{number(float(np.median(s.off_axis_deg)), 2)}\N{DEGREE SIGN} off axis"
            # Offset horizontally so that conditions do not cover each other.
            shift = 0.004 * (i - (min(len(settings), 7) - 1) / 2)
            pure = [(s.factor[n] + shift, e) for n, e in changes.items() if n in s.pure]
            # The true focal length adds no error; without this point the line would skip its zero.
            pure.append((1.0 + shift, Estimate(0.0, np.zeros(1), 1, 0)))
            pure.sort(key=lambda point: point[0])
            else_wrong = [(s.factor[n] + shift, e) for n, e in changes.items() if n not in s.pure]
            style: Any = {"color": colour(i), "marker": marker(i), "ms": 4, "lw": 1.2, "capsize": 2}
            if len(pure) > 1:
                axes.errorbar(*_points(pure), **style, label=f"{s.name}, {angle}")
            if else_wrong:
                hollow = {"mfc": "none", "ls": "none", "label": None if len(pure) > 1 else f"{s.name}, {angle}"}
                axes.errorbar(*_points(else_wrong), **{**style, **hollow})
        axes.axhspan(-SAME_DEG, SAME_DEG, color=colour(6), alpha=0.25, lw=0)
        axes.set_xlabel("focal length used / true")
        axes.set_ylabel("added to normal error [deg]")
        add_legend(figure, loc="outside upper center", ncols=2 if len(settings) > 1 else 1)

    words = (
        "Increase of the mean error of the normal by a wrong focal length, paired by frame; changes within the grey "
        "band count as none. Hollow: intrinsics that are wrong in more than the focal length."
    )
    size = (6.0, 2.9 + 0.15 * math.ceil(len(settings) / 2))
    return Picture(name, f"{words} Bars: 95 % interval.", draw_svg(name, title, size, draw))


_FIGURES: dict[str, Callable[[str, str, Sequence[Condition]], Picture]] = {
    "normal-distance": _normal_distance,
    "normal-tilt": _normal_tilt,
    "position-calibrated": _position_calibrated,
    "position-uncalibrated": _position_uncalibrated,
    "reprojection-calibrated": _reprojection_calibrated,
    "reprojection-uncalibrated": _reprojection,
    "reprojection-meets": _reprojection_meets,
    "normal-focal": _normal_focal,
}
