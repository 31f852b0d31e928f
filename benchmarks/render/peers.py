"""The peers: find them, tune them to the target edge error on a window around the disc, time them on whole frames."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from reference import Array, Measures, measure, scene_numbers

from roundel.scenes.world.frame import Frame

HERE = Path(__file__).resolve().parent

# Target error of every renderer; tuning aims slightly lower, because the interpolation may err.
EDGE_ERROR, NOISE = 0.01, 0.02
_AIM = 0.0097


def find_bpy() -> str | None:
    """An interpreter with `bpy`: this one, that of `make bench-env`, or the one named by ROUNDEL_BENCH_PYTHON."""
    made = HERE.parents[1] / ".venv-bench" / "bin" / "python"
    for python in (os.environ.get("ROUNDEL_BENCH_PYTHON"), sys.executable, str(made)):
        if not python or not os.access(python, os.X_OK):
            continue
        if subprocess.run([python, "-c", "import bpy"], capture_output=True, check=False).returncode == 0:
            return python
    return None


def work(python: str, script: str, job: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run a worker in its own process and return its result."""
    told, asked = folder / f"{Path(script).stem}.result.json", folder / f"{Path(script).stem}.job.json"
    asked.write_text(json.dumps({**job, "result": str(told)}), encoding="utf-8")
    done = subprocess.run(
        [python, "-W", "ignore", str(HERE / script), str(asked)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{script} failed:\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}")
    answer: dict[str, Any] = json.loads(told.read_text(encoding="utf-8"))
    return answer


def read_image(path: Path, frame: Frame, window: list[int] | None) -> Array:
    """An image of the whole frame's size; NaN outside the window."""
    whole = np.full((frame.camera.height_px, frame.camera.width_px), np.nan)
    if path.suffix == ".npy":
        image = np.load(path).astype(np.float64)
    else:
        import OpenEXR

        with OpenEXR.File(str(path)) as file:
            image = file.channels()["RGB"].pixels[..., 0].astype(np.float64)
    if window is None:
        return np.asarray(image, dtype=np.float64)
    x0, y0, x1, y1 = window
    whole[y0:y1, x0:x1] = image if image.shape == (y1 - y0, x1 - x0) else image[y0:y1, x0:x1]
    return whole


def interpolate(settings: list[float], errors: list[float]) -> float:
    """The setting for the target error, by log-log interpolation between two points."""
    (s0, s1), (e0, e1) = np.log(settings), np.log(errors)
    return float(np.exp(s0 + (np.log(_AIM) - e0) * (s1 - s0) / (e1 - e0)))


class Peer:
    """A renderer in its own process."""

    def __init__(self, python: str, script: str, suffix: str, frame: Frame, folder: Path, threads: int) -> None:
        self.python, self.script, self.suffix = python, script, suffix
        self.frame, self.folder, self.threads = frame, folder, threads
        self.scene = scene_numbers(frame)
        self.version = ""

    def render(self, settings: list[dict[str, Any]], whole: bool, seeds: int = 2) -> list[tuple[Measures, Array]]:
        """Each setting with several seeds: the measures of the first two, and (wall, processor) seconds of each."""
        window = None if whole else self.scene["window"]
        renders = [
            {**one, "seed": seed, "window": window, "out": str(self.folder / f"peer_{i}_{seed}{self.suffix}")}
            for i, one in enumerate(settings)
            for seed in range(1, seeds + 1)
        ]
        # First a render with few samples, to warm up.
        warm = {**renders[0], "out": str(self.folder / f"warm{self.suffix}"), "window": self.scene["window"]}
        warm["spp" if "spp" in warm else "samples"] = 1
        job = {"scene": self.scene, "threads": self.threads, "renders": [warm, *renders]}
        answer = work(self.python, self.script, job, self.folder)
        self.version = answer["version"]
        found = []
        for i in range(len(settings)):
            of = slice(i * seeds, (i + 1) * seeds)
            one, other = (read_image(Path(r["out"]), self.frame, window) for r in renders[of][:2])
            found.append((measure(self.frame, one, other), np.array(answer["seconds"][1:][of])))
        return found

    def row(self, name: str, setting: dict[str, Any], seeds: int = 2) -> dict[str, Any]:
        """The table row of a whole frame."""
        load = os.getloadavg()[0]
        ((measured, seconds),) = self.render([setting], whole=True, seeds=seeds)
        return row(name, setting, measured, seconds, load)


def row(
    name: str, setting: dict[str, Any], measured: Measures | None, seconds: Array, load: float, **more: Any
) -> dict[str, Any]:
    wall, cpu = np.asarray(seconds).T
    return {
        "name": name,
        "setting": setting,
        "measures": asdict(measured) if measured else None,
        "wall_s": wall.tolist(),
        "cpu_s": cpu.tolist(),
        "load": load,
        **more,
    }


def cycles_rows(
    python: str, frame: Frame, folder: Path, threads: int, quick: bool, default: bool
) -> tuple[list[Any], str]:
    peer = Peer(python, "peer_cycles.py", ".exr", frame, folder, threads)
    rows = []
    # Smooth areas need few samples here: a minimum of 4 suits this scene best, 16 is cautious; 0 is Cycles' own choice,
    # 64 at a threshold of 0.01.
    for least in (4, 16, 0) if default else (4, 16):
        name, thresholds = "Cycles, adaptive", [0.02, 0.01]
        settings = [{"threshold": t, "min_samples": least, "samples": 4096} for t in thresholds]
        if quick:
            rows.append(peer.row(name, {**settings[0], "threshold": 0.2, "samples": 16}))
            break
        errors = [measured.edge_scatter for measured, _ in peer.render(settings, whole=False)]
        threshold = min(max(interpolate(thresholds, errors), 0.002), 0.05)
        rows.append(peer.row(name, {**settings[0], "threshold": round(threshold, 5)}))
    return rows, peer.version


def mitsuba_rows(frame: Frame, folder: Path, threads: int, quick: bool) -> tuple[list[Any], str]:
    peer = Peer(sys.executable, "peer_mitsuba.py", ".npy", frame, folder, threads)
    counts = [64, 144]
    settings = [{"sampler": "multijitter", "spp": n} for n in counts]
    if quick:
        return [peer.row("mi.render, multijitter", {**settings[0], "spp": 16})], peer.version
    errors = [measured.edge_scatter for measured, _ in peer.render(settings, whole=False)]
    wanted = interpolate([float(n) for n in counts], errors)
    # Multi-jittering needs a grid of two similar factors.
    side = max(1, math.isqrt(math.ceil(wanted)))
    spp = side * math.ceil(wanted / side)
    return [peer.row("mi.render, multijitter", {"sampler": "multijitter", "spp": spp})], peer.version
