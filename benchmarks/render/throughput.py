"""Frames and rays per second of the whole `roundel render`, including its start and the last step of the dataset.

python benchmarks/render/throughput.py [--quick] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
STUDIES = {"demo": HERE.parents[1] / "configs" / "demo.yaml", "bench": HERE / "bench.yaml"}


def run(name: str, frames: int | None) -> dict[str, Any]:
    """Render a study through the command's entry point, in this process."""
    from stopwatch import RayCounter

    from roundel.cli.main import main
    from roundel.scenes.study.study import load_study
    from roundel.scenes.world.frame import total_frames

    count = min(frames or 10**9, total_frames(load_study(STUDIES[name])))
    rays = RayCounter()
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        code = main(["render", str(STUDIES[name]), str(Path(folder) / "dataset"), "--frames", f"0:{count}"])
        seconds = time.perf_counter() - began
    if code:
        raise SystemExit(f"roundel render exited with status {code}")
    return {
        "study": name,
        "frames": count,
        "seconds": seconds,
        "frames_per_s": count / seconds,
        "rays_per_s": rays.rays / seconds,
        "rays_per_frame": rays.rays / count,
    }


def lines(results: list[dict[str, Any]]) -> list[str]:
    out = ["| study | frames | seconds | frames/s | rays per frame | rays/s |", "|---|---:|---:|---:|---:|---:|"]
    for r in results:
        out.append(
            f"| {r['study']} | {r['frames']} | {r['seconds']:.1f} | {r['frames_per_s']:.2f} | "
            f"{r['rays_per_frame'] / 1e6:.2f} M | {r['rays_per_s'] / 1e6:.1f} M |"
        )
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--study", choices=sorted(STUDIES), default=None)
    arguments = parser.parse_args()
    names = [arguments.study] if arguments.study else list(STUDIES)
    found = [run(name, 2 if arguments.quick else None) for name in names]
    print("\n".join(lines(found)))
    if arguments.json:
        arguments.json.write_text(json.dumps(found))
