"""Roundel's own frames: seconds, rays, and two images with different seeds to measure.

    python ours.py JOB.json

JOB: `study`, `frames` (how many are timed), `threads`, `out` (a folder), `result`.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from stopwatch import RayCounter

from roundel.datasets.store.folder import Folder
from roundel.datasets.store.log import OwnLog
from roundel.render import radiance as radiance_module
from roundel.render.backend import start
from roundel.render.radiance import render_radiance
from roundel.render.shard_work import render_frame, render_frames
from roundel.scenes.study.study import load_study
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import Frame, frame_of, total_frames


def clock(work: Callable[[], Any]) -> tuple[float, float]:
    """Wall and processor seconds of one call, over all threads."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - cpu


def without_exr(frame: Frame) -> Frame:
    render = frame.settings.render.model_copy(update={"radiance": False})
    return replace(frame, settings=frame.settings.model_copy(update={"render": render}))


def main() -> None:
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    out = Path(job["out"])
    study = load_study(job["study"])
    total = total_frames(study)
    began = time.perf_counter()
    mi = start(threads=job["threads"])
    starting = time.perf_counter() - began
    rays = RayCounter()

    def labelled(count: int, exr: bool) -> list[tuple[float, float]]:
        """The work of `roundel render`, including journal and truth: seconds from one finished frame to the next."""
        frames = (frame_of(study, i % total) for i in range(count + 2))
        ticks, counts, log = [], [], OwnLog(Folder(out), {})
        for entry, _ in render_frames((f if exr else without_exr(f) for f in frames), out):
            log.append({"entry": entry})
            truth_of(frame_of(study, entry["frame_id"]))
            ticks.append((time.perf_counter(), time.process_time()))
            counts.append(rays.rays)
        counted.extend(np.diff(counts)[:count].tolist())
        # No next frame is traced in parallel with the last one.
        return [tuple(pair) for pair in np.diff(ticks, axis=0)[:count]]

    first, _ = clock(lambda: render_frame(frame_of(study, 0), out))
    render_frame(frame_of(study, 1), out)
    frame = frame_of(study, 0)
    for seed in (1, 2):
        np.save(out / f"seed_{seed}.npy", render_radiance(mi, replace(frame, ray_seed=seed)).mean)
    counted: list[int] = []
    seconds: dict[str, list[tuple[float, float]]] = {"radiance": [], "general": []}
    seconds["labelled"] = labelled(job["frames"], exr=True)
    seconds["no_exr"] = labelled(job["frames"], exr=False)
    for i in range(job["frames"]):
        at = frame_of(study, i % total)
        seconds["radiance"].append(clock(lambda at=at: render_radiance(mi, at)))
    general_rays = 0
    # The same frame with Mitsuba's own integrator, as for any scene without a closed form.
    if job["general"]:
        radiance_module.is_plain = lambda _: False
        rays.rays = 0
        render_radiance(mi, frame)
        general_rays = rays.rays
        for i in range(job["general"]):
            at = frame_of(study, i % total)
            seconds["general"].append(clock(lambda at=at: render_radiance(mi, at)))
        for seed in (1, 2):
            np.save(out / f"general_{seed}.npy", render_radiance(mi, replace(frame, ray_seed=seed)).mean)
    answer = {
        "seconds": seconds,
        "rays": counted,
        "rays_general": general_rays,
        "starting_s": starting,
        "first_frame_s": first,
    }
    Path(job["result"]).write_text(json.dumps(answer))


if __name__ == "__main__":
    main()
