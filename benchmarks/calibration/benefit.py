"""What a calibration is worth, over cameras, and whether stated uncertainty holds with calibrated and assumed cameras.

    python benchmarks/calibration/benefit.py [--cameras 30] [--folder FOLDER] [--markdown FILE] [--figure FILE]

FOLDER (default out/bench-benefit) holds the rendered datasets, calibrations and scores, and goes on where it stopped
(50 views of a chessboard and 24 of a circle per camera: some 20 s of one core each).

Each camera has the focal length of a phone of the table (`roundel.scenes.camera.phones`); its principal point and its
lens are drawn from the prior of an assumed camera. Its views of a board are dealt out, in their order, into independent
sets of 5, 10, 20 and 40; every set calibrates the camera by OpenCV, as `roundel calibrate` does. All circles are solved
with each calibration, with the camera itself, with its EXIF and with both priors of phones.

A second family of cameras is drawn from the prior of `default` itself, for the coverage of its regions.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml
from benefit_cameras import SIZE, disjoint, of_prior, phones, prior, section
from benefit_report import figure, report

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.store.writing import write_file
from roundel.render.run import render_study
from roundel.scenes.camera.model import Camera
from roundel.solver.methods.solve import solve_dataset
from roundel.validate.calibration.opencv import calibrate_views, calibration_to_json, look_for_boards
from roundel.validate.validate import validate_dataset

SEED = 18
COUNTS = (5, 10, 20, 40)
VIEWS, FRAMES = 50, 24
# Frames of each camera of the second family.
FEW = 2
ASSUMED = ("default", "default:2020s", "exif")
KEPT = ("frame_id", "marker_id", "group", "intrinsics",
        "oracle_normal_error_deg", "oracle_position_error_pct", "oracle_pose_chi2",
        "branch_correct", "solved")  # fmt: skip

COMMON: dict[str, Any] = {
    "schema": 1,
    "light": {"environment": 0.8},
    "sensor": {"full_well_e": 10000, "read_noise_e": 5},
    "render": {"target_error": 0.01, "radiance": False},
}
# The board fills most of the image of a camera of 520 px; distances follow the focal length.
BOARD = {
    "marker": {"kind": "chessboard", "columns": 9, "rows": 6, "square_m": 0.03},
    "pose": {
        "tilt_deg": {"uniform": [10, 45]},
        "azimuth_deg": {"uniform": [-180, 180]},
        "roll_deg": {"uniform": [-20, 20]},
        "offset_x_px": {"uniform": [-120, 120]},
        "offset_y_px": {"uniform": [-80, 80]},
    },
}
CIRCLE = {
    "marker": {"kind": "disc", "diameter_m": 0.08},
    "pose": {
        "tilt_deg": {"uniform": [10, 55]},
        "azimuth_deg": {"uniform": [-180, 180]},
        "offset_x_px": {"uniform": [-240, 240]},
        "offset_y_px": {"uniform": [-160, 160]},
    },
}


def study(name: str, seed: int, what: dict[str, Any], distance_m: tuple[float, float], **rest: Any) -> dict[str, Any]:
    """A study of boards or circles."""
    pose = {"distance_m": {"uniform": list(distance_m)}, **what["pose"]}
    return {**COMMON, "name": name, "seed": seed, "marker": what["marker"], "pose": pose, **rest}


def rendered(folder: Path, record: dict[str, Any]) -> Dataset:
    """The dataset of a study, rendered unless it is there."""
    if not (folder / "manifest.json").is_file():
        folder.parent.mkdir(parents=True, exist_ok=True)
        path = folder.with_suffix(".yaml")
        path.write_text(yaml.safe_dump(record, sort_keys=False))
        render_study(path, folder)
    return open_dataset(folder)


def scored(dataset: Path, folder: Path, labels: list[str]) -> pa.Table:
    """Scores of the circles of a dataset with each of the intrinsics."""
    scores = folder / "report" / "scores.parquet"
    if not scores.is_file():
        solve_dataset(dataset, folder / "estimates", intrinsics=labels)
        validate_dataset(dataset, [folder / "estimates"], folder / "report")
    return pq.read_table(scores, columns=list(KEPT))


def calibrations(boards: Dataset, folder: Path) -> list[str]:
    """Labels `calibrated:FILE` of all sets of views; a file is named by its number of views and of its set."""
    folder.mkdir(parents=True, exist_ok=True)
    done = folder / "done.json"
    if not done.is_file():
        views, names = look_for_boards(boards.images), []
        for count in COUNTS:
            for number, chosen in enumerate(disjoint(count, len(views))):
                calibration = calibrate_views([views[i] for i in chosen])
                name = f"{count}_{number}.json"
                record = calibration_to_json(calibration, str(boards.manifest["dataset_id"]), None)
                write_file(folder / name, (json.dumps(record, indent=2) + "\n").encode())
                names.append(name)
        write_file(done, json.dumps(names).encode())
    return [f"calibrated:{folder / name}" for name in json.loads(done.read_text())]


def scores_of_phone(number: int, camera: Camera, folder: Path) -> pa.Table:
    """Scores of one camera of the table, with every calibration of it."""
    scale = float(camera.K[0, 0]) / 520
    shared = {"camera": section(camera)}
    if camera.focal_35mm_mm is not None:
        shared["camera"]["focal_35mm_mm"] = camera.focal_35mm_mm
    boards = study("boards", 1000 + number, BOARD, (0.4 * scale, 0.65 * scale), frames=VIEWS, **shared)
    circles = study("circles", 2000 + number, CIRCLE, (0.6 * scale, 2.0 * scale), frames=FRAMES, **shared)
    labels = calibrations(rendered(folder / "boards", boards), folder / "cameras")
    rendered(folder / "circles", circles)
    table = scored(folder / "circles", folder, ["true", *ASSUMED, *labels])
    return table.append_column("camera", pa.array(np.full(table.num_rows, number)))


def scores_of_prior(cameras: list[Camera], folder: Path) -> pa.Table:
    """Scores of the cameras of the prior, each a group of one study."""
    groups = {f"camera_{i:03d}": {"camera": section(camera)} for i, camera in enumerate(cameras)}
    scale = float(prior().camera.K[0, 0]) / 520
    record = study(
        "prior", 3000, CIRCLE, (0.6 * scale, 2.0 * scale), frames=FEW, camera=section(prior().camera), groups=groups
    )
    rendered(folder / "circles", record)
    table = scored(folder / "circles", folder, ["true", "default"])
    number = [int(group.rpartition("_")[2]) for group in table["group"].to_pylist()]
    return table.append_column("camera", pa.array(number))


def main() -> None:
    """Render, calibrate, solve, score, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, default=30)
    parser.add_argument("--prior-cameras", type=int, default=200)
    parser.add_argument("--folder", type=Path, default=Path("out/bench-benefit"))
    parser.add_argument("--markdown", type=Path)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    rng = np.random.default_rng(SEED)
    cameras, own = phones(given.cameras, rng), of_prior(given.prior_cameras, rng)
    tables = []
    for number, camera in enumerate(cameras):
        tables.append(scores_of_phone(number, camera, given.folder / f"phone_{number:02d}"))
        print(f"phone {number + 1} of {len(cameras)}: {camera.focal_35mm_mm} mm, {SIZE[0]}x{SIZE[1]}", flush=True)
    table = pa.concat_tables(tables)
    text = report(table, scores_of_prior(own, given.folder / "prior"), VIEWS)
    print(text)
    if given.markdown:
        given.markdown.write_text(text)
    if given.figure:
        figure(table, given.figure)


if __name__ == "__main__":
    main()
