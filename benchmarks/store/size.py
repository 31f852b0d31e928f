"""Peak memory, and time a frame, of render, solve, validate and verify over the number of frames.

python benchmarks/store/size.py FOLDER [--frames 1000 10000 100000] [--images] [--jobs N]

Frames of points, or with --images tiny images. Datasets are kept in FOLDER, so that an interrupted run goes on; what
was there already is not timed. The time a frame is also given between one number of frames and the next, which leaves
out what a command does once. Exits with status 1 if a command needs more than 1.5 GB.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

STUDY = """\
schema: 1
name: size
seed: 5
frames: {frames}
mode: {mode}
camera: {{width_px: {width}, height_px: {height}, focal_px: {width}}}
marker: {{kind: disc, diameter_m: 0.08}}
pose:
  distance_D: {{uniform: [4, 5]}}
  tilt_deg: {{uniform: [10, 50]}}
  azimuth_deg: {{uniform: [-180, 180]}}
light: {{environment: 0.7}}
render: {{band_samples: 16}}
{points}"""
MOST_MB = 1500.0


def run(folder: Path, words: list[str]) -> tuple[float, float]:
    """Seconds and peak memory in MB of a command."""
    command = [sys.executable, "-m", "roundel.cli.main", *words]
    began = time.perf_counter()
    pid = os.posix_spawn(sys.executable, command, os.environ, file_actions=[
        (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0),
        (os.POSIX_SPAWN_OPEN, 2, str(folder / "stderr"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644),
    ])  # fmt: skip
    _, status, usage = os.wait4(pid, 0)
    if status:
        raise SystemExit(f"{' '.join(words)}: {(folder / 'stderr').read_text()[-500:]}")
    return time.perf_counter() - began, usage.ru_maxrss / 1024


def main() -> int:
    """Measure and print a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, nargs="+", default=[1000, 10_000, 100_000])
    parser.add_argument("--images", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    kind = "images" if asked.images else "points"
    size = (64, 48) if asked.images else (640, 480)
    print(f"load of the machine before: {os.getloadavg()[0]:.2f}; {os.cpu_count()} cores; {kind}, --jobs {asked.jobs}")
    print("| frames | command | peak memory, MB | s | ms a frame | between, ms a frame |")
    print("|---:|---|---:|---:|---:|---:|")
    before: dict[str, tuple[int, float]] = {}
    worst = 0.0
    for frames in asked.frames:
        here = asked.folder / f"{kind}-{frames}"
        here.mkdir(exist_ok=True)
        study, ds, estimates = here / "study.yaml", here / "ds", here / "estimates"
        points = "" if asked.images else "points: {count: 100, sigma_px: 0.1}\n"
        study.write_text(STUDY.format(frames=frames, mode=kind, width=size[0], height=size[1], points=points))
        jobs = ["--jobs", str(asked.jobs)]
        for name, words in {
            "render": ["render", str(study), str(ds), *jobs],
            "solve": ["solve", str(ds), str(estimates), *jobs],
            "validate": ["validate", str(ds), str(estimates), "--out", str(here / "report"), *jobs],
            "verify": ["verify", "--full", str(ds)],
        }.items():
            done = {"render": ds / "manifest.json", "solve": estimates / "estimates.parquet"}.get(name)
            new = done is None or not done.exists()
            seconds, peak = run(asked.folder, words)
            worst = max(worst, peak)
            first, earlier = before.get(name, (0, 0.0))
            each = f"{1000 * seconds / frames:.2f}" if new else "-"
            between = f"{1000 * (seconds - earlier) / (frames - first):.2f}" if new and first else "-"
            shown = f"{seconds:.1f}" if new else "(was there)"
            print(f"| {frames:,} | {name} | {peak:.0f} | {shown} | {each} | {between} |", flush=True)
            before[name] = frames, seconds
    return int(worst > MOST_MB)


if __name__ == "__main__":
    sys.exit(main())
