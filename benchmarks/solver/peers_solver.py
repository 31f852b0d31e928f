"""Compare Roundel's solver with its peers: closed forms, accuracy on rendered frames, time per image. Prints Markdown.

    python benchmarks/solver/peers_solver.py [--quick] [--data FOLDER] [--out FILE]

Run `make peers-env` first (simittag and pycalib; without them their rows are left out). Missing frames are rendered
first, into out/bench-peers: about five minutes on two cores.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import closed_forms
import cv2
import numpy as np
import peer_ellipses
from peer_ellipses import Error

from roundel.datasets.dataset import open_dataset
from roundel.solver.methods.locate import locate

HERE = Path(__file__).resolve().parent
HOUSE = HERE.parents[1]

# A dataset, its study, the truth column with its levels, and the title of that column.
DATASETS = [
    ("paper_synthetic", HOUSE / "configs" / "paper_synthetic.yaml", "distance_D", "distance, D"),
    ("peers_blur", HERE / "peers_blur.yaml", "edge_blur_px", "blur of the edge (its pixel included), px"),
    ("peers_noise", HERE / "peers_noise.yaml", "edge_noise_dn", "noise beside the edge, DN"),
]


def rendered(data: Path, name: str, study: Path) -> Path:
    """The dataset, rendered if it is missing."""
    folder = data / name
    if not (folder / "manifest.json").is_file():
        print(f"rendering {name} ...", file=sys.stderr, flush=True)
        command = [str(Path(sys.executable).parent / "roundel"), "render", str(study), str(folder)]
        subprocess.run(command, check=True)
    return folder


def accuracy(folder: Path, key: str, called: str, programs: list[peer_ellipses.Program]) -> list[str]:
    """Markdown: median and 95th percentile of each program's errors, level by level."""
    found = peer_ellipses.errors(folder, key, programs)
    out = [
        f"| {called} | program | frames | missed | normal, deg: median | 95 % | "
        "position, % of distance: median | 95 % | ellipse's centre, px: median | axis, px: median |",
        "|---:|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    levels = dict.fromkeys(e.level for errors in found.values() for e in errors)
    for level in levels:
        for name, errors in found.items():
            out.append(f"| {level} | {name} | {_figures([e for e in errors if e.level == level])} |")
    if len(levels) > 1:
        out += [f"| all | {name} | {_figures(errors)} |" for name, errors in found.items()]
    return out


def _figures(errors: list[Error]) -> str:
    table = np.array([(e.normal_deg, e.position_pct, e.centre_px, e.axis_px) for e in errors])
    seen = table[np.isfinite(table[:, 0])]
    head = f"{len(table)} | {len(table) - len(seen)} | "
    if not len(seen):
        return head + " | ".join("-" * 6)
    median, high = np.median(seen, axis=0), np.percentile(seen, 95, axis=0)
    figures = (median[0], high[0], median[1], high[1], median[2], median[3])
    return head + " | ".join(f"{v:.3f}" for v in figures)


def image_times(folder: Path, repeats: int) -> list[str]:
    """Markdown: milliseconds per whole image with one marker, minimum of interleaved repeats."""
    data = open_dataset(folder)
    row = min(data.truth.to_pylist(), key=lambda r: abs(r["distance_D"] - 15) + abs(r["tilt_deg"] - 30))
    i = data.images.frame_ids.index(row["frame_id"])
    image, camera = data.images.image(i), data.images.camera(i)
    drawing = cv2.ximgproc.createEdgeDrawing()

    def edges() -> None:
        drawing.detectEdges(image)

    def ellipses() -> None:
        drawing.detectEdges(image)
        drawing.detectEllipses()

    calls: dict[str, Callable[[], Any]] = {
        "EdgeDrawing, edges and ellipses (`detectEdges`, `detectEllipses`)": ellipses,
        "EdgeDrawing, edges": edges,
        "`cv2.fitEllipse`, Otsu's contour": lambda: peer_ellipses.otsu(image, camera.K),
        "**Roundel**, `locate`, `ml`": lambda: locate(image, 2 * row["radius_m"], camera, method="ml"),
        "**Roundel**, `locate`, `pixels`": lambda: locate(image, 2 * row["radius_m"], camera, method="pixels"),
    }
    if "simittag" in sys.modules:
        calls["simittag, its ellipses (no code read)"] = lambda: peer_ellipses.simittag_ellipses(image, camera.K)
    best = dict.fromkeys(calls, np.inf)
    for _ in range(repeats):
        for name, call in calls.items():
            began = time.process_time()  # one thread each: processor time, independent of other processes
            call()
            best[name] = min(best[name], time.process_time() - began)
    alone = next(iter(best.values()))
    height, width = image.shape[:2]
    return [
        f"| an image of {width}x{height} px with one marker, one core | ms | EdgeDrawing's |",
        "|---|---:|---:|",
        *(f"| {name} | {1e3 * seconds:.1f} | {seconds / alone:.2f} |" for name, seconds in best.items()),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description="Compare Roundel's solver with its peers.")
    parser.add_argument("--quick", action="store_true", help="smoke run: few poses and repeats, small frames only")
    parser.add_argument("--data", type=Path, default=HOUSE / "out" / "bench-peers", help="folder of the frames")
    parser.add_argument("--out", type=Path, help="also write the tables here")
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    peers = closed_forms.find_peers()
    names = list(peers)
    lines: list[str] = []

    def say(title: str, table: list[str]) -> None:
        text = [f"## {title}", "", *table, ""]
        lines.extend(text)
        print("\n".join(text), flush=True)

    versions = {"numpy": np.__version__, "OpenCV": cv2.__version__, **peers}
    missing = sorted(set(closed_forms.PACKAGES) - set(peers))
    told = [", ".join(f"{name} {version}" for name, version in versions.items()) + "."]
    if missing:
        told.append(f"Without {' and '.join(missing)}: `make peers-env` installs them.")
    say("What was run", told)
    say("Closed forms: the same poses", closed_forms.equality(names, 100 if asked.quick else 4000))
    say("Closed forms: very small ellipses", closed_forms.small_circles(names, 10 if asked.quick else 200))
    say("Closed forms: time of a pose, one core", closed_forms.speed(names, 2 if asked.quick else 30))
    programs = peer_ellipses.programs(peers)
    for name, study, key, called in DATASETS[1:] if asked.quick else DATASETS:
        say(f"Accuracy: {name}", accuracy(rendered(asked.data, name, study), key, called, programs))
    if not asked.quick:
        name, study, *_ = DATASETS[0]
        say("Time of a whole image", image_times(rendered(asked.data, name, study), 15))
    if asked.out:
        asked.out.write_text("\n".join(lines), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
