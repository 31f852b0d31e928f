"""Compare Roundel with its peers: one command, one table.

    python benchmarks/render/run.py [--quick] [--no-peers] [--frames N]

Writes results.md and results.json beside this file. Every renderer runs in its own process, one after another, on two
threads. Cycles needs `bpy`: run `make bench-env`, or set ROUNDEL_BENCH_PYTHON to an interpreter that has it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import table
from peers import cycles_rows, find_bpy, mitsuba_rows, row, work
from reference import STUDY, bench_frame, measure

HERE = Path(__file__).resolve().parent
THREADS = 2


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def our_rows(frames: int, general: int, folder: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Roundel's rows: the labelled frame on disk, the same without its EXR, radiance alone; and through Mitsuba."""
    load = os.getloadavg()[0]
    out = folder / "ours"
    out.mkdir()
    job = {"study": str(STUDY), "frames": frames, "general": general, "threads": THREADS, "out": str(out)}
    told = work(sys.executable, "ours.py", job, folder)
    frame = bench_frame()
    measured = measure(frame, *(np.load(out / f"seed_{s}.npy").astype(float) for s in (1, 2)))
    names = {
        "labelled": "**Roundel, labelled frame on disk**",
        "no_exr": "Roundel, labelled, without EXR",
        "radiance": "Roundel, radiance alone",
    }
    rays = float(np.median(told["rays"]))
    rows = [row(names[k], {"rays": rays}, measured, told["seconds"][k], load) for k in names]
    if general:
        other = measure(frame, *(np.load(out / f"general_{s}.npy").astype(float) for s in (1, 2)))
        name = "Roundel, radiance, light through Mitsuba's integrator"
        rows.append(row(name, {"rays": told["rays_general"]}, other, told["seconds"]["general"], load))
    return rows, {"starting_s": told["starting_s"], "first_frame_s": told["first_frame_s"], "rays": rays}


def side_run(script: str, *arguments: str, folder: Path) -> Any:
    """Run another benchmark in its own process."""
    told = folder / f"{Path(script).stem}.json"
    done = subprocess.run(
        [sys.executable, str(HERE / script), *arguments, "--json", str(told)],
        stdout=subprocess.DEVNULL,
        check=False,
    )
    if not told.is_file():
        raise SystemExit(f"{script} exited with status {done.returncode}")
    return json.loads(told.read_text(encoding="utf-8"))


def main() -> int:
    parser = argparse.ArgumentParser(description="Compare Roundel with its peers.")
    parser.add_argument("--quick", action="store_true", help="smoke run: its figures are meaningless; writes no files")
    parser.add_argument("--no-peers", action="store_true", help="skip Cycles and mi.render")
    parser.add_argument(
        "--cycles-default", action="store_true", help="also run Cycles with its own minimum number of samples (minutes)"
    )
    parser.add_argument("--no-memory", action="store_true", help="skip the thousand frames")
    parser.add_argument("--frames", type=int, default=8, help="number of Roundel's frames to time")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md and results.json")
    asked = parser.parse_args()
    frames = 2 if asked.quick else max(5, asked.frames)
    results: dict[str, Any] = {"machine": table.machine(), "threads": THREADS, "load_before": os.getloadavg()}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        say("Roundel ...")
        results["rows"], results["ours"] = our_rows(frames, 0 if asked.quick else 5, folder)
        if not asked.no_peers:
            frame = bench_frame()
            say("mi.render ...")
            rows, results["machine"]["mitsuba"] = mitsuba_rows(frame, folder, THREADS, asked.quick)
            results["rows"] += rows
            python = find_bpy()
            if python is None:
                results["no_cycles"] = (
                    "Cycles: not measured. It needs bpy on Python 3.11: `make bench-env` installs it, or name an "
                    "interpreter that has it in ROUNDEL_BENCH_PYTHON."
                )
                say(results["no_cycles"])
            else:
                say("Cycles ...")
                rows, results["machine"]["cycles (bpy)"] = cycles_rows(
                    python, frame, folder, THREADS, asked.quick, asked.cycles_default
                )
                results["rows"] += rows
        say("stages ...")
        results["stages"] = side_run("stages.py", str(frames), folder=folder)
        say("throughput ...")
        quick = ["--quick"] if asked.quick else []
        results["throughput"] = side_run("throughput.py", *quick, folder=folder)
        if not asked.no_memory:
            say("memory ...")
            results["memory"] = side_run("memory.py", *quick, folder=folder)
    text = table.report(results)
    print(text)
    if not asked.quick:
        (asked.out / "results.md").write_text(text + "\n", encoding="utf-8")
        (asked.out / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
