"""Detection benchmark: recall at each level of each nuisance, and false positives.

    python benchmarks/solver/detection.py [WORK] [--studies noise,defocus,...] [--beyond] [--json FILE]

WORK (default out/bench-detection) holds a dataset for each study, rendered if it is missing. A circle counts as
detected if the centre is within 2 px plus a tenth of the semi-minor axis, and both semi-axes are within 10 % plus 1 px,
of the ellipse through the true contour in the image. Every other detection is a false positive, unless it is a disc of
the study's clutter. False positives are counted per frame, and again for a confidence of at least one half.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.layout.files import MANIFEST, STUDY
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.markers.value_noise import CLUTTER_LEAST, CLUTTER_MORE, CLUTTER_PLACE, CLUTTER_SHAPE, pcg3d, unit
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import Frame, frames_of
from roundel.solver.detect.detect import Detection, detect
from roundel.solver.fit.ellipse import FailedFit, direct_ellipse
from roundel.solver.photometry.image_levels import grey_levels
from roundel.validate.statistics.intervals import wilson_interval

Array = NDArray[np.float64]

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
NUISANCES = (
    "detection",
    "noise",
    "defocus",
    "motion",
    "occlusion",
    "lighting",
    "rolling_shutter",
    "distortion",
    "off_axis",
    "jpeg",
)
# Levels beyond those of the shipped studies, to find where detection fails: --beyond renders and adds them. Other keys
# that must change with them are listed, too: a longer exposure needs a longer frame time.
BEYOND: dict[str, tuple[list[float], dict[str, float]]] = {
    "noise": ([125, 60, 30, 15, 8], {}),
    "defocus": ([1.4, 1.0, 0.7, 0.5, 0.35], {}),
    "motion": ([0.045, 0.06, 0.08, 0.11, 0.15], {"motion.frame_s": 0.2}),
    "occlusion": ([0.03, 0.02, 0.01, 0.0], {}),
    "lighting": ([0.02, 0.01, 0.005, 0.002], {}),
    "rolling_shutter": ([0.05, 0.1, 0.2], {"motion.frame_s": 0.3}),
    "distortion": ([0.35, 0.5], {}),
    "jpeg": ([10, 5, 2, 1], {}),
}
WANTED_RECALL = 0.9
CONFIDENT = 0.5
THREADS = 2


@dataclass(frozen=True)
class Outcome:
    """Result of one frame: its detected markers with their confidences, and the confidences of false positives."""

    frame_id: int
    group: str
    level: float | None
    visible: float
    found: tuple[bool, ...]
    confidence: tuple[float, ...]
    false: tuple[float, ...]


def same(one: Array, other: Array) -> bool:
    """Whether a detection matches the truth by the criterion of this benchmark."""
    b = float(other[3])
    centre = float(np.hypot(*(one[:2] - other[:2])))
    return centre <= 2.0 + 0.1 * b and bool(np.all(np.abs(one[2:4] - other[2:4]) <= 1.0 + 0.1 * other[2:4]))


def true_ellipses(rows: Iterable[dict[str, Any]]) -> list[Array]:
    """Ellipses through the true contours, including lens distortion."""
    out = []
    for row in rows:
        if row["radius_m"] is None:
            continue
        points = np.stack([row["contour_x_px"], row["contour_y_px"]], axis=1)
        fit = direct_ellipse(points[np.isfinite(points).all(axis=1)])
        if not isinstance(fit, FailedFit):
            out.append(fit)
    return out


def clutter_ellipses(frame: Frame) -> list[Array]:
    """Discs of the wall's clutter: also circles, but without rows in the truth."""
    clutter = frame.sheet.clutter
    if clutter is None:
        return []
    corners = np.array([[x, y, 1.0] for x in (0, frame.camera.width_px) for y in (0, frame.camera.height_px)])
    rays = np.linalg.solve(frame.camera.K, corners.T).T
    pose = frame.camera_from_sheet
    normal = pose[:3, 2]
    depth = (normal @ pose[:3, 3]) / (rays @ normal)
    plane = (rays * depth[:, None] - pose[:3, 3]) @ pose[:3, :2]
    if np.any(depth <= 0):
        plane = np.array([[-30.0, -30.0], [30.0, 30.0]]) * clutter.cell_m
    low = np.maximum(np.floor(plane.min(axis=0) / clutter.cell_m), -60).astype(np.int64)
    high = np.minimum(np.ceil(plane.max(axis=0) / clutter.cell_m), 60).astype(np.int64)
    out = []
    for column in range(low[0], high[0]):
        for row in range(low[1], high[1]):
            cell = [np.asarray(v & 0xFFFFFFFF, dtype=np.uint32) for v in (column, row)]
            keys = [
                np.asarray((frame.sheet.seed + k) & 0xFFFFFFFF, dtype=np.uint32) for k in (CLUTTER_SHAPE, CLUTTER_PLACE)
            ]
            kind, size, _ = pcg3d(cell[0], cell[1], keys[0])
            if int(kind) >> 31:
                continue
            half = CLUTTER_LEAST + CLUTTER_MORE * float(unit(size))
            px, py, _ = pcg3d(cell[0], cell[1], keys[1])
            at = [i + half + (1 - 2 * half) * float(unit(h)) for i, h in ((column, px), (row, py))]
            disc = pose.copy()
            disc[:3, 3] = pose[:3, :3] @ np.array([at[0], at[1], 0.0]) * 1.0 * clutter.cell_m + pose[:3, 3]
            try:
                out.append(ellipse_of_conic(conic_of_circle(disc, half * clutter.cell_m, frame.camera.K)))
            except ValueError:  # it extends behind the camera
                continue
    return out


