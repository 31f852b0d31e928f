"""Rendering by the workers of a Dask cluster on this machine: two workers against one, and what scheduling costs.

python benchmarks/store/cluster.py [--frames 120] [--width 900]

Each worker has one thread (`--nthreads 1`). Scheduling is the time that a frame takes longer with one worker than where
the same functions are called one after another, without a cluster; both without the start. Exits
with status 1 if two workers are less than 1.8 times as fast as one, or if scheduling adds more than 5 %.
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

STUDY = """\
schema: 1
name: cluster
seed: 5
frames: {frames}
camera: {{width_px: {width}, height_px: {height}, focal_px: {width}}}
marker: {{kind: disc, diameter_m: 0.08}}
pose:
  distance_D: {{uniform: [7, 9]}}
  tilt_deg: {{uniform: [10, 50]}}
  azimuth_deg: {{uniform: [-180, 180]}}
light: {{environment: 0.7, lamps: [{{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}}]}}
"""
LEAST_SPEEDUP = 1.8
MOST_ADDED = 0.05


def free_port() -> int:
    """A port of this machine that nobody listens at."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def started(*words: str) -> subprocess.Popen[bytes]:
    """`dask WORDS` in a process group of its own."""
    code = f"from distributed.cli.dask_{words[0]} import main; main()"
    command = [sys.executable, "-c", code, *words[1:], "--no-dashboard"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """A scheduler and workers; yields the address."""
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    scheduler = started("scheduler", "--host", "127.0.0.1", "--port", str(port))
    worker = started("worker", address, "--nthreads", "1", "--nworkers", str(workers))
    try:
        yield address
    finally:
        for process in (worker, scheduler):
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def run(study: Path, out: Path, workers: int) -> tuple[float, float]:
    """Render with workers: frames a second while all of them work, and the seconds of the whole."""
    from roundel.render.run import render_study

    ticks: list[tuple[int, float]] = []
    with cluster(workers) as address:
        began = time.perf_counter()
        dataset = render_study(
            study, out, scheduler=address, progress=lambda done, _: ticks.append((done, time.perf_counter()))
        )
        whole = time.perf_counter() - began
    assert dataset is not None
    # At first a worker may still be starting, and at the end one may have no frames left.
    total = len(dataset)
    first, last = next(t for t in ticks if t[0] >= total // 5), next(t for t in ticks if t[0] >= total - total // 10)
    return (last[0] - first[0]) / (last[1] - first[1]), whole


ALONE = """
import sys, time
from roundel.datasets.environment import environment_of
from roundel.datasets.layout.shards import shards_of
from roundel.datasets.resume import prepare
from roundel.datasets.work import Task
from roundel.render import run
from roundel.render.backend import environment
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import total_frames
study = load_study(sys.argv[1])
prepare(study, sys.argv[2])
shared = run.Shared(sys.argv[1], study.digest(), sys.argv[2], environment_of(environment("llvm")), False)
run._start_worker(shared, "llvm", 1)
(shard,) = shards_of(total_frames(study))
run._work(Task(shard, (0,)))
began = time.perf_counter()
for i in shard.frames[1:]:
    run._work(Task(shard, (i,)))
print((len(shard.frames) - 1) / (time.perf_counter() - began))
"""


def alone(study: Path, out: Path) -> float:
    """Frames a second of a process that calls what a worker calls."""
    # Dask starts its workers with these, whatever the user sets: the same here leaves scheduling as the difference.
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", ALONE, str(study), str(out)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout)


def main() -> int:
    """Measure and print a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--width", type=int, default=900)
    asked = parser.parse_args()
    print(f"load of the machine before: {os.getloadavg()[0]:.2f}; {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "study.yaml"
        study.write_text(STUDY.format(frames=asked.frames, width=asked.width, height=asked.width * 3 // 4))
        without = alone(study, Path(folder) / "alone")
        (one, whole_one), (two, whole_two) = (run(study, Path(folder) / str(n), n) for n in (1, 2))
    added = without / one - 1
    print("| | frames a second | a frame of one process, s | with start and tables, s |")
    print("|---|---:|---:|---:|")
    print(f"| no cluster, one process of one thread | {without:.2f} | {1 / without:.3f} | |")
    print(f"| one worker | {one:.2f} | {1 / one:.3f} | {whole_one:.1f} |")
    print(f"| two workers | {two:.2f} | {2 / two:.3f} | {whole_two:.1f} |")
    print(f"\ntwo workers against one: {two / one:.2f} times; with start and tables {whole_one / whole_two:.2f} times")
    print(f"scheduling adds {100 * added:.1f} %")
    return int(two / one < LEAST_SPEEDUP or added > MOST_ADDED)


if __name__ == "__main__":
    sys.exit(main())
