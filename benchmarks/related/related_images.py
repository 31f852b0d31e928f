"""Rendered markers for `related_systems.py`: recall of each system at four sizes, and its focal length.

Each dataset is one marker at one size; the poses are the same for all, but for the distance. The solver has the true
camera; the focal length that a system measures does not depend on it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import yaml

from roundel.datasets.layout.files import MANIFEST
from roundel.solver.estimates import ESTIMATES
from roundel.solver.methods.solve import solve_dataset

FOCAL_PX = 640
SIZES_PX = (60, 40, 20, 10)  # semi-axis of the largest circle of the print, when it faces the camera
MARKERS = {
    "disc": ({"kind": "disc", "diameter_m": 0.08}, 0.04, ("wu2004", "szpak2015")),
    "two_discs": (
        {"kind": "two_discs", "diameter_m": 0.04, "second_diameter_m": 0.04, "spacing_m": 0.06},
        0.02,
        ("wu2004", "chen2004", "gurdjos2006"),
    ),
    "ring": ({"kind": "ring", "diameter_m": 0.08, "inner_diameter_m": 0.04}, 0.04, ("kim2005", "huang2015")),
    "dot_ring": (
        {"kind": "dot_ring", "diameter_m": 0.02, "ring_diameter_m": 0.08, "dots": 6},
        0.01,
        ("chen2004", "gurdjos2006", "pollefeys1999"),
    ),
}
STUDY = """\
schema: 1
name: related_{name}_{size}
seed: 15
camera: {{width_px: 640, height_px: 480, focal_px: {focal}}}
pose:
  distance_m: {distance}
  tilt_deg: {{uniform: [15, 55]}}
  azimuth_deg: {{uniform: [-180, 180]}}
  roll_deg: {{uniform: [-180, 180]}}
  offset_x_px: {{uniform: [-60, 60]}}
  offset_y_px: {{uniform: [-40, 40]}}
sensor: {{full_well_e: 10000, read_noise_e: 5}}
render: {{target_error: 0.01, radiance: false}}
frames: {frames}
"""


def image_tables(folder: Path, frames: int, sizes: Sequence[int] = SIZES_PX) -> str:
    """Render what is missing, solve, and give the table and its notes in Markdown."""
    rows = []
    for name, (marker, radius_m, methods) in MARKERS.items():
        for size in sizes:
            if name == "dot_ring" and size > 20:
                continue  # the ring would not fit into the image
            path = _rendered(folder, name, marker, size, radius_m, frames)
            out = folder / f"{path.name}-estimates"
            solve_dataset(path, out, methods=methods)
            rows += [_row(path, out, name, method, size) for method in methods]
            for row in rows[-len(methods) :]:
                print(*row, sep=" | ", file=sys.stderr, flush=True)
    header = [
        "print",
        "semi-axis, px",
        "system",
        "frames",
        "circles found, %",
        "frames without an answer",
        "focal length stated, %",
    ]
    header += [
        "median error, % (95 % interval)",
        "median sigma, %",
        "in 95 % interval, %",
        "f 13 % too short: fused, %",
    ]
    return f"""Frames of 640x480 px, f = {FOCAL_PX} px, tilts of 15 to 55 degrees.
*Circles found*: printed circles with a pose. *Median error*: of the focal length measured from the image alone
(huang2015 and pollefeys1999: from sets of six). The interval of the median is that of its order statistics. Last
column: median error after fusion with a prior of 11.5 % that is 13 % too short.

{markdown_table(header, rows)}"""


def _rendered(folder: Path, name: str, marker: dict[str, object], size: int, radius_m: float, frames: int) -> Path:
    path = folder / f"{name}-{size}"
    if not (path / MANIFEST).is_file():
        from roundel.render.run import render_study

        study = folder / f"{name}-{size}.yaml"
        folder.mkdir(parents=True, exist_ok=True)
        text = STUDY.format(name=name, size=size, focal=FOCAL_PX, distance=FOCAL_PX * radius_m / size, frames=frames)
        study.write_text(text + yaml.safe_dump({"marker": marker}), encoding="utf-8")
        render_study(study, path)
    return path


def _row(path: Path, out: Path, name: str, method: str, size: int) -> list[str]:
    from roundel.scenes.camera.focal_fusion import fused_focal_px

    markers = pq.read_table(path / "truth.parquet", columns=["frame_id"]).num_rows
    table = [row for row in pq.read_table(out / ESTIMATES).to_pylist() if row["method"] == method]
    solved = [row for row in table if row["status"] == "ok" and row["normal_x"] is not None]
    posed = {(row["frame_id"], row["detection_id"]) for row in solved}
    failed = {row["frame_id"] for row in table} - {frame for frame, _ in posed}
    focal = {row["frame_id"]: (row["focal_px"], row["focal_sigma_px"]) for row in table if row["focal_px"] is not None}
    frames = len({row["frame_id"] for row in table})
    cells = [name, str(size), method, str(frames), f"{100 * len(posed) / markers:.1f}", str(len(failed))]
    if not focal:
        return [*cells, *(("0", "-", "-", "-", "-") if method not in ("wu2004", "szpak2015") else ("", "", "", "", ""))]
    errors = np.array([np.log(f / FOCAL_PX) for f, _ in focal.values()])
    sigmas = np.array([s / f for f, s in focal.values()])
    fused = [abs(np.log(fused_focal_px(0.87 * FOCAL_PX, 0.115, f, s)[0] / FOCAL_PX)) for f, s in focal.values()]
    fused += [abs(np.log(0.87))] * (frames - len(focal))
    low, high = _median_interval(np.abs(errors))
    return [
        *cells,
        f"{100 * len(focal) / frames:.0f}",
        f"{100 * np.median(np.abs(errors)):.2f} ({100 * low:.2f} to {100 * high:.2f})",
        f"{100 * np.median(sigmas):.2f}",
        f"{100 * np.mean(np.abs(errors) < 1.96 * sigmas):.0f}",
        f"{100 * np.median(fused):.2f}",
    ]


def _median_interval(values: np.ndarray) -> tuple[float, float]:
    """95 % interval of a median by order statistics (binomial)."""
    from scipy.stats import binom

    ordered, n = np.sort(values), len(values)
    k = int(binom.ppf(0.025, n, 0.5))
    return float(ordered[max(k - 1, 0)]), float(ordered[min(n - k, n - 1)])


def markdown_table(header: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown, its columns aligned."""
    lines = [header, *rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    text = [" | ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)) for line in lines]
    text.insert(1, " | ".join("-" * w for w in widths))
    return "\n".join(f"| {line} |" for line in text)
