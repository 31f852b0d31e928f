"""Make the figures and tables of docs/surfaces.md: `python docs/worlds/surfaces.py OUT`.

OUT contains the folders `curvature` and `crowd`, written by `roundel run STUDY OUT/STUDY`.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image, ImageDraw
from scored import MISSED, TRUTH, columns, ellipses, false_positives, group_table, in_a_row, patch, put

from roundel.datasets.dataset import open_dataset
from roundel.validate.figures.svg import Picture, draw_svg, standalone_svg

HERE = Path(__file__).parent
PAGE = HERE.parent / "surfaces.md"
DIAMETER_M = 0.08
SHOWN_M = (10.0, 0.5, 0.2, 0.07)


def medians(scores: dict[str, Any]) -> dict[str, list[tuple[float, float, int, int]]]:
    """For each method, rows of (radius in m, median normal error in degrees, solved, frames), flattest first."""
    found: dict[str, list[tuple[float, float, int, int]]] = {}
    for method in sorted(set(scores["method"]), reverse=True):
        for level in sorted(set(scores["sweep_level"]), reverse=True):
            rows = (scores["method"] == method) & (scores["sweep_level"] == level)
            error = scores["oracle_normal_error_deg"][rows]
            solved = int(np.isfinite(error).sum())
            middle = float(np.nanmedian(error)) if solved else np.nan
            found.setdefault(method, []).append((float(level), middle, solved, int(rows.sum())))
    return found


def doubling_m(rows: list[tuple[float, float, int, int]]) -> float:
    """The radius at which the median error is twice that of the flattest level, interpolated in logarithms."""
    flat = rows[0][1]
    for before, after in pairwise(rows):
        if after[1] >= 2 * flat:
            share = (np.log(2 * flat) - np.log(before[1])) / (np.log(after[1]) - np.log(before[1]))
            return float(np.exp(np.log(before[0]) + share * (np.log(after[0]) - np.log(before[0]))))
    return np.nan


def curvature_table(found: dict[str, list[tuple[float, float, int, int]]]) -> str:
    """Format the medians, and where they double."""
    methods = list(found)
    head = ["radius, m", "radius / diameter", *(f"{m}: error, deg (solved)" for m in methods)]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for i, (radius, *_) in enumerate(found[methods[0]]):
        cells = [f"{radius:g}", f"{radius / DIAMETER_M:.3g}"]
        cells += [f"{found[m][i][1]:.3g} ({found[m][i][2]} of {found[m][i][3]})" for m in methods]
        lines.append("| " + " | ".join(cells) + " |")
    said = []
    for method in methods:
        at = doubling_m(found[method])
        said.append(
            f"With `{method}` the error is twice that on flat paper at a radius of {at:.2g} m, "
            f"{at / DIAMETER_M:.3g} diameters."
            if np.isfinite(at)
            else f"With `{method}` it does not double within these radii."
        )
    return "\n".join([*lines, "", *said])


def curvature_figure(found: dict[str, list[tuple[float, float, int, int]]]) -> str:
    """Draw the medians over the radius."""

    def draw(page: Figure) -> None:
        axes = page.subplots()
        for method, rows in found.items():
            axes.plot([r[0] / DIAMETER_M for r in rows], [r[1] for r in rows], marker="o", label=method)
            at = doubling_m(rows)
            if np.isfinite(at):
                axes.axvline(at / DIAMETER_M, linestyle=":", linewidth=1, color="0.5")
        axes.set(xscale="log", yscale="log", xlabel="radius of curvature / diameter", ylabel="normal error, deg")
        axes.invert_xaxis()
        axes.grid(alpha=0.3)
        axes.legend()

    return standalone_svg(
        Picture("curvature", "", draw_svg("curvature", "Normal error over curvature", (6.4, 3.6), draw))
    )


def curvature_picture(out: Path, scores: dict[str, Any]) -> Image.Image:
    """The worst frame at some radii."""
    dataset = open_dataset(out / "curvature" / "dataset")
    truth = {row["frame_id"]: row for row in dataset.truth.to_pylist()}
    fitted = ellipses(out, "curvature", "pixels")
    tiles = []
    for radius in SHOWN_M:
        rows = np.flatnonzero((scores["method"] == "pixels") & (scores["sweep_level"] == radius))
        error = scores["oracle_normal_error_deg"][rows]
        i = rows[int(np.nanargmax(error))]
        frame = int(scores["frame_id"][i])
        tiles.append((f"{radius:g} m: {np.nanmax(error):.2g} deg", patch(dataset, truth[frame], fitted.get(frame))))
    return in_a_row(tiles)


def crowd_picture(out: Path, scores: dict[str, Any]) -> Image.Image:
    """The first frame of each group, with the contours of what was found and missed."""
    dataset = open_dataset(out / "crowd" / "dataset")
    truth = dataset.truth.to_pylist()
    mine = scores["method"] == "pixels"
    found = {
        (int(f), int(m)): bool(d)
        for f, m, d in zip(scores["frame_id"][mine], scores["marker_id"][mine], scores["detected"][mine], strict=True)
    }
    tiles = []
    for group in ("five", "ten", "twenty", "tabletop"):
        frame = next(row["frame_id"] for row in truth if row["group"] == group)
        image = Image.fromarray(dataset.images.image(dataset.images.frame_ids.index(frame))).convert("RGB")
        draw = ImageDraw.Draw(image)
        for row in truth:
            if row["frame_id"] == frame:
                points = [*zip(row["contour_x_px"], row["contour_y_px"], strict=True)]
                colour = TRUTH if found[frame, row["marker_id"]] else MISSED
                draw.line([*points, points[0]], fill=colour, width=3)
        tiles.append(image.resize((640, 360), Image.Resampling.LANCZOS))
    page = Image.new("RGB", (640 * 2 + 6, 360 * 2 + 6), (255, 255, 255))
    for i, tile in enumerate(tiles):
        page.paste(tile, ((i % 2) * 646, (i // 2) * 366))
    return page


def main(out: Path) -> None:
    """Write the figures next to this script, and the tables into the page."""
    bent, crowd = columns(out, "curvature"), columns(out, "crowd")
    found = medians(bent)
    (HERE / "curvature.svg").write_text(curvature_figure(found), encoding="utf-8")
    curvature_picture(out, bent).save(HERE / "curvature.jpg", quality=88, optimize=True)
    crowd_picture(out, crowd).save(HERE / "crowd.jpg", quality=88, optimize=True)
    put(PAGE, "curvature", curvature_table(found))
    put(PAGE, "crowd", group_table(crowd, false_positives(out, "crowd", crowd)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
