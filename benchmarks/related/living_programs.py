"""The living programs on 20 clean rendered frames of their own marker each. Prints Markdown.

    python benchmarks/related/living_programs.py [--data FOLDER]

Run `make peers-env` first; programs that are not installed are left out. Renders for a minute on two cores.
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
from roundel.scenes.camera.model import project
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.methods.registry import installed_methods
from roundel.validate.metrics.ground_truth import poses_of

HOUSE = Path(__file__).resolve().parents[2]
ROUNDEL = str(Path(sys.executable).parent / "roundel")

STUDY = """\
schema: 1
name: living
seed: 11
camera: {width_px: 320, height_px: 240, focal_px: 400}
marker: MARKER
pose:
  distance_m: {uniform: [0.4, 0.8]}
  tilt_deg: {uniform: [10, 50]}
  azimuth_deg: {uniform: [-180, 180]}
  roll_deg: {uniform: [-180, 180]}
  offset_x_px: {uniform: [-60, 60]}
  offset_y_px: {uniform: [-40, 40]}
light: {environment: 1.0}
render: {target_error: 0.01, radiance: false}
frames: 20
"""
# The area of a disc of 80 mm each.
MARKERS = {
    "simittag": "{kind: coded_rings, diameter_m: 0.08, code: ['111010110010110100010010', '000000000101011110010010', "
    "'000000110001001011010001', '000000001111000010000111']}",
    "ringgrid": "{kind: coded_rings, diameter_m: 0.08, code: ['0011111101000101'], hole: 0.488095, disc: 0.702381, "
    "code_from: 0.702381, code_to: 0.785714, ring_from: 0.785714}",
    "stag": "{kind: stag, tag_m: 0.0709, id: 4}",
    "pupil_apriltags": "{kind: tags, tag_m: 0.0709, first_id: 42}",
    "pycalib": "{kind: disc, diameter_m: 0.08}",
}
IDENTITIES = {"simittag": 0x1234, "ringgrid": 0, "stag": 4, "pupil_apriltags": 42, "pycalib": None}


def main() -> int:
    parser = argparse.ArgumentParser(description="The living programs on their own markers.")
    parser.add_argument("--data", type=Path, default=HOUSE / "out" / "bench-living", help="folder of the frames")
    data = parser.parse_args().data
    installed = {m.name for m in installed_methods()}
    print(
        "| method | frames | found | wrong identity | wrong pose chosen | normal, deg: median | worst | position, %: "
        "median | centre, px: mean x | mean y |\n|---|" + "---:|" * 9
    )
    for method, marker in MARKERS.items():
        if method not in installed:
            continue
        folder = data / method
        if not (folder / "manifest.json").is_file():
            data.mkdir(parents=True, exist_ok=True)
            study = data / f"{method}.yaml"
            study.write_text(STUDY.replace("MARKER", marker))
            subprocess.run([ROUNDEL, "render", str(study), str(folder)], check=True, stdout=sys.stderr)
        with tempfile.TemporaryDirectory() as out:
            command = [ROUNDEL, "solve", str(folder), f"{out}/est", "--method", method, "--intrinsics", "true"]
            subprocess.run(command, check=True, stdout=sys.stderr)
            rows = pq.read_table(f"{out}/est/estimates.parquet").to_pylist()
        print(f"| {method} | {_figures(open_dataset(folder), rows, IDENTITIES[method])} |", flush=True)
    return 0


def _figures(dataset: Dataset, rows: list[dict], identity: int | None) -> str:
    camera = dataset.images.camera(0)
    found, normal, position, shift, misread, wrong = 0, [], [], [], 0, 0
    for frame, pose in zip(dataset.truth["frame_id"].to_pylist(), poses_of(dataset.truth), strict=True):
        candidates = [r for r in rows if r["frame_id"] == frame and r["status"] == "ok"]
        if not candidates:
            continue
        found += 1
        centres = np.array([[r[f"centre_{axis}_m"] for axis in "xyz"] for r in candidates])
        errors = [float(angle_deg([r[f"normal_{axis}"] for axis in "xyz"], pose[:3, 2])) for r in candidates]
        best = int(np.argmin(errors))
        normal.append(errors[best])
        position.append(100 * np.linalg.norm(centres[best] - pose[:3, 3]) / np.linalg.norm(pose[:3, 3]))
        shift.append(project(camera, centres[best]) - project(camera, pose[:3, 3]))
        misread += candidates[best]["identity"] != identity
        wrong += any(r["chosen"] and i != best for i, r in enumerate(candidates))
    x, y = np.mean(shift, axis=0)
    return (
        f"{dataset.truth.num_rows} | {found} | {misread} | {wrong} | {np.median(normal):.2f} | {max(normal):.1f} | "
        f"{np.median(position):.3f} | {x:+.3f} | {y:+.3f}"
    )


if __name__ == "__main__":
    sys.exit(main())
