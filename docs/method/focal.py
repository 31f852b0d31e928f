"""Numbers about the focal length: the default, and the effect of a wrong one."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
from ambiguity import table

from roundel.scenes.camera.film import DEFAULT_FOCAL_35MM_MM, DEFAULT_FOCAL_35MM_SIGMA_MM
from roundel.scenes.geometry.conic import conic_of_circle
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, minimal_rotation, normal_of
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import frame_of
from roundel.solver.pose.circle_pose import poses_from_conic

STUDY = Path(__file__).parents[2] / "configs" / "wrong_focal.yaml"
FACTORS = (0.7, 0.85, 1.15, 1.3)
DIAGONAL_MM, WIDTH_MM = math.hypot(36, 24), 36.0


def defaults_table() -> str:
    """Three definitions of a 35-mm equivalent focal length, for 1280x720."""
    rows = []
    readings = {
        "diagonal": math.hypot(1280, 720) / DIAGONAL_MM,
        "width": 1280 / WIDTH_MM,
        "16:9 cropped from a 4:3 sensor": math.hypot(1280, 960) / DIAGONAL_MM,
    }
    for name, px_per_mm in readings.items():
        focal, sigma = DEFAULT_FOCAL_35MM_MM * px_per_mm, DEFAULT_FOCAL_35MM_SIGMA_MM * px_per_mm
        equivalent = 1280 / px_per_mm
        away = (equivalent - DEFAULT_FOCAL_35MM_MM) / DEFAULT_FOCAL_35MM_SIGMA_MM
        cells = [name, f"{focal:.1f} px", f"{sigma:.0f} px", f"{equivalent:.1f} mm ({away:+.2f} sigma)"]
        rows.append([*cells, f"{focal / 1280:.3f}"])
    head = ["35-mm equivalent by", "default f for 1280x720", "sigma", "equivalent of f = 1280 px", "default / 1280"]
    return table(head, rows)


def normal_bias_deg(off_axis_deg: float, tilt_deg: float, azimuth_deg: float, factor: float) -> float:
    """Noise-free error of the normal at 20 D, of the nearer candidate; angles from the line of sight."""
    ray = normal_of(180.0 - off_axis_deg, 0.0)
    normal = minimal_rotation([0, 0, 1], ray) @ normal_of(tilt_deg, azimuth_deg)
    conic = conic_of_circle(camera_from_marker_of(normal, 20 * ray), 0.5, np.diag([1280.0, 1280.0, 1.0]))
    poses = poses_from_conic(conic, np.diag([1280.0 * factor, 1280.0 * factor, 1.0]), 0.5)
    return float(angle_deg(poses.normal, normal).min())


def closed_form_deg(off_axis_deg: float, tilt_deg: float, factor: float) -> float:
    """The largest bias over the azimuths, for a small circle."""
    d, t = math.radians(off_axis_deg), math.radians(tilt_deg)
    seen = math.atan(math.tan(d) / factor)
    return abs(math.degrees(seen - d + math.acos(math.cos(t) * math.cos(seen) / math.cos(d)) - t))


def study_scores(folder: Path) -> dict[tuple[str, str, int], list[tuple[float, float, float]]]:
    """Run the study: (azimuth, normal error in deg, position error in %) by group, intrinsics and distance in D."""
    from roundel.datasets.dataset import open_dataset
    from roundel.render.run import render_study
    from roundel.solver.methods.solve import solve_dataset
    from roundel.validate.estimates.runs import read_runs
    from roundel.validate.metrics.ground_truth import true_targets
    from roundel.validate.scores.scores import score

    study = load_study(STUDY)
    render_study(study, folder / "dataset")
    solve_dataset(folder / "dataset", folder / "estimates", methods=("ml",), intrinsics=tuple(study.solve.intrinsics))
    dataset = open_dataset(folder / "dataset")
    runs = read_runs([folder / "estimates" / "estimates.parquet"], dataset)
    found: dict[tuple[str, str, int], list[tuple[float, float, float]]] = {}
    for row in score(dataset, true_targets(dataset, 3.0), runs).table.to_pylist():
        azimuth = frame_of(study, row["frame_id"]).settings.pose.azimuth_deg
        key = row["group"], row["intrinsics"], round(row["distance_D"])
        found.setdefault(key, []).append((azimuth, row["oracle_normal_error_deg"], row["oracle_position_error_pct"]))
    return found


def study_table() -> str:
    """Smallest and largest error of the normal over the azimuths."""
    with tempfile.TemporaryDirectory() as name:
        found = study_scores(Path(name))
    names = {
        "on_axis": "on the axis, 30 degrees",
        "sight_10": "10 off axis, 30 from the line of sight",
        "sight_20": "20 off axis, 30 from the line of sight",
        "axis_10": "10 off axis, `tilt_deg` 30",
        "axis_20": "20 off axis, `tilt_deg` 30",
    }
    rows = []
    for group, words in names.items():
        for distance in (15, 50):
            cells = [words, f"{distance} D"]
            for factor in FACTORS:
                errors = np.array(found[group, f"scaled:{factor:g}", distance])[:, 1]
                digits = 4 if group == "on_axis" else 1
                cells.append(f"{errors.min():.{digits}f} to {errors.max():.{digits}f}")
            rows.append(cells)
    return table(["marker", "distance", *(f"x {factor:g}" for factor in FACTORS)], rows)


def closed_form_table() -> str:
    """Compare the closed form with the exact poses."""
    rows = []
    for off_axis in (5.0, 10.0, 20.0, 30.0):
        cells = [f"{off_axis:g}"]
        for factor in FACTORS:
            exact = normal_bias_deg(off_axis, 30.0, 180.0, factor)
            cells.append(f"{closed_form_deg(off_axis, 30.0, factor):.2f} ({exact:.2f})")
        rows.append(cells)
    return table(["degrees off the axis", *(f"x {factor:g}" for factor in FACTORS)], rows)
