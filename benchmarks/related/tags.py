"""Square tags on rendered frames: found, identities, normal, position, focal length. Prints Markdown.

    python benchmarks/related/tags.py [--data FOLDER] [--method NAME ...]

Renders benchmarks/related/tags.yaml first if it is missing: 2,000 frames of 160x120 px, ten minutes on two cores.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.scenes.geometry.pose import angle_deg
from roundel.validate.metrics.ground_truth import poses_of

HERE = Path(__file__).resolve().parent
HOUSE = HERE.parents[1]
ROUNDEL = str(Path(sys.executable).parent / "roundel")


def main() -> int:
    parser = argparse.ArgumentParser(description="Square tags on rendered frames.")
    parser.add_argument("--data", type=Path, default=HOUSE / "out" / "bench-tags", help="folder of the frames")
    parser.add_argument("--method", action="append", help="default: fiala2010")
    asked = parser.parse_args()
    if not (asked.data / "manifest.json").is_file():
        subprocess.run([ROUNDEL, "render", str(HERE / "tags.yaml"), str(asked.data)], check=True)
    dataset = open_dataset(asked.data)
    for method in asked.method or ["fiala2010"]:
        with tempfile.TemporaryDirectory() as folder:
            command = [ROUNDEL, "solve", str(asked.data), f"{folder}/est", "--method", method]
            subprocess.run([*command, "--intrinsics", "true", "--intrinsics", "default"], check=True)
            rows = pq.read_table(f"{folder}/est/estimates.parquet").to_pylist()
        print("\n".join([f"## {method}", "", *table(dataset, rows), ""]), flush=True)
    return 0


def table(dataset: Dataset, rows: list[dict]) -> list[str]:
    """Markdown: a row for each dictionary and one for all."""
    families, identities, focals = {}, {}, {}
    for i, frame in enumerate(dataset.images.frame_ids):
        layout = dataset.images.markers(i)[0]["layout"]
        families[frame], identities[frame] = layout["family"], layout["first_id"]
        focals[frame] = float(dataset.images.camera(i).K[0, 0])
    poses = dict(zip(dataset.truth["frame_id"].to_pylist(), poses_of(dataset.truth), strict=True))
    out = [
        "| dictionary | frames | found | wrong identity | false | wrong pose chosen | undecided | normal, deg: median "
        "| 95 % | position, %: median | f measured | f, %: median | 95 % covered | prior, % RMS | fused, % RMS |",
        "|---|" + "---:|" * 14,
    ]
    for family in [*dict.fromkeys(families.values()), "all"]:
        frames = {f for f in families if family in ("all", families[f])}
        inside = [r for r in rows if r["frame_id"] in frames]
        out.append(f"| {family} | {_figures(inside, frames, identities, poses, focals)} |")
    return out


def _figures(rows: list[dict], frames: set[int], identities: dict, poses: dict, focals: dict) -> str:
    ok = [r for r in rows if r["status"] == "ok" and r["intrinsics"] == "true"]
    found: dict[int, dict[int, list[dict]]] = {}
    for r in ok:
        found.setdefault(r["frame_id"], {}).setdefault(r["detection_id"], []).append(r)
    normal, position, focal, wrong, undecided, misread, false = [], [], [], 0, 0, 0, 0
    for frame, detections in found.items():
        pose, best = poses[frame], {}
        for number, candidates in detections.items():
            errors = [float(angle_deg(_vector(r, "normal", ""), pose[:3, 2])) for r in candidates]
            shift = [np.linalg.norm(_vector(r, "centre", "_m") - pose[:3, 3]) for r in candidates]
            best[number] = errors, [100 * s / np.linalg.norm(pose[:3, 3]) for s in shift], candidates
        nearest = min(best, key=lambda n: min(best[n][1]))
        false += len(best) - 1
        errors, shift, candidates = best[nearest]
        normal.append(min(errors))
        position.append(shift[int(np.argmin(errors))])
        chosen = [i for i, r in enumerate(candidates) if r["chosen"]]
        undecided += not chosen
        wrong += bool(chosen) and chosen[0] != int(np.argmin(errors))
        misread += candidates[0]["identity"] != identities[frame]
        if candidates[0]["focal_px"] is not None:
            sigma = candidates[0]["focal_sigma_px"] / candidates[0]["focal_px"]
            focal.append((np.log(candidates[0]["focal_px"] / focals[frame]), sigma))
    out = [f"{len(frames)} | {100 * len(found) / len(frames):.1f} % | {misread} | {false} | {wrong} | {undecided}"]
    out.append(f"{np.median(normal):.3f} | {np.percentile(normal, 95):.3f} | {np.median(position):.3f}")
    if focal:
        error, sigma = np.array(focal).T
        rng = np.random.default_rng(1)
        prior = rng.normal(0, 0.115, len(error))
        weight = 0.115**2 / (0.115**2 + sigma**2)
        fused = (1 - weight) * prior + weight * error
        covered = 100 * np.mean(np.abs(error) < 1.96 * sigma)
        rms = [100 * np.sqrt(np.mean(v**2)) for v in (prior, fused)]
        out.append(f"{len(error)} | {100 * np.median(np.abs(error)):.1f} | {covered:.1f} | {rms[0]:.1f} | {rms[1]:.1f}")
    else:
        out.append("0 | | | | ")
    return " | ".join(out)


def _vector(row: dict, name: str, unit: str) -> np.ndarray:
    return np.array([row[f"{name}_{axis}{unit}"] for axis in "xyz"])


if __name__ == "__main__":
    sys.exit(main())