def judge(detections: list[Detection], truth: list[Array], others: list[Array]) -> tuple[list[float], list[float]]:
    """Confidence of each true marker (-1: not detected), and of each false positive."""
    left = list(range(len(detections)))
    found = []
    for ellipse in truth:
        hits = [i for i in left if same(detections[i].edges.ellipse, ellipse)]
        best = min(hits, key=lambda i: float(np.abs(detections[i].edges.ellipse - ellipse)[:4].sum()), default=None)
        found.append(-1.0 if best is None else detections[best].confidence)
        left = [i for i in left if i != best]
    false = [detections[i].confidence for i in left if not any(same(detections[i].edges.ellipse, e) for e in others)]
    return found, false


def outcomes(dataset: Dataset) -> list[Outcome]:
    """Detect in every frame of a dataset."""
    rows: dict[int, list[dict[str, Any]]] = {}
    for row in dataset.truth.to_pylist():
        rows.setdefault(int(row["frame_id"]), []).append(row)
    placed = {frame.frame_id: frame for frame in frames_of(load_study(dataset.path / STUDY))}
    out = []
    for i, frame_id in enumerate(dataset.images.frame_ids):
        frame = placed[frame_id]
        levels, saturation_dn = dataset.images.linear_image(i)
        grey, full_scale_dn = grey_levels(levels)
        detections = detect(grey, saturation_dn or full_scale_dn)
        found, false = judge(detections, true_ellipses(rows[frame_id]), clutter_ellipses(frame))
        visible = float(np.mean([row["visible_fraction"] for row in rows[frame_id]]))
        confidence = tuple(c for c in found if c >= 0)
        out.append(
            Outcome(frame_id, frame.group, frame.level, visible, tuple(c >= 0 for c in found), confidence, tuple(false))
        )
    return out


def level_of_recall(levels: list[float], recalls: list[float], wanted: float = WANTED_RECALL) -> float | None:
    """Level at which recall first falls to `wanted`, linearly interpolated; None if it never does."""
    for i, recall in enumerate(recalls):
        if recall <= wanted:
            if i == 0 or recalls[i - 1] == recall:
                return levels[i]
            part = (recalls[i - 1] - wanted) / (recalls[i - 1] - recall)
            return levels[i - 1] + part * (levels[i] - levels[i - 1])
    return None


