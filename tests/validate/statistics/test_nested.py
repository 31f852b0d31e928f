"""The nested bootstrap: its interval covers the truth, and one over frames alone does not."""

import numpy as np
import pytest

from roundel.validate.statistics.nested import MIN_UNITS, CameraErrors, nested_factor

# Scatter of log errors over cameras, calibrations and frames.
CAMERA, SET, FRAME = 0.6, 0.4, 0.7


def sample(rng, cameras, sets=5, frames=15, spread=CAMERA):
    """Errors whose factor is exp(2) in the geometric mean over cameras."""
    out = []
    for shift in spread * rng.standard_normal(cameras):
        without = np.exp(2.0 + shift + FRAME * rng.standard_normal(frames))
        by_set = SET * rng.standard_normal((sets, 1))
        out.append(CameraErrors(without, np.exp(by_set + FRAME * rng.standard_normal((sets, frames)))))
    return out


def test_the_interval_covers_the_truth():
    rng = np.random.default_rng(1)
    found = [nested_factor(sample(rng, 20), seed=i) for i in range(200)]
    covered = np.mean([f.low <= np.exp(2.0) <= f.high for f in found])
    # 95 % of 200 has a standard deviation of 1.5 %; percentiles of 20 cameras are a little too narrow, resampling below
    # the cameras a little too wide.
    assert 0.89 < covered <= 0.99
    assert found[0].n == 20


def test_frames_of_one_calibration_of_one_camera_say_nothing_about_the_next():
    rng = np.random.default_rng(2)
    narrow = 0
    for _ in range(100):
        (camera,) = sample(rng, 1, sets=1, frames=40)
        drawn = rng.integers(0, 40, (200, 40))
        medians = (np.median(errors[drawn], axis=1) for errors in (camera.without, camera.calibrated[0]))
        ratios = np.subtract(*map(np.log, medians))
        low, high = np.percentile(ratios, [2.5, 97.5])
        narrow += not low <= 2.0 <= high
    assert narrow > 30


def test_a_single_camera_has_an_interval_over_its_calibrations():
    rng = np.random.default_rng(3)
    found = nested_factor(sample(rng, 1, sets=12, spread=0.0))
    assert (found.n, found.method) == (12, "percentile, nested over calibrations of one camera")
    assert found.low < found.value < found.high


@pytest.mark.parametrize(("cameras", "sets"), [(1, MIN_UNITS - 1), (MIN_UNITS - 1, 30), (1, 1)])
def test_too_few_have_no_interval(cameras, sets):
    found = nested_factor(sample(np.random.default_rng(4), cameras, sets=sets))
    assert found.value > 0
    assert found.low is None
    assert found.high is None
    assert "fewer than" in found.method
    assert nested_factor([]).value is None


def test_identical_calibrations_give_their_factor():
    camera = CameraErrors(np.full(9, 6.0), np.full((3, 9), 2.0))
    np.testing.assert_allclose(camera.factors, 3.0)
    found = nested_factor([camera] * 8)
    np.testing.assert_allclose([found.value, found.low, found.high], 3.0)
