"""Frames where light is hard: a tabletop, gloss, a hard shadow; processor seconds, and memory over a long run.

    python benchmarks/render/worlds.py [--quick] [--frames N] [--memory N] [--json FILE]

The frames are those of worlds.yaml, 1280x720 with default settings; the radiance alone is timed, in one process. The
first frame of each kind loads or compiles its kernels and is listed apart. `--memory` renders tabletop frames of
640x360, 320 for the published figure, and compares resident memory after 20 of them with that at the end. Exits with
status 1 if a limit is exceeded.
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from memory import resident_mb
from stopwatch import RayCounter

from roundel.render.backend import start, variant_of
from roundel.render.radiance import render_radiance
from roundel.scenes.study.study import Study, load_study
from roundel.scenes.world.frame import Frame, frame_of, group_ranges

STUDY = Path(__file__).resolve().parent / "worlds.yaml"
KINDS = ("plain", "plastic", "laminate", "shadow", "tabletop")
WARM = 20

# Most processor seconds of a tabletop frame, times of a plain frame, and MB of growth.
MOST_S, MOST_RATIO, MOST_MB = 8.0, 6.0, 100.0


def rendered(frame: Frame) -> float:
    """Processor seconds of all threads for one frame's radiance."""
    began = time.process_time()
    render_radiance(start(variant_of(frame)), frame)
    return time.process_time() - began


def times(study: Study, frames: int) -> dict[str, Any]:
    """For each kind: seconds of the first frame, of the warm ones, and the rays of each."""
    rays = RayCounter()
    found: dict[str, Any] = {}
    for kind in KINDS:
        ids = group_ranges(study)[kind]
        first = rendered(frame_of(study, ids[frames]))
        seconds, counts = [], []
        for index in ids[:frames]:
            before = rays.rays
            seconds.append(rendered(frame_of(study, index)))
            counts.append(rays.rays - before)
        found[kind] = {"first_s": first, "cpu_s": seconds, "rays": counts}
    return found


def growth(study: Study, frames: int) -> dict[str, Any]:
    """Resident memory over tabletop frames of 640x360 in one process."""
    warm = 0.0
    ids = group_ranges(study)["small"]
    for done, index in enumerate(ids[:frames], start=1):
        rendered(frame_of(study, index))
        if done in (WARM, frames):
            gc.collect()
            warm, last = (resident_mb(), 0.0) if done == WARM else (warm, resident_mb())
        if sys.stderr.isatty():
            print(f"\r{done}/{frames} {resident_mb():.0f} MB", end="", file=sys.stderr)
    return {"frames": frames, "warm_mb": warm, "last_mb": last, "growth_mb": last - warm}


def lines(result: dict[str, Any]) -> list[str]:
    kinds = result["kinds"]
    plain = float(np.median(kinds["plain"]["cpu_s"])) if kinds else 1.0
    out = ["| frame | CPU s, median (max) | x plain | rays | CPU s of the first |", "|---|---:|---:|---:|---:|"]
    for kind, found in kinds.items():
        median = float(np.median(found["cpu_s"]))
        out.append(
            f"| {kind} | {median:.2f} ({max(found['cpu_s']):.2f}) | {median / plain:.1f} | "
            f"{np.median(found['rays']) / 1e6:.1f} M | {found['first_s']:.1f} |"
        )
    if "memory" in result:
        m = result["memory"]
        out += [
            "",
            f"{m['frames']} tabletop frames of 640x360 in one process: resident memory {m['warm_mb']:.0f} MB after "
            f"{WARM}, {m['last_mb']:.0f} MB after the last ({m['growth_mb']:+.1f} MB; at most {MOST_MB:.0f}).",
        ]
    return out


def too_much(result: dict[str, Any]) -> bool:
    kinds = result["kinds"]
    median = {kind: float(np.median(found["cpu_s"])) for kind, found in kinds.items()}
    return (
        median.get("tabletop", 0.0) > MOST_S
        or any(median[kind] > MOST_RATIO * median["plain"] for kind in median if kind != "tabletop")
        or result.get("memory", {}).get("growth_mb", 0.0) > MOST_MB
    )


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="one frame of each kind")
    parser.add_argument("--frames", type=int, default=6, help="of each kind; 0: only the memory")
    parser.add_argument("--memory", type=int, default=0, metavar="N", help="render N tabletop frames, too")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    study = load_study(STUDY)
    frames = 1 if asked.quick else asked.frames
    found: dict[str, Any] = {"kinds": times(study, frames) if frames else {}}
    if asked.memory > WARM:
        found["memory"] = growth(study, asked.memory)
    print("\n".join(lines(found)))
    if asked.json:
        asked.json.write_text(json.dumps(found))
    return int(too_much(found))


if __name__ == "__main__":
    sys.exit(main())
