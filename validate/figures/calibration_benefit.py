"""Figure of the benefit of a calibration: errors over distance, tilt and offset from the axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.claims.calibration_benefit import (
    BOARD,
    ERRORS,
    CalibrationBenefit,
    Panel,
    level_of,
    median_of,
)
from roundel.validate.claims.calibration_benefit_text import title_of
from roundel.validate.claims.conditions import ON_AXIS_DEG
from roundel.validate.figures.svg import INK, Picture, colour, draw_svg, marker
from roundel.validate.metrics.metric import NORMAL, Metric

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# One colour per kind of intrinsics; members of a kind differ by marker and line.
_COLOURS = {"calibrated": 0, "default": 1, "true": 2, "exif": 3, "scaled": 4, BOARD: 6}
_LINES = ("-", "--", ":", "-.")

_TITLES = {
    "distance_D": "distance [D]",
    "tilt_deg": "tilt [\N{DEGREE SIGN}]",
    "off_axis_deg": "offset from the axis [\N{DEGREE SIGN}]",
}
_PARTS = {"on_axis": "on the axis", "off_axis": "off the axis", "all": "all frames"}


def benefit_pictures(benefit: CalibrationBenefit) -> list[Picture]:
    """Median errors with their intervals: one row per error, column per variable, curve per kind of intrinsics.

    Empty if no variable has enough circles for a curve.
    """
    panels = _shown(benefit)
    if not panels:
        return []
    styles = _styles(benefit)

    def draw(figure: Figure) -> None:
        axes = figure.subplots(len(ERRORS), len(panels), squeeze=False, sharex="col", sharey="row")
        for r, error in enumerate(ERRORS):
            for c, panel in enumerate(panels):
                at = axes[r, c]
                for label, style in styles.items():
                    _curve(at, benefit, error, panel, label, style)
                at.set_yscale("log")
                if r == 0:
                    at.set_title(_PARTS[panel.part])
                if r == len(ERRORS) - 1:
                    at.set_xlabel(_TITLES[panel.variable])
                if c == 0:
                    at.set_ylabel(error.label)
        for c, panel in enumerate(panels):
            if panel.variable == "off_axis_deg":
                axes[0, c].set_xscale("symlog", linthresh=1.0, linscale=0.5)
                ticks = [t for t in (0, 1, 2, 5, 10, 20, 40, 80) if t <= 1.1 * panel.middle.max()]
                axes[0, c].set_xticks(ticks, [str(t) for t in ticks])
                axes[0, c].set_xlim(left=-0.15)
        figure.align_ylabels()
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper center", ncols=max(2, int(figure.get_figwidth() / 2.1)))

    caption = (
        f"Does calibration pay off? Method {benefit.method}: median error of the better candidate with its 95 % "
        f"interval as a band, on the same circles with every kind of intrinsics; one camera, one set of views a "
        f"calibration, so the bands are over circles only. On the axis: within "
        f"{ON_AXIS_DEG:g}\N{DEGREE SIGN} of it, as in the paper. Camera frame; D: marker diameters; reprojection in "
        "the delivered image, a grid around the circle. Chessboard: the circle's pose from the board beside the "
        "marker, by solvePnP."
    )
    size = (2.25 * len(panels) + 0.2, 2.0 * len(ERRORS) + 1.1)
    return [Picture("benefit", caption, draw_svg("benefit", caption, size, draw))]


def _shown(benefit: CalibrationBenefit) -> list[Panel]:
    """Panels: distance on and off the axis, tilt off the axis, and offset; the paper's set-up keeps one column."""
    wanted = [p for p in benefit.panels if len(p.bins) > 1]
    both = any(p.part == "off_axis" for p in wanted)
    return [p for p in wanted if not (both and p.part == "on_axis" and p.variable == "tilt_deg")]


def _styles(benefit: CalibrationBenefit) -> dict[str, dict[str, Any]]:
    """Colour, marker and line of each curve; the reference is grey, behind the others."""
    labels = [*benefit.labels, *([BOARD] if BOARD in benefit.errors[NORMAL.name] else [])]
    counted: dict[str, int] = {}
    styles: dict[str, dict[str, Any]] = {}
    for label in sorted(labels, key=lambda x: (x != benefit.calibrated, IntrinsicsLabel.of(x).views or 0)):
        kind = label.partition(":")[0]
        nth = counted[kind] = counted.get(kind, -1) + 1
        i = _COLOURS.get(kind, 5)
        main = label in (benefit.calibrated, benefit.uncalibrated)
        styles[label] = {
            "color": INK if label == BOARD else colour(i),
            "marker": marker(i) if nth == 0 else "",
            "ls": _LINES[nth % len(_LINES)],
            "lw": 1.8 if main else 1.1,
            "ms": 3.5,
            "zorder": 3 if main else 2,
            "label": title_of(label),
        }
    return {label: styles[label] for label in labels}


def _curve(
    at: Axes, benefit: CalibrationBenefit, error: Metric, panel: Panel, label: str, style: dict[str, Any]
) -> None:
    at.plot(panel.middle, _numbers([median_of(benefit, error.name, label, rows) for rows in panel.bins]), **style)
    if label in (benefit.calibrated, benefit.uncalibrated):
        # Bands of all curves would hide one another.
        found = [level_of(benefit, error.name, label, rows) for rows in panel.bins]
        low, high = _numbers([f.low for f in found]), _numbers([f.high for f in found])
        at.fill_between(panel.middle, low, high, color=style["color"], alpha=0.15, lw=0)


def _numbers(values: list[float | None]) -> NDArray[np.float64]:
    return np.array([np.nan if v is None else v for v in values], dtype=np.float64)
