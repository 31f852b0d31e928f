"""Where a frame's time goes: what the pipeline adds to the integrator and to the compression of EXR files.

    python stages.py [FRAMES] [--profile] [--json FILE]

Functions are wrapped where they are called, see stopwatch.py; what no stage covers is shown as `rest`.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from reference import STUDY
from stopwatch import Stopwatch

# The two that are no overhead.
INTEGRATOR, COMPRESSION = "integrator", "EXR compression"

RUN, RADIANCE, HERE = "roundel.render.run", "roundel.render.radiance", __name__
STAGES = [
    (INTEGRATOR, RADIANCE, "_chunk"),
    ("scene", RADIANCE, "optics_of"),
    ("scene", RADIANCE, "_tracer"),
    ("sample map", RADIANCE, "sample_map"),
    ("sample map", RADIANCE, "counts_of"),
    ("gathering pixels", RADIANCE, "render_radiance"),
    ("develop", RUN, "develop"),
    ("fidelity", RUN, "measure_circle"),
    (COMPRESSION, RUN, "encode_radiance"),
    ("PNG", RUN, "image_file"),
    ("checksums, writing", RUN, "write_frame"),
    ("journal entry", RUN, "entry_of"),
]


def run(frames: int, study_path: Path = STUDY, profile: bool = False) -> dict[str, Any]:
    """Median seconds of each stage over warm frames, and the fraction that is overhead."""
    from roundel.datasets import journal
    from roundel.render import run as run_module
    from roundel.render.backend import start
    from roundel.scenes.frame import frame_of, total_frames
    from roundel.scenes.study import load_study
    from roundel.scenes.truth import truth_of

    study, watch = load_study(study_path), Stopwatch()
    start()
    missing = [f"{module}.{name}" for label, module, name in STAGES if not watch.wrap(label, module, name)]
    # What is spent while neither of the two is at work, in whatever thread, is overhead.
    placing = watch.timed("placing the frame", frame_of)
    truth, append = watch.timed("truth", truth_of), watch.timed("journal entry", journal.append)
    rows: list[dict[str, float]] = []
    spent: list[float] = []
    profiler = None
    if profile:
        import cProfile

        profiler = cProfile.Profile()
    with tempfile.TemporaryDirectory() as folder:
        for i in range(frames + 2):
            watch.reset()
            if profiler and i >= 2:
                profiler.enable()
            began = time.perf_counter()
            frame = placing(study, i % total_frames(study))
            entry, _ = run_module.render_frame(frame, Path(folder))
            append(Path(folder), entry)
            truth(frame)
            total = time.perf_counter() - began
            if profiler:
                profiler.disable()
            if i >= 2:  # the first two compile kernels
                beside = {f"{label} (in another thread)": v for label, v in watch.beside.items()}
                rest = total - sum(watch.seconds.values())
                rows.append({**watch.seconds, **beside, "rest": rest, "total": total})
                spent.append(total - watch.covered(INTEGRATOR, COMPRESSION))
    if profiler:
        import pstats

        pstats.Stats(profiler).sort_stats("tottime").print_stats(30)
    labels = list(dict.fromkeys(label for row in rows for label in row))
    medians = {label: float(np.median([row.get(label, 0.0) for row in rows])) for label in labels}
    return {
        "frames": frames,
        "seconds": medians,
        "overhead_s": float(np.median(spent)),
        "overhead": float(np.median([s / row["total"] for s, row in zip(spent, rows, strict=True)])),
        "adds": float(np.median([s / (row["total"] - s) for s, row in zip(spent, rows, strict=True)])),
        "missing": missing,
    }


def lines(result: dict[str, Any]) -> list[str]:
    """The table as Markdown."""
    seconds = result["seconds"]
    out = ["| stage | ms | share |", "|---|---:|---:|"]
    order = sorted((k for k in seconds if k != "total"), key=lambda k: -seconds[k])
    out += [f"| {k} | {1e3 * seconds[k]:.1f} | {seconds[k] / seconds['total']:.1%} |" for k in order]
    out.append(f"| **a frame** | {1e3 * seconds['total']:.1f} | |")
    out.append("")
    out.append(
        f"All but integrator and EXR compression: {1e3 * result['overhead_s']:.0f} ms, "
        f"{result['overhead']:.1%} of the frame (median of {result['frames']} warm frames)."
    )
    if result["missing"]:
        out.append(f"Not found, and so within another stage: {', '.join(result['missing'])}.")
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
