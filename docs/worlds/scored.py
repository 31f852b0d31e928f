"""What the pages on worlds and surfaces share: scores as arrays, tables of groups, markers with their contours."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from roundel.datasets.dataset import Dataset
from roundel.scenes.geometry.conic import ellipse_points

TRUTH, FITTED, MISSED = (0, 190, 160), (230, 120, 0), (220, 30, 30)
ZOOM, SIDE_PX = 4, 96

Array = NDArray[np.float64]


def columns(out: Path, study: str) -> dict[str, Any]:
    """The scores of a finished study, against the truth, as arrays; nulls are NaN."""
    table = pq.read_table(out / study / "report" / "scores.parquet")
    table = table.filter(pc.equal(table["reference"], "truth"))
    return {
        name: np.array(
            [np.nan if v is None else v for v in table[name].to_pylist()]
            if pa.types.is_floating(table[name].type)
            else table[name].to_pylist()
        )
        for name in table.column_names
    }


def ellipses(out: Path, study: str, method: str) -> dict[int, Array]:
    """The fitted ellipses (n, 5) of each frame."""
    table = pq.read_table(out / study / "estimates" / "estimates.parquet")
    found: dict[int, list[list[float]]] = {}
    for row in table.to_pylist():
        if row["method"] == method and row["candidate"] == 0 and row["ellipse_x_px"] is not None:
            keys = ("x_px", "y_px", "a_px", "b_px", "angle_deg")
            found.setdefault(row["frame_id"], []).append([row[f"ellipse_{key}"] for key in keys])
    return {frame: np.array(rows) for frame, rows in found.items()}


def patch(dataset: Dataset, row: dict[str, Any], fitted: Array | None) -> Image.Image:
    """A marker's neighbourhood, enlarged, with its true contour and the fitted ellipses."""
    centre = np.rint([row["centre_image_x_px"], row["centre_image_y_px"]]).astype(int)
    left, top = centre - SIDE_PX // 2
    whole = Image.fromarray(dataset.images.image(dataset.images.frame_ids.index(row["frame_id"]))).convert("RGB")
    big = whole.crop((left, top, left + SIDE_PX, top + SIDE_PX)).resize((SIDE_PX * ZOOM,) * 2, Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(big)

    def line(points: Array, colour: tuple[int, int, int]) -> None:
        # The centre of a pixel is a whole number: its left border is half a pixel before it.
        at = (points - [left - 0.5, top - 0.5]) * ZOOM
        draw.line([tuple(p) for p in np.vstack([at, at[:1]])], fill=colour, width=2)

    line(np.column_stack([row["contour_x_px"], row["contour_y_px"]]), TRUTH)
    for ellipse in fitted if fitted is not None else []:
        line(ellipse_points(ellipse, 256), FITTED)
    return big


def group_table(scores: dict[str, Any], false: dict[tuple[str, str], int]) -> str:
    """Recall, false positives and errors of each group and method."""
    lines = [
        "| group | method | found | false positives | normal error, deg | its bound, deg | position error, % |",
        "|---|---|---|---|---|---|---|",
    ]
    for group in dict.fromkeys(scores["group"]):
        for method in sorted(set(scores["method"]), reverse=True):
            rows = (scores["group"] == group) & (scores["method"] == method)
            values = [
                np.nanmedian(scores[name][rows])
                for name in ("oracle_normal_error_deg", "normal_bound_deg", "oracle_position_error_pct")
            ]
            found = f"{int(scores['detected'][rows].sum())} of {int(rows.sum())}"
            cells = [group, method, found, str(false[group, method]), *(f"{v:.3f}" for v in values)]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def false_positives(out: Path, study: str, scores: dict[str, Any]) -> dict[tuple[str, str], int]:
    """Detections that match no marker, by group and method: all that have an ellipse, less those found."""
    groups = dict(zip(scores["frame_id"].tolist(), scores["group"].tolist(), strict=True))
    counts: dict[tuple[str, str], int] = {}
    for method in set(scores["method"]):
        for group in set(scores["group"]):
            rows = (scores["group"] == group) & (scores["method"] == method)
            every = sum(len(e) for f, e in ellipses(out, study, method).items() if groups[f] == group)
            counts[group, method] = every - int(scores["detected"][rows].sum())
    return counts


def put(file: Path, name: str, text: str) -> None:
    """Write a table between its two marks in a page."""
    page = file.read_text(encoding="utf-8")
    new, places = re.subn(
        rf"(<!-- {name} -->\n).*?(<!-- end -->)", lambda m: f"{m[1]}\n{text}\n\n{m[2]}", page, flags=re.DOTALL
    )
    if places != 1:
        raise SystemExit(f"{file.name} has {places} places for {name}; expected one")
    file.write_text(new, encoding="utf-8")


def in_a_row(tiles: list[tuple[str, Image.Image]]) -> Image.Image:
    """Tiles of one size beside each other, each under its name."""
    from PIL import ImageFont

    width, height = tiles[0][1].size
    page = Image.new("RGB", (len(tiles) * (width + 6) - 6, height + 28), (255, 255, 255))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(18)
    for i, (name, tile) in enumerate(tiles):
        draw.text((i * (width + 6), 2), name, font=font, fill=(20, 20, 20))
        page.paste(tile, (i * (width + 6), 28))
    return page
