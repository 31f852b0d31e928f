"""Timings of a frame by stage, and the pipeline's overhead over the integrator and EXR compression.

    python benchmarks/render/stages.py [FRAMES] [--study FILE] [--profile] [--json FILE]

Functions are wrapped where they are called, see stopwatch.py. `roundel render` finishes one frame while it traces the
next, so stages overlap. The overhead is therefore measured against a second loop of the same structure that only traces
and compresses.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from reference import STUDY
from stopwatch import Stopwatch

# The two stages that are not overhead.
INTEGRATOR, COMPRESSION = "integrator", "EXR compression"

RUN, RADIANCE = "roundel.render.shard_work", "roundel.render.radiance"
STAGES = [
    (INTEGRATOR, RADIANCE, "_chunk"),
    ("scene", RADIANCE, "optics_of"),
    ("scene", RADIANCE, "_tracers"),
    ("depth", RADIANCE, "depth_plane"),
    ("sample map", RADIANCE, "sample_map"),
    ("sample map", RADIANCE, "counts_of"),
    ("gathering pixels", RADIANCE, "render_radiance"),
    ("develop", RUN, "develop"),
    ("fidelity", RUN, "measure_circle"),
    (COMPRESSION, RUN, "encode_planes"),
    ("PNG", RUN, "image_file"),
    ("checksums, writing", RUN, "write_frame"),
    ("journal entry", RUN, "entry_of"),
    # Takes hardly any time apart from the noise plane.
    ("noise plane", RUN, "_finished"),
]

# Warm-up frames: compile kernels, then fill the pipeline.
_WARM = 3


def bare(frames: Iterator[Any]) -> Iterator[None]:
    """The minimum work: one frame's EXR is compressed while the next is traced."""
    from roundel.datasets.layout.radiance import encode_planes
    from roundel.render.backend import start
    from roundel.render.radiance import render_radiance

    mi = start()
    with ThreadPoolExecutor(1) as pool:
        before: Future[bytes] | None = None
        for frame in frames:
            r = render_radiance(mi, frame)
            if before is not None:
                before.result()
                yield
            # The fifth plane stands in for the noise plane, which has the same size.
            planes = {"Y": r.mean, "Y.variance": r.variance, "Z": r.depth_m, "noise_dn": r.mean**0.5}
            before = pool.submit(encode_planes, planes | {f"coverage.{i}": c for i, c in r.coverage.items()})
        if before is not None:
            before.result()
            yield


def run(frames: int, study_path: Path = STUDY, profile: bool = False) -> dict[str, Any]:
    """Mean seconds of each stage over warm frames, and the pipeline's overhead."""
    from roundel.datasets.store.folder import Folder
    from roundel.datasets.store.log import OwnLog
    from roundel.render import shard_work
    from roundel.render.backend import start
    from roundel.scenes.study.study import load_study
    from roundel.scenes.truth.truth import truth_of
    from roundel.scenes.world.frame import frame_of, total_frames

    study, watch = load_study(study_path), Stopwatch()
    total = total_frames(study)
    start()

    def ticks(steps: Iterator[Any]) -> list[tuple[float, float]]:
        seen = []
        for _ in steps:
            seen.append((time.perf_counter(), time.process_time()))
            if len(seen) == _WARM:
                watch.reset()
        return seen[_WARM - 1 : -1]  # nothing is traced in parallel with the last one

    at_least = ticks(bare(frame_of(study, i % total) for i in range(frames + _WARM + 1)))
    missing = [f"{module}.{name}" for label, module, name in STAGES if not watch.wrap(label, module, name)]
    placing = watch.timed("placing the frame", frame_of)
    truth, append = watch.timed("truth", truth_of), watch.timed("journal entry", OwnLog.append)

    def whole(folder: Path) -> Iterator[None]:
        placed = (placing(study, i % total) for i in range(frames + _WARM + 1))
        store = Folder(folder)
        log = OwnLog(store, {})
        for entry, _ in shard_work.render_frames(placed, store):
            append(log, {"entry": entry})
            truth(frame_of(study, entry["frame_id"]))
            yield

    with tempfile.TemporaryDirectory() as name:
        if profile:
            import cProfile
            import pstats

            profiler = cProfile.Profile()
            seen = profiler.runcall(ticks, whole(Path(name)))
            pstats.Stats(profiler).sort_stats("tottime").print_stats(30)
        else:
            seen = ticks(whole(Path(name)))
    (began, cpu_began), (ended, cpu_ended) = seen[0], seen[-1]
    count = len(seen) - 1
    wall, cpu = (ended - began) / count, (cpu_ended - cpu_began) / count
    stages = {label: (watch.seconds.get(label, 0.0) + watch.beside.get(label, 0.0)) / count for label in watch.cpu}
    used = {label: value / count for label, value in watch.cpu.items()}
    # The tracer's own threads cannot be timed: it gets the processor time that the other stages leave.
    used[INTEGRATOR] = cpu - sum(value for label, value in used.items() if label != INTEGRATOR)
    bare_wall = (at_least[-1][0] - at_least[0][0]) / (len(at_least) - 1)
    bare_cpu = (at_least[-1][1] - at_least[0][1]) / (len(at_least) - 1)
    return {
        "frames": count,
        "stages_s": stages,
        "stages_cpu_s": used,
        "beside": sorted(watch.beside),
        "wall_s": wall,
        "cpu_s": cpu,
        "neither_s": wall - watch.covered(began, ended, INTEGRATOR, COMPRESSION) / count,
        "bare_wall_s": bare_wall,
        "bare_cpu_s": bare_cpu,
        "adds": wall / bare_wall - 1,
        "adds_cpu": cpu / bare_cpu - 1,
        "missing": missing,
    }


def lines(result: dict[str, Any]) -> list[str]:
    """The table as Markdown."""
    stages, used, wall = result["stages_s"], result["stages_cpu_s"], result["wall_s"]
    out = ["| stage | ms per frame | CPU ms | |", "|---|---:|---:|---|"]
    for label in sorted(stages, key=lambda k: -used[k]):
        beside = "overlaps the next frame's rays" if label in result["beside"] else ""
        out.append(f"| {label} | {1e3 * stages[label]:.1f} | {1e3 * used[label]:.1f} | {beside} |")
    bare_wall, bare_cpu = 1e3 * result["bare_wall_s"], 1e3 * result["bare_cpu_s"]
    out += [
        f"| **from one frame to the next** | {1e3 * wall:.1f} | {1e3 * result['cpu_s']:.1f} | |",
        f"| tracing and EXR compression alone | {bare_wall:.1f} | {bare_cpu:.1f} | |",
        "",
        f"The pipeline adds {result['adds']:.1%} to the time of tracing and EXR compression, {result['adds_cpu']:.1%} "
        f"to their processor time (mean of {result['frames']} warm frames). "
        f"For {result['neither_s'] / wall:.1%} of the time neither was running. "
        "Threads started by a stage count as the integrator's processor time.",
    ]
    if result["missing"]:
        out.append(f"Not found, and therefore included in another stage: {', '.join(result['missing'])}.")
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("frames", type=int, nargs="?", default=8)
    parser.add_argument("--study", type=Path, default=STUDY)
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    found = run(arguments.frames, arguments.study, arguments.profile)
    print("\n".join(lines(found)))
    if arguments.json:
        arguments.json.write_text(json.dumps(found))
