"""Processor time of detection and of `locate` as ratios to OpenCV's EdgeDrawing in the same run.

    python benchmarks/solver/detection_time.py [WORK]

WORK (default out/bench-detection-time) holds the frames of detection_time.yaml, rendered if they are missing (some
minutes): one marker at 1280x720, and 21 circles among the things on a table at 12 megapixels. Exits with status 1 if
`locate` takes more than twice EdgeDrawing's time on the first, or more than 1 s on the second. The processor time
includes all threads, as for a user who sets no variable; each figure is the minimum of interleaved repeats.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.layout.files import MANIFEST
from roundel.solver.detect.detect import detect
from roundel.solver.methods.locate import locate

STUDY = Path(__file__).resolve().parent / "detection_time.yaml"
MOST_RATIO, MOST_S = 2.0, 1.0


def least_times(calls: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Least processor time of each call, s."""
    best = dict.fromkeys(calls, float("inf"))
    for call in calls.values():  # loads the compiled kernels
        call()
    for _ in range(repeats):
        for name, call in calls.items():
            began = time.process_time()
            call()
            best[name] = min(best[name], time.process_time() - began)
    return best


def times_of(dataset: Dataset, group: str, repeats: int) -> tuple[dict[str, float], int, int]:
    """Times of one frame, the circles found with confidence in it, and those that are there."""
    rows = [row for row in dataset.truth.to_pylist() if row["group"] == group]
    i = dataset.images.frame_ids.index(rows[0]["frame_id"])
    image, camera = dataset.images.image(i), dataset.images.camera(i)
    diameter_m = 2 * rows[0]["radius_m"]

    def edgedrawing() -> None:
        drawing = cv2.ximgproc.createEdgeDrawing()
        drawing.detectEdges(image)
        drawing.detectEllipses()

    found = locate(image, diameter_m, camera)
    calls: dict[str, Callable[[], Any]] = {
        "EdgeDrawing": edgedrawing,
        "detect": lambda: detect(image),
        "locate": lambda: locate(image, diameter_m, camera),
    }
    return least_times(calls, repeats), sum((e.confidence or 0.0) > 0.5 for e in found), len(rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("work", nargs="?", type=Path, default=Path("out/bench-detection-time"))
    work = parser.parse_args().work
    if not (work / MANIFEST).is_file():
        from roundel.render.run import render_study

        print("rendering detection_time", file=sys.stderr, flush=True)
        render_study(STUDY, work)
    dataset = open_dataset(work)
    failed = False
    for group, repeats in (("one", 15), ("twelve_megapixels", 5)):
        times, found, there = times_of(dataset, group, repeats)
        own = times["EdgeDrawing"]
        figures = ", ".join(f"{name} {1e3 * s:.1f} ms = {s / own:.2f} x" for name, s in times.items())
        print(f"{group}: {found} of {there} circles; {figures}", flush=True)
        failed |= times["locate"] > (MOST_RATIO * own if group == "one" else MOST_S)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
