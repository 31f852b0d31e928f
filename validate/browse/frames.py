"""What the page knows of frames and markers: the truth of a shard as columns of JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from roundel.datasets.dataset import Dataset
from roundel.scenes.display_text import NAME_LIMIT, clean
from roundel.scenes.errors import DataError
from roundel.validate.browse.outlines import packed, packed_outline

_MOST_POINTS = 64
_DIGITS = 5


@dataclass(frozen=True)
class Variable:
    """A number of a marker: its column, its title and unit, and whether the page filters and sorts by it."""

    key: str
    title: str
    unit: str = ""
    filtered: bool = False


VARIABLES = (
    Variable("distance_D", "Distance", "D", filtered=True),
    Variable("distance_m", "Distance", "m"),
    Variable("tilt_deg", "Tilt", "\N{DEGREE SIGN}", filtered=True),
    Variable("azimuth_deg", "Azimuth", "\N{DEGREE SIGN}"),
    Variable("visible_fraction", "Visible fraction", filtered=True),
    Variable("edge_contrast_dn", "Edge contrast", "DN", filtered=True),
    Variable("edge_blur_px", "Edge blur", "px", filtered=True),
    Variable("edge_noise_dn", "Edge noise", "DN"),
    Variable("radius_m", "Radius", "m"),
    Variable("ellipse_a_px", "Semi-major axis", "px"),
    Variable("ellipse_b_px", "Semi-minor axis", "px"),
    Variable("centre_image_x_px", "Centre, x", "px"),
    Variable("centre_image_y_px", "Centre, y", "px"),
)
TEXTS = {"kind": "Kind", "surface": "Surface", "hidden_by": "Hidden by", "flags": "Flags"}


def described() -> dict[str, Any]:
    """The variables and texts as the page lists them."""
    return {
        "variables": [asdict(variable) for variable in VARIABLES],
        "texts": [{"key": key, "title": title} for key, title in TEXTS.items() if key != "kind"],
    }


def shard_record(shard: Dataset) -> dict[str, Any]:
    """Frames and markers of a shard, a list a column.

    `frames` has `id, group, width_px, height_px, suffix` (of the image file; null in points mode). `markers`
    has `frame` (position in `frames`), `id`, the texts and variables, and `outline`, `closed`, `points` of `outlines`.
    """
    images, truth = shard.images, shard.truth.combine_chunks()
    ids = images.frame_ids
    place = {frame_id: i for i, frame_id in enumerate(ids)}
    frames = {
        "id": ids,
        "group": [clean(group, NAME_LIMIT) for group in images.groups],
        "width_px": [int(record["width_px"]) for record in images.records],
        "height_px": [int(record["height_px"]) for record in images.records],
        "suffix": [image_suffix(shard, i) for i in range(len(ids))],
    }
    of_frame, marker = (truth[name].to_pylist() for name in ("frame_id", "marker_id"))
    unknown = next((frame_id for frame_id in of_frame if frame_id not in place), None)
    if unknown is not None:
        raise DataError(
            f"{shard.address}: the truth has frame {unknown}, the cameras do not; `roundel repair` mends it"
        )
    outlines = _outlines(truth)
    markers = {
        "frame": [place[frame_id] for frame_id in of_frame],
        "id": marker,
        **{key: texts(truth, key) for key in TEXTS},
        **{variable.key: numbers(truth, variable.key) for variable in VARIABLES},
        "outline": [outline for outline, _ in outlines],
        "closed": [int(closed) for _, closed in outlines],
        "points": [_points(shard, place[f], m) for f, m in zip(of_frame, marker, strict=True)],
    }
    return {"frames": frames, "markers": markers}


def image_suffix(dataset: Dataset, i: int) -> str | None:
    """`.png` or `.jpg`; None for a frame without an image."""
    if dataset.images.mode(i) != "images":
        return None
    return ".jpg" if dataset.images.is_jpeg(i) else ".png"


def numbers(table: pa.Table, key: str) -> list[float | None]:
    """A column with five digits; null where there is no finite number, or no such column in an older version."""
    if key not in table.column_names:
        return [None] * table.num_rows
    return [
        float(f"{value:.{_DIGITS}g}") if value is not None and np.isfinite(value) else None
        for value in table[key].to_pylist()
    ]


def texts(table: pa.Table, key: str, limit: int = NAME_LIMIT) -> list[str | None]:
    """A column of text that is safe to display; null where there is none."""
    if key not in table.column_names:
        return [None] * table.num_rows
    return [clean(text, limit) if text else None for text in table[key].to_pylist()]


def _outlines(truth: pa.Table) -> list[tuple[list[int], bool]]:
    if not {"contour_x_px", "contour_y_px"} <= set(truth.column_names):
        return [([], False)] * truth.num_rows
    found = []
    for x, y in zip(truth["contour_x_px"], truth["contour_y_px"], strict=True):
        xy = [np.asarray([] if values.values is None else values.values, dtype=np.float64) for values in (x, y)]
        found.append(packed_outline(*xy))
    return found


def _points(dataset: Dataset, i: int, marker_id: int) -> list[int] | None:
    """Edge points of a frame without an image, evenly thinned."""
    if dataset.images.mode(i) != "points":
        return None
    points = dataset.images.points(i).get(marker_id, np.empty((0, 2)))
    some = np.unique(np.linspace(0, max(len(points) - 1, 0), min(len(points), _MOST_POINTS)).astype(int))
    return packed(points[some])
