"""The worst frames: image crops with the true contour and the estimated ellipse."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.scenes.display_text import NAME_LIMIT, clean
from roundel.scenes.errors import DataError
from roundel.solver.detect.chessboard_corners import grey
from roundel.validate.metrics.pose_errors import contour_of_ellipse_px
from roundel.validate.metrics.rows import flag_column, in_memory
from roundel.validate.scores.scores import Scores
from roundel.validate.scores.stated_uncertainty import worst_stated
from roundel.validate.scores.summary import CHESSBOARD, number, run_keys, run_rows

Array = NDArray[np.float64]

# Larger crops are subsampled: more pixels show no further detail and enlarge the report.
_MAX_CROP_PX = 220
_MAX_OVERLAYS = 48
_FARTHEST_PX = 1e9


@dataclass(frozen=True)
class Overlay:
    """One picture: its title, its errors, and the SVG with its image inlined."""

    title: str
    text: str
    svg: str


def worst(dataset: Dataset, scores: Scores, errors: int = 6, failures: int = 6) -> list[Overlay]:
    """Overlays of the frames with the largest oracle normal error and of frames that were not solved.

    Each method shows the frames of its most accurate intrinsics, because a wrong focal length affects all frames alike.
    """
    found: list[Overlay] = []
    known = _accurate(scores)
    # Many methods share the space of the page.
    errors, failures = (max(1, min(n, _MAX_OVERLAYS // (2 * max(1, len(known))))) for n in (errors, failures))
    for key in known[: _MAX_OVERLAYS // 2]:
        rows = run_rows(scores.table, key)
        order = [("oracle_normal_error_deg", "descending"), ("frame_id", "ascending"), ("marker_id", "ascending")]
        posed = rows.filter(rows["oracle_normal_error_deg"].is_valid())
        keys = pa.table({name: posed[name] for name, _ in order})
        ranked = in_memory(posed, pc.sort_indices(keys, sort_keys=order)[:errors]).to_pylist()
        lost = np.flatnonzero(~flag_column(rows, "solved"))
        # Failures from the whole run are more informative than the first few.
        step = max(1, len(lost) // failures)
        spread = in_memory(rows, pa.array(lost[::step][:failures])).to_pylist()
        found.extend(_overlay(dataset, scores, row, _errors(row)) for row in (*ranked, *spread))
    return found


def worst_stated_overlays(dataset: Dataset, scores: Scores, count: int = 3) -> list[Overlay]:
    """Overlays of the circles whose truth is farthest outside of what was stated for them; as `worst` otherwise."""
    return [
        _overlay(dataset, scores, row, _stated(row))
        for key in _accurate(scores)[: _MAX_OVERLAYS // (4 * count)]
        for row in worst_stated(run_rows(scores.table, key), count)
    ]


def _accurate(scores: Scores) -> list[tuple[str, str, str]]:
    """The run of each method with its most accurate intrinsics, against the truth."""
    known = [(method, label) for method, label, reference in run_keys(scores.table) if reference == "truth"]
    found = []
    for method in sorted({method for method, _ in known} - {CHESSBOARD}):
        labels = (label for m, label in known if m == method)
        label = min(labels, key=lambda x: (not IntrinsicsLabel.of(x).is_right, IntrinsicsLabel.of(x).rank))
        found.append((method, label, "truth"))
    return found


def _errors(row: dict[str, Any]) -> str:
    if not row["solved"]:
        return f"not solved: {row['reason']}"
    return (
        f"normal {number(row['oracle_normal_error_deg'])}\N{DEGREE SIGN}, "
        f"position {number(row['oracle_position_error_pct'])} %, contour {number(row['contour_error_px'])} px"
    )


def _stated(row: dict[str, Any]) -> str:
    angles = (f"{number(row[f'oracle_normal_{name}_deg'])}\N{DEGREE SIGN}" for name in ("error", "sigma"))
    lengths = (f"{number(1e3 * row[f'oracle_position_{name}_m'])} mm" for name in ("error", "sigma"))
    (normal, its_sigma), (position, sigma) = angles, lengths
    chi2 = number(row["oracle_pose_chi2"])
    return f"Chi-square {chi2}; normal {normal} (stated {its_sigma}), position {position} (stated {sigma})"


def _overlay(dataset: Dataset, scores: Scores, row: dict[str, Any], what: str) -> Overlay:
    targets, candidates = scores.matched(row["frame_id"])[row["method"], row["intrinsics"]]
    same = (targets.frame_id == row["frame_id"]) & (targets.marker_id == row["marker_id"])
    target = int(np.flatnonzero(same)[0])
    truth = targets.contour_px[target]
    estimate: Array | None = None
    if candidates.has[target].any():
        which = int(np.argmax(candidates.has[target]))
        camera = candidates.cameras[candidates.camera[target, which]]
        estimate = contour_of_ellipse_px(candidates.ellipse[target, which], camera, 128)
    title = f"frame {row['frame_id']}" + (f", marker {row['marker_id']}" if row["marker_id"] else "")
    place = f"{number(row['distance_D'])} D, tilt {number(row['tilt_deg'])}\N{DEGREE SIGN}"
    names = ", ".join(clean(row[name], NAME_LIMIT) for name in ("method", "intrinsics"))
    return Overlay(f"{title} ({names})", f"{place}. {clean(what, 300)}", _svg(dataset, row, truth, estimate))


def _svg(dataset: Dataset, row: dict[str, Any], truth: Array, estimate: Array | None) -> str:
    # Of an altered truth, points may be anywhere.
    visible = truth[(np.abs(truth) < _FARTHEST_PX).all(axis=-1)]
    if not len(visible):
        return ""
    i = dataset.images.frame_ids.index(row["frame_id"])
    record = dataset.images.records[i]
    limit = np.array([record["width_px"], record["height_px"]])
    low, high = visible.min(axis=0), visible.max(axis=0)
    margin = max(6.0, 0.3 * float((high - low).max()))
    # A square around the contour, clipped to the image.
    middle, reach = (low + high) / 2, float((high - low).max()) / 2 + margin
    x0, y0 = np.clip(np.floor(middle - reach).astype(int), 0, limit - 1)
    x1, y1 = np.clip(np.ceil(middle + reach).astype(int) + 1, 1, limit)
    width, height = int(x1 - x0), int(y1 - y0)
    under = _points(dataset, i, row, max(width, height)) if dataset.images.mode(i) == "points" else ""
    if dataset.images.mode(i) == "images":
        under = _image(dataset.images.image(i), int(x0), int(y0), width, height)
    # The centre of pixel (0, 0) is the origin, so the raster begins half a pixel before it.
    box = f"{x0 - 0.5} {y0 - 0.5} {width} {height}"
    lines = [_path(visible, "truth", closed=len(visible) == len(truth))]
    if estimate is not None:
        lines.append(_path(estimate, "estimate", closed=True))
    label = f"Frame {row['frame_id']}: true contour and estimate"
    return f'<svg class="overlay" viewBox="{box}" role="img" aria-label="{label}">{under}{"".join(lines)}</svg>'


def _path(points: Array, kind: str, closed: bool) -> str:
    text = " ".join(f"{x:.2f},{y:.2f}" for x, y in points if np.isfinite(x) and np.isfinite(y))
    return f'<{"polygon" if closed else "polyline"} class="{kind}" points="{text}"/>'


def _points(dataset: Dataset, i: int, row: dict[str, Any], size: int) -> str:
    """Edge points of a frame without an image, as dots."""
    points = dataset.images.points(i).get(row["marker_id"], np.empty((0, 2)))
    radius = size / 250
    # Evenly spaced along the contour; this number is enough to show it.
    some = np.unique(np.linspace(0, max(len(points) - 1, 0), min(len(points), 300)).astype(int))
    return "".join(f'<circle class="point" cx="{x:.2f}" cy="{y:.2f}" r="{radius:.2f}"/>' for x, y in points[some])


def _image(image: NDArray[Any], x0: int, y0: int, width: int, height: int) -> str:
    """The crop as an inlined PNG, its pixels drawn as squares; contrast stretched to the crop."""
    from PIL import Image

    crop = grey(image)[y0 : y0 + height, x0 : x0 + width]
    if not crop.size:
        raise DataError("a marker lies outside its image; the dataset is corrupt")
    low, high = float(crop.min()), float(crop.max())
    levels = np.rint((crop - low) * (255 / max(high - low, 1e-9))).astype(np.uint8)
    step = -(-max(width, height) // _MAX_CROP_PX)
    picture = Image.fromarray(levels)
    if step > 1:
        picture = picture.resize((max(1, width // step), max(1, height // step)), Image.Resampling.BOX)
    sink = io.BytesIO()
    picture.save(sink, format="PNG", optimize=False, compress_level=9)
    data = base64.b64encode(sink.getvalue()).decode()
    return (
        f'<image x="{x0 - 0.5}" y="{y0 - 0.5}" width="{width}" height="{height}" preserveAspectRatio="none" '
        f'href="data:image/png;base64,{data}"/>'
    )
