"""Intervals that hold what they promise, and say when they cannot."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.validate.intervals import bootstrap_interval, holm, wilson_interval


@pytest.mark.parametrize(("statistic", "truth"), [("median", 0.0), ("rms", 1.0), ("p95", 1.959964)])
def test_intervals_cover_the_truth(statistic, truth):
    generator = np.random.default_rng(3)
    runs = 200
    inside = 0
    for seed in range(runs):
        found = bootstrap_interval(generator.normal(size=100), statistic, seed=seed)
        assert found.method == "BCa"
        inside += found.low <= truth <= found.high
    # 95 % of 200 have a standard deviation of 3; the bootstrap of a tail is some per cent short at 100 samples.
    assert inside >= 190 - 3 * 3 - (8 if statistic == "p95" else 3)


def test_constant_data_have_no_width():
    found = bootstrap_interval(np.full(50, 2.5), "median")
    assert (found.value, found.low, found.high) == (2.5, 2.5, 2.5)


def test_two_valued_data_fall_back_or_hold():
    found = bootstrap_interval(np.r_[np.zeros(99), 1.0], "median")
    assert found.low is not None
    assert found.low <= 0.0 <= found.high


def test_too_few_samples_are_said():
    found = bootstrap_interval(np.r_[1.0, 2.0, np.nan], "rms")
    assert found.n == 2
    assert found.value == pytest.approx(np.sqrt(2.5))
    assert found.low is None
    assert "fewer than 20" in found.method
    assert bootstrap_interval([np.nan], "rms").value is None


def test_wilson_published():
    # R. G. Newcombe, Statistics in Medicine 17 (1998), table I: 81 of 263 and 0 of 20.
    found = wilson_interval(81, 263)
    assert (found.low, found.high) == (pytest.approx(0.2553, abs=5e-5), pytest.approx(0.3662, abs=5e-5))
    found = wilson_interval(0, 20)
    assert (found.low, found.high) == (pytest.approx(0.0, abs=1e-12), pytest.approx(0.1611, abs=5e-5))
    assert wilson_interval(0, 0).value is None


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm_lies_between_itself_and_bonferroni(p):
    adjusted = holm(p)
    assert np.all(adjusted >= np.array(p) - 1e-15)
    assert np.all(adjusted <= np.minimum(np.array(p) * len(p), 1.0) + 1e-15)
    assert np.all(np.diff(adjusted[np.argsort(p, kind="stable")]) >= 0)