def table_of(name: str, key: str, found: list[Outcome]) -> tuple[str, dict[str, Any]]:
    """One study as text and as numbers: one line per level (per group without a sweep)."""
    swept = any(o.level is not None for o in found)
    cells: dict[Any, list[Outcome]] = {}
    for outcome in found:
        cells.setdefault(outcome.level if swept else outcome.group, []).append(outcome)
    lines = [
        f"{name} ({key})",
        "    level          visible  recall (95 %)              false/frame  confident  missed frames",
    ]
    rows = []
    for level, frames in cells.items():
        hits = [hit for o in frames for hit in o.found]
        interval = wilson_interval(sum(hits), len(hits))
        false = sum(len(o.false) for o in frames) / len(frames)
        confident = sum(c >= CONFIDENT for o in frames for c in o.false) / len(frames)
        own = [c for o in frames for c in o.confidence]
        missed = [o.frame_id for o in frames if not all(o.found)]
        visible = float(np.mean([o.visible for o in frames]))
        low, high = interval.low, interval.high
        label = f"{level:g}" if swept else str(level)
        lines.append(
            f"    {label:14s} {visible:7.2f}  {sum(hits):3d}/{len(hits):3d} {np.mean(hits):.3f}"
            f" ({low:.3f} to {high:.3f})  {false:11.3f}  {confident:9.3f}  {' '.join(map(str, missed[:12]))}"
        )
        rows.append(
            {
                "level": level, "visible": visible, "found": sum(hits), "of": len(hits), "low": low, "high": high,
                "false_per_frame": false, "confident_false_per_frame": confident,
                "confidence": float(np.median(own)) if own else None,
            }
        )  # fmt: skip
    told: dict[str, Any] = {"study": name, "key": key, "levels": rows}
    if swept:
        at = level_of_recall([float(v) for v in cells], [row["found"] / row["of"] for row in rows])
        told["recall_90_at"] = at
        lines.append(f"    recall falls to 90 % at {at:g}" if at is not None else "    above 90 % at every level")
    return "\n".join(lines), told


def dataset_of(name: str, work: Path, beyond: bool) -> Dataset:
    """The dataset of a shipped study, or of its harder levels, in the work folder; rendered if it is missing."""
    path = work / (f"{name}_beyond" if beyond else name)
    if not (path / MANIFEST).is_file():
        from roundel.render.run import render_study

        study = CONFIGS / f"{name}.yaml"
        if beyond:
            raw = yaml.safe_load(study.read_text(encoding="utf-8"))
            raw["sweep"]["levels"], others = BEYOND[name]
            for key, value in others.items():
                section, leaf = key.split(".")
                raw[section][leaf] = value
            study = work / f"{name}_beyond.yaml"
            work.mkdir(parents=True, exist_ok=True)
            study.write_text(yaml.safe_dump(raw, sort_keys=False), encoding="utf-8")
        print(f"rendering {path.name}", file=sys.stderr, flush=True)
        render_study(study, path, threads=THREADS)
    return open_dataset(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("work", nargs="?", type=Path, default=Path("out/bench-detection"))
    parser.add_argument("--studies", default=",".join(NUISANCES))
    parser.add_argument("--beyond", action="store_true", help="also run harder levels")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    told = []
    for name in arguments.studies.split(","):
        dataset = dataset_of(name, arguments.work, beyond=False)
        sweeps = [group.get("sweep") for group in dataset.study["groups"].values()]
        key = str(sweeps[0]["key"]) if sweeps and sweeps[0] else "no nuisance"
        found = outcomes(dataset)
        if arguments.beyond and name in BEYOND:
            found += outcomes(dataset_of(name, arguments.work, beyond=True))
        text, numbers = table_of(name, key, found)
        print(text, flush=True)
        told.append(numbers)
    if arguments.json:
        arguments.json.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
