"""Memory growth and slowdown over a thousand frames in one process.

    python benchmarks/render/memory.py [--quick] [--json FILE]

Compares resident memory after 50 frames with that at the end (at most 50 MB more), and the time of the first hundred
frames after that with the last hundred.
"""

from __future__ import annotations

import argparse
import gc
import json
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

STUDY = Path(__file__).resolve().parent / "memory.yaml"
WARM, MOST_MB = 50, 50.0


def resident_mb() -> float:
    """Current resident memory of this process; its maximum so far if there is no /proc."""
    statm = Path("/proc/self/statm")
    if statm.is_file():
        return int(statm.read_text().split()[1]) * resource.getpagesize() / 2**20
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def run(frames: int) -> dict[str, Any]:
    from roundel.render.run import render_study

    ticks: list[tuple[float, float]] = []
    warm = last = 0.0

    def progress(done: int, total: int) -> None:
        nonlocal warm, last
        ticks.append((time.perf_counter(), time.process_time()))
        if done in (WARM, total):
            gc.collect()
            warm, last = (resident_mb(), last) if done == WARM else (warm, resident_mb())
        if sys.stderr.isatty():
            print(f"\r{done}/{total} {resident_mb():.0f} MB", end="", file=sys.stderr)

    with tempfile.TemporaryDirectory() as folder:
        render_study(STUDY, Path(folder) / "dataset", frames=range(frames), progress=progress)
    seconds, cpu = 1e3 * np.diff(ticks, axis=0).T
    each = min(100, (frames - WARM) // 2)
    return {
        "frames": frames,
        "warm_mb": warm,
        "last_mb": last,
        "growth_mb": last - warm,
        "first_ms": float(np.median(seconds[WARM : WARM + each])),
        "last_ms": float(np.median(seconds[-each:])),
        "first_cpu_ms": float(np.mean(cpu[WARM : WARM + each])),
        "last_cpu_ms": float(np.mean(cpu[-each:])),
        "each": each,
    }


def lines(result: dict[str, Any]) -> list[str]:
    return [
        f"{result['frames']} frames of 320x240 in one process: resident memory {result['warm_mb']:.0f} MB after {WARM} "
        f"frames, {result['last_mb']:.0f} MB after the last ({result['growth_mb']:+.1f} MB; allowed {MOST_MB:.0f}); "
        f"median time per frame {result['first_ms']:.0f} ms in the first {result['each']} after that, "
        f"{result['last_ms']:.0f} ms in the last {result['each']}; mean processor time per frame "
        f"{result['first_cpu_ms']:.0f} and {result['last_cpu_ms']:.0f} ms."
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    found = run(150 if arguments.quick else 1000)
    print("\n".join(lines(found)))
    if arguments.json:
        arguments.json.write_text(json.dumps(found))
    sys.exit(found["growth_mb"] > MOST_MB)
