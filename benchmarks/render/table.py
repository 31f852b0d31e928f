"""Benchmark results as Markdown."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

import memory
import numpy as np
import stages
import throughput
from peers import EDGE_ERROR, NOISE

# With a load above this from other processes, the times are not reliable.
_QUIET_LOAD = 0.5


def machine() -> dict[str, str]:
    """Processor and versions; no host or user names."""
    try:
        info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        cpu = next(line.split(":", 1)[1].strip() for line in info.splitlines() if line.startswith("model name"))
    except (OSError, StopIteration):
        cpu = platform.processor() or "unknown"
    found = {"processor": cpu, "cores": str(os.cpu_count()), "python": platform.python_version()}
    return found | {name: metadata.version(name) for name in ("roundel", "mitsuba", "drjit", "numpy")}


def _setting(setting: dict[str, Any]) -> str:
    if "threshold" in setting:
        least = setting["min_samples"] or "auto"
        return f"threshold {setting['threshold']:g}, {least} to {setting['samples']} samples"
    if "spp" in setting:
        return f"{setting['spp']} samples a pixel"
    return f"{setting['rays'] / 1e6:.2f} M rays" if "rays" in setting else ""


def _rows(rows: list[dict[str, Any]]) -> list[str]:
    whole = float(np.median(rows[0]["wall_s"]))
    cpu0 = float(np.median(rows[0]["cpu_s"]))
    light = next((float(np.median(r["wall_s"])) for r in rows if r["name"].endswith("radiance alone")), whole)
    out = [
        "| renderer | setting | edge error, theory | edge error, scatter | noise, smooth | s a frame (min to max; n) | "
        "CPU s | x labelled | x labelled, CPU | x radiance |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for r in rows:
        wall, cpu, m = float(np.median(r["wall_s"])), float(np.median(r["cpu_s"])), r["measures"]
        noise = max(m["noise_sheet"], m["noise_wall"])
        out.append(
            f"| {r['name']} | {_setting(r['setting'])} | {m['edge_theory']:.4f} | {m['edge_scatter']:.4f} | "
            f"{noise:.4f} | "
            f"{wall:.2f} ({min(r['wall_s']):.2f} to {max(r['wall_s']):.2f}; {len(r['wall_s'])}) | {cpu:.2f} | "
            f"{wall / whole:.1f} | {cpu / cpu0:.1f} | {wall / light:.1f} |"
        )
    return out


def _verdict(rows: list[dict[str, Any]]) -> list[str]:
    """The ratio to Cycles' fastest row, in a sentence."""

    def median(r: dict[str, Any], key: str) -> float:
        return float(np.median(r[key]))

    cycles = [r for r in rows if r["name"].startswith("Cycles")]
    if not cycles:
        return []
    best = min(cycles, key=lambda r: median(r, "cpu_s"))
    wall, cpu = (median(best, key) / median(rows[0], key) for key in ("wall_s", "cpu_s"))
    return [
        f"Cycles' fastest row takes {wall:.0f} times as long as Roundel's labelled frame, {cpu:.0f} times by CPU.",
        "",
    ]


def report(results: dict[str, Any]) -> str:
    found = results["machine"]
    out = ["# Benchmark results", ""]
    out += [", ".join(f"{k} {v}" for k, v in found.items()) + f"; {results['threads']} threads for every renderer.", ""]
    loads = [results["load_before"][0], *(r["load"] for r in results["rows"])]
    # The load average includes the benchmark's own earlier parts; only the one at its start shows other work.
    if loads[0] > _QUIET_LOAD:
        out += [
            f"**Other processes were running** (load {loads[0]:.1f} before the start): wall seconds are too long, and "
            "their ratios uncertain; processor seconds are less affected.",
            "",
        ]
    out += [
        f"## A 1280x720 frame: edge error {EDGE_ERROR:g} of the contrast, noise of smooth areas {NOISE:g}",
        "",
        *_rows(results["rows"]),
        "",
        *_verdict(results["rows"]),
    ]
    if "no_cycles" in results:
        out += [results["no_cycles"], ""]
    ours = results["ours"]
    out += [
        f"Roundel's start takes {ours['starting_s']:.1f} s, its first frame (kernels compiled or loaded) "
        f"{ours['first_frame_s']:.1f} s; neither is in the table, nor is any renderer's start.",
        "",
        "## Timings of a frame by stage",
        "",
        *stages.lines(results["stages"]),
        "",
        "## The whole of `roundel render`, including its start",
        "",
        *throughput.lines(results["throughput"]),
    ]
    if "memory" in results:
        out += ["", "## A long run", "", *memory.lines(results["memory"])]
    return "\n".join(out)
