"""Figures of calibrations: projection error over the image, beside the residual."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roundel.validate.calibration.study_calibrations import Calibrations
from roundel.validate.figures.svg import INK, Picture, colour, draw_svg, marker

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# Shades of one colour by opacity, so that the map works on light and dark pages.
_STEPS = (1.0, 2.0, 5.0)
_PANELS_A_ROW = 4


def calibration_pictures(calibrations: Calibrations | None) -> list[Picture]:
    """The maps and the scatter plot of a set of calibrations; empty if there is nothing to draw."""
    if calibrations is None or not calibrations.differences:
        return []
    return [_maps(calibrations), *([_scatter(calibrations)] if calibrations.subsets else [])]


def _levels(largest: float, smallest: float) -> Array:
    """Steps of 1, 2, 5 that cover the range of the maps, at most nine."""
    decades = range(int(np.floor(np.log10(max(smallest, largest / 100)))), int(np.ceil(np.log10(largest))) + 1)
    steps = np.array([step * 10.0**decade for decade in decades for step in _STEPS])
    first = max(0, int(np.searchsorted(steps, max(smallest, largest / 100))) - 1)
    last = int(np.searchsorted(steps, largest)) + 1
    return steps[max(first, last - 9) : last]


def _maps(calibrations: Calibrations) -> Picture:
    lengths = [np.linalg.norm(d.rotated, axis=-1) for d in calibrations.differences]
    known = np.concatenate([length[np.isfinite(length)] for length in lengths])
    levels = _levels(float(known.max()), float(np.percentile(known, 5)))
    columns = min(len(lengths), _PANELS_A_ROW)
    rows = -(-len(lengths) // columns)

    def draw(figure: Figure) -> None:
        from matplotlib.colors import to_rgba

        axes = figure.subplots(rows, columns, squeeze=False)
        shades = [to_rgba(colour(0), float(a)) for a in np.linspace(0.04, 0.95, len(levels))]
        filled = None
        panels = zip(axes.flat, calibrations.records, calibrations.differences, lengths, strict=False)
        for at, record, difference, length in panels:
            x, y = difference.x_px, difference.y_px
            clipped = np.clip(np.ma.masked_invalid(length), levels[0], None)
            filled = at.contourf(x, y, clipped, levels=levels, colors=shades[:-1])
            at.contour(x, y, clipped, levels=levels, colors=[INK], linewidths=0.4, alpha=0.35)
            _arrows(at, difference.rotated, x, y)
            at.set_xlim(x[0], x[-1])
            at.set_ylim(y[-1], y[0])
            at.set_aspect("equal")
            at.grid(visible=False)
            at.set_xticks([])
            at.set_yticks([])
            mean = record["projection_mean_rotated_px"]
            at.set_title(f"{record['views']} views\nRMS {record['rms_px']:.3f}, off {mean:.3f} px")
            for side in at.spines.values():
                side.set_visible(True)
        for at in axes.flat[len(lengths) :]:
            at.set_axis_off()
        assert filled is not None
        bar = figure.colorbar(filled, ax=axes, location="bottom", aspect=60, fraction=0.06, ticks=levels)
        bar.set_label("projection difference [px], rotation removed")
        bar.ax.set_xticklabels([f"{level:g}" for level in levels])
        bar.ax.grid(visible=False)

    caption = (
        "Each calibration against the true camera: distance between the projections of the same ray over the whole "
        "image, with the best-fit rotation removed, on one scale. Arrows of equal length show the direction of the "
        "difference. Titles: views, residual RMS, mean difference. OpenCV pixels of the delivered image."
    )
    size = (9.0 if columns > 2 else 6.0, rows * (1.9 if columns > 2 else 2.3) + 0.9)
    return Picture("calibration-maps", caption, draw_svg("calibration-maps", caption, size, draw))


def _arrows(at: Any, offsets: Array, x: Array, y: Array) -> None:
    """Directions of the difference at a few points."""
    some = offsets[1::4, 2::4]
    length = np.linalg.norm(some, axis=-1, keepdims=True)
    unit = np.where(length > 0, some / np.where(length > 0, length, 1.0), 0.0)
    u, v = (np.ma.masked_invalid(unit[..., i]) for i in (0, 1))
    at.quiver(
        *np.meshgrid(x[2::4], y[1::4]),
        u,
        v,
        angles="xy",
        scale_units="xy",
        scale=0.012,
        width=0.005,
        color=INK,
        alpha=0.5,
    )


def _scatter(calibrations: Calibrations) -> Picture:
    """Residual against true error, one dot per calibration."""
    draws = calibrations.subsets
    counts = sorted({s["views"] for s in draws})

    def draw(figure: Figure) -> None:
        named = "fx_error_pct" in draws[0]
        axes = figure.subplots(1, 2 if named else 1, squeeze=False)[0]
        for i, count in enumerate(counts):
            mine = [s for s in draws if s["views"] == count]
            label = f"{len(mine)} draws of {count} views"
            rms = [s["rms_px"] for s in mine]
            style: dict[str, Any] = {"ls": "none", "marker": marker(i), "ms": 5, "color": colour(i), "label": label}
            axes[0].plot(rms, [s["projection_mean_rotated_px"] for s in mine], **style)
            if named:
                axes[1].plot(rms, [s["fx_error_pct"] for s in mine], **style)
        style = {"ls": "none", "marker": marker(len(counts)), "ms": 7, "color": colour(len(counts))}
        largest = calibrations.records[-1]
        style["label"] = f"the first {largest['views']} views"
        axes[0].plot([largest["rms_px"]], [largest["projection_mean_rotated_px"]], **style)
        if named:
            axes[1].plot([largest["rms_px"]], [largest["fx_error_pct"]], **style)
            axes[1].set_ylabel("fx, calibrated minus true [%]")
            axes[1].axhline(0.0, color=INK, lw=0.8)
        axes[0].set_ylabel("projection difference, mean [px]")
        axes[0].set_ylim(bottom=0)
        for at in axes:
            at.set_xlabel("residual RMS [px]")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(counts) + 1)

    caption = (
        "Does the residual show which calibration is better? Residual RMS against the true error of the camera, for "
        "calibrations from randomly drawn views. Left: mean difference of projection over the image, with the best-fit "
        "rotation removed. Right: error of the focal length."
    )
    return Picture("calibration-residuals", caption, draw_svg("calibration-residuals", caption, (7.5, 3.0), draw))
