"""Off the optical axis a wrong focal length rotates the normal: the shipped study, against published numbers.

Numbers: errata of the paper, sections 4 and 5 (the caveat), noise-free, at the worst azimuth.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.datasets.dataset import open_dataset
from roundel.render.run import render_study
from roundel.scenes.geometry.conic import conic_of_circle
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, minimal_rotation, normal_of
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import frame_of
from roundel.solver.methods.solve import solve_dataset
from roundel.solver.pose.circle_pose import poses_from_conic
from roundel.validate.estimates.runs import read_runs
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.scores.scores import score

CONFIG = Path(__file__).resolve().parents[3] / "configs" / "wrong_focal.yaml"
FACTORS = ("0.7", "0.85", "1.15", "1.3")

# group: the largest bias of the normal over all azimuths, for each factor, degrees.
WORST_DEG = {"sight_10": (5.6, 2.3, 1.7, 2.9), "sight_20": (12.6, 5.3, 3.9, 6.9)}
# The numbers have one decimal: half of it, and 0.01 as a real circle is not infinitely small (0.012 from 15 D to 50 D).
PRINTED = 0.05 + 0.01


@pytest.fixture(scope="module")
def bias(tmp_path_factory) -> dict:
    """Bias of the normal in degrees over the azimuths, by (group, intrinsics, distance_D)."""
    folder = tmp_path_factory.mktemp("wrong_focal")
    # Every second azimuth, 180 among them, where the bias is largest; the time is that of half the frames.
    grid = "grid: [-150, -120, -90, -60, -30, 0, 30, 60, 90, 120, 150, 180]"
    text, changed = re.subn(r"grid: \[-165[^]]*\]", grid, CONFIG.read_text())
    assert changed == 1
    (folder / "study.yaml").write_text(text)
    study = load_study(folder / "study.yaml")
    render_study(study, folder / "dataset")
    solve_dataset(folder / "dataset", folder / "estimates", methods=("ml",), intrinsics=tuple(study.solve.intrinsics))
    dataset = open_dataset(folder / "dataset")
    # The scores of `roundel validate`, without its report: drawing takes longer than all the rest.
    runs = read_runs([folder / "estimates" / "estimates.parquet"], dataset)
    table = score(dataset, true_targets(dataset, 3.0), runs).table
    for frame_id, group in enumerate(dataset.images.groups):
        if group.startswith("sight"):  # `tilt_from: line_of_sight`
            pose = frame_of(study, frame_id).camera_from_sheet
            assert angle_deg(-pose[:3, 2], pose[:3, 3]) == pytest.approx(30, abs=1e-9)
    azimuths = {frame_id: frame_of(study, frame_id).settings.pose.azimuth_deg for frame_id in range(len(dataset))}
    assert len(azimuths) == 120
    cells: dict = {}
    for row in table.to_pylist():
        assert row["solved"]
        key = row["group"], row["intrinsics"], round(row["distance_D"])
        cells.setdefault(key, {})[azimuths[row["frame_id"]]] = row["oracle_normal_error_deg"]
    return cells


@pytest.mark.parametrize("group", WORST_DEG)
@pytest.mark.parametrize("distance", [15, 50])
def test_the_worst_bias_is_the_published_one_at_any_distance(bias: dict, group: str, distance: int) -> None:
    for factor, printed in zip(FACTORS, WORST_DEG[group], strict=True):
        by_azimuth = bias[group, f"scaled:{factor}", distance]
        assert max(by_azimuth, key=by_azimuth.get) == 180  # the marker faces toward the optical axis
        assert by_azimuth[180] == pytest.approx(printed, abs=PRINTED)


def test_over_the_azimuths_at_30_degrees_of_tilt_the_bias_is_5_to_19_degrees(bias: dict) -> None:
    for distance in (15, 50):
        values = bias["axis_20", "scaled:0.7", distance].values()
        assert min(values) == pytest.approx(5, abs=0.5)  # printed without decimals
        assert max(values) == pytest.approx(19, abs=0.5)


def test_on_the_axis_the_normal_is_left_alone(bias: dict) -> None:
    for factor in FACTORS:
        # 0.0025 degrees at 15 D for 0.7 (errata, section 5), falling with the square of the distance.
        assert max(bias["on_axis", f"scaled:{factor}", 15].values()) < 0.003
        assert max(bias["on_axis", f"scaled:{factor}", 50].values()) < 0.0003


def test_the_true_camera_has_no_bias(bias: dict) -> None:
    for (_, intrinsics, _), values in bias.items():
        if intrinsics == "true":
            assert max(values.values()) < 1e-9  # rounding: 1e-13 in the mean


@given(
    off_axis_deg=st.floats(0, 40),
    tilt_deg=st.floats(5, 60),
    factor=st.floats(0.6, 1.6),
    side=st.sampled_from([-1.0, 1.0]),
    image_azimuth=st.floats(-180, 180),
)
def test_in_the_plane_of_the_axis_the_bias_of_a_small_circle_has_a_closed_form(
    off_axis_deg: float, tilt_deg: float, factor: float, side: float, image_azimuth: float
) -> None:
    # docs/method.md, section 10: tan d' = tan d / k, cos t' = cos t cos d' / cos d, angles from the line of sight.
    d, t = np.radians(off_axis_deg), np.radians(tilt_deg)
    d_seen = np.arctan(np.tan(d) / factor)
    cos_seen = np.cos(t) * np.cos(d_seen) / np.cos(d)
    if not cos_seen < np.cos(np.radians(3)):
        return  # rounder than any small circle can look from there, or nearly: the closed form has no tilt for it
    turn = (d_seen - d) + side * (np.arccos(cos_seen) - t)
    ray = normal_of(180.0 - off_axis_deg, image_azimuth)
    # It faces the optical axis (side 1: its tilt from the axis is d + t) or turns its face away from it (d - t).
    normal = minimal_rotation([0, 0, 1], ray) @ normal_of(tilt_deg, image_azimuth + (180 if side > 0 else 0))
    k_true, k_used = np.diag([1000.0, 1000.0, 1.0]), np.diag([1000.0 * factor, 1000.0 * factor, 1.0])
    # 1e-4 of the distance is small: what is left is of the order of its square.
    conic = conic_of_circle(camera_from_marker_of(normal, ray), 1e-4, k_true)
    poses = poses_from_conic(conic, k_used, 1e-4)
    seen = normal_of(np.degrees(d_seen + side * np.arccos(cos_seen)), image_azimuth + 180)
    assert angle_deg(poses.normal, seen).min() < 1e-3
    assert angle_deg(normal, seen) == pytest.approx(abs(np.degrees(turn)), abs=1e-9)
    # The depth along the axis takes the factor, and the offsets across it stay.
    assert poses.centre_m[0] == pytest.approx(ray * [1, 1, factor], abs=1e-6)
