"""Frames are pure functions of (study, seed, index) and fill their dimensions evenly."""

from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study
from scipy.stats import kstest, qmc

from roundel.scenes.errors import StudyError
from roundel.scenes.study.sampling import _points, stream
from roundel.scenes.study.study import load_study
from roundel.scenes.study.values import Spread, parse_value
from roundel.scenes.world.frame import frame_of, frames_of, total_frames

STUDY = """\
schema: 1
name: spread
seed: 11
camera: {width_px: 640, height_px: 480, focal_px: {choice: [600, 700]}}
marker: {kind: disc, diameter_m: 0.08}
pose:
  distance_D: {loguniform: [6, 20]}
  tilt_deg: {uniform: [0, 60]}
  azimuth_deg: {normal: [0, 20]}
  roll_deg: {grid: [0, 90]}
frames: 600
"""


@pytest.fixture
def study(tmp_path: Path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    return load_study(path)


def test_a_frame_does_not_depend_on_its_neighbours(study) -> None:
    frames = list(frames_of(study))
    assert len(frames) == total_frames(study) == 600
    for i in (599, 0, 300, 255, 256):
        alone = frame_of(study, i)
        assert alone.settings == frames[i].settings
        assert (alone.noise_seed, alone.ray_seed) == (frames[i].noise_seed, frames[i].ray_seed)


def test_grids_are_walked_and_ranges_are_filled(study) -> None:
    poses = [f.settings.pose for f in frames_of(study)]
    assert [p.roll_deg for p in poses] == [0.0] * 300 + [90.0] * 300
    tilt = np.array([p.tilt_deg for p in poses[:300]]) / 60
    distance = np.log(np.array([p.distance_D for p in poses[:300]]) / 6) / np.log(20 / 6)
    # 300 points of a low-discrepancy sequence: the discrepancy of plain random numbers would be about 0.05.
    assert kstest(tilt, "uniform").statistic < 0.02
    assert kstest(distance, "uniform").statistic < 0.02
    azimuth = np.array([p.azimuth_deg for p in poses])
    assert abs(azimuth.mean()) < 1
    assert abs(azimuth.std() - 20) < 1
    focal = [f.camera.K[0, 0] for f in frames_of(study)]
    assert abs(focal.count(600.0) - 300) < 10


def test_seeds_differ_between_frames(study) -> None:
    seeds = {f.noise_seed for f in frames_of(study)} | {f.ray_seed for f in frames_of(study)}
    assert len(seeds) == 1200


def test_spreads_know_their_bounds() -> None:
    assert parse_value({"normal": [10, 1]}).bounds() == (6.0, 14.0)
    spread = Spread("normal", (10.0, 1.0))
    draws = [spread.draw(u) for u in np.linspace(0, 1 - 1e-12, 1001)]
    assert min(draws) >= 6.0
    assert max(draws) <= 14.0
    assert spread.draw(0.5) == pytest.approx(10.0, abs=1e-12)
    assert Spread("choice", (1.0, 2.0)).draw(0.999999) == 2.0


PAIRED = "groups:\n  a: {frames: 3}\n  b: {frames: 5, paired_with: a, sensor: {read_noise_e: 9}}\n"


def test_paired_groups_draw_the_same(tmp_path: Path) -> None:
    study = small_study(tmp_path, ("frames: 4\n", PAIRED))
    frames = list(frames_of(study))
    for one, other in zip(frames[:3], frames[3:6], strict=True):
        np.testing.assert_array_equal(one.camera_from_sheet, other.camera_from_sheet)
        assert (one.noise_seed, one.ray_seed) == (other.noise_seed, other.ray_seed)
        assert one.drawn == other.drawn
    assert frames[6].drawn != frames[5].drawn


@pytest.mark.parametrize(
    ("groups", "said"),
    [
        ("{a: {frames: 1}, b: {frames: 1, paired_with: c}}", r"paired_with: no other group 'c'"),
        ("{a: {frames: 1, paired_with: a}}", r"paired_with: no other group 'a'"),
        (
            "{a: {frames: 1}, b: {frames: 1, paired_with: a}, c: {frames: 1, paired_with: b}}",
            r"paired_with: name 'a', which 'b' has",
        ),
        (
            "{a: {frames: 1}, b: {frames: 1, paired_with: a, pose: {roll_deg: {uniform: [0, 1]}}}}",
            r"paired_with: group 'a' draws other values \(pose.roll_deg\)",
        ),
    ],
)
def test_pairs_that_cannot_be_are_refused(tmp_path: Path, groups: str, said: str) -> None:
    with pytest.raises(StudyError, match=said):
        small_study(tmp_path, ("frames: 4\n", f"groups: {groups}\n"))


@pytest.mark.parametrize("dimensions", [1, 4, 17])
@pytest.mark.parametrize("block", [0, 1, 40])
def test_a_block_of_points_is_found_without_those_before(dimensions: int, block: int) -> None:
    engine = qmc.Halton(dimensions, scramble=True, rng=np.random.default_rng(stream(5, "main", 0)))
    engine.fast_forward(block * 256)
    np.testing.assert_array_equal(_points(dimensions, 5, "main", block), engine.random(256))
