"""Intervals: they have their nominal coverage, and report when they cannot."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from roundel.validate.statistics import intervals
from roundel.validate.statistics.intervals import (
    bootstrap_interval,
    bootstrap_intervals,
    draws,
    holm,
    rate_interval,
    units_of,
    wilson_interval,
)


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
    assert (found.low, found.high) == (0.0, pytest.approx(0.1611, abs=5e-5))
    assert [(wilson_interval(0, n).low, wilson_interval(n, n).high) for n in range(1, 50)] == [(0.0, 1.0)] * 49
    assert wilson_interval(0, 0).value is None


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm_lies_between_itself_and_bonferroni(p):
    adjusted = holm(p)
    assert np.all(adjusted >= np.array(p) - 1e-15)
    assert np.all(adjusted <= np.minimum(np.array(p) * len(p), 1.0) + 1e-15)
    assert np.all(np.diff(adjusted[np.argsort(p, kind="stable")]) >= 0)


@pytest.mark.parametrize("statistic", ["median", "p95", "rms"])
def test_agreement_with_scipy(statistic):
    x = np.random.default_rng(0).gamma(2.0, size=300)
    function = {
        "median": np.median,
        "p95": lambda v, axis: np.percentile(v, 95, axis=axis),
        "rms": lambda v, axis: np.sqrt(np.mean(v**2, axis=axis)),
    }[statistic]
    theirs = stats.bootstrap((x,), function, rng=1, vectorized=True, n_resamples=4999).confidence_interval
    ours = bootstrap_interval(x, statistic)
    width = theirs.high - theirs.low
    # Ends of 2,000 resamples scatter by some 4 % of the width; the jackknife of a median is ragged in both.
    assert abs(ours.low - theirs.low) < 0.15 * width
    assert abs(ours.high - theirs.high) < 0.15 * width


@pytest.mark.parametrize("statistic", ["median", "p95", "rms"])
def test_circles_of_one_frame_are_resampled_together(statistic):
    generator = np.random.default_rng(1)
    inside = width = alone = 0
    truth = {"median": 0.0, "p95": 1.959964 * 2**0.5, "rms": 2**0.5}[statistic]
    for seed in range(60):
        # Half of the variance belongs to the frame.
        values = (generator.normal(size=(80, 1)) + generator.normal(size=(80, 4))).ravel()
        found = bootstrap_interval(values, statistic, clusters=np.repeat(np.arange(80), 4), seed=seed)
        inside += found.low <= truth <= found.high
        width += found.high - found.low
        other = bootstrap_interval(values, statistic, seed=seed)
        alone += other.high - other.low
    # 95 % of 60 are 57, with a standard deviation of 1.7.
    assert inside >= 57 - 4 * 1.7
    assert width > 1.15 * alone


def test_clusters_of_one_are_no_clusters():
    x = np.random.default_rng(2).normal(size=101)
    for statistic in ("median", "p95", "rms"):
        a = bootstrap_interval(x, statistic)
        assert bootstrap_interval(x, statistic, clusters=np.arange(101)[::-1]).low == pytest.approx(a.low, rel=0.2)
    # Frames of unequal size, one of them with nothing finite.
    label = np.repeat(np.arange(40), np.arange(40) % 3 + 1)
    y = np.random.default_rng(3).normal(size=len(label)) + 5
    y[label == 7] = np.nan
    found = bootstrap_intervals([y], clusters=label)[0]
    assert found["median"].n == 39
    assert found["median"].low < found["median"].value < found["median"].high
    assert found["p95"].method == "fewer than 60 frames"


def test_one_sided_resamples_fall_back_to_percentiles():
    # All but a few values are alike: no resample lies below the median, and BCa has nothing to correct by.
    x = np.r_[np.zeros(60), np.arange(1.0, 4.0)]
    found = bootstrap_interval(x, "median")
    assert (found.low, found.high, found.method) == (0.0, 0.0, "percentile")


def test_a_rate_over_frames():
    alone = rate_interval([True, False] * 40, np.arange(80))
    plain = wilson_interval(40, 80)
    assert (alone.low, alone.high) == pytest.approx((plain.low, plain.high))
    # Pairs that go together are worth half as many; pairs that never do are worth no more than they are.
    paired = rate_interval(np.repeat([True, False] * 20, 2), np.repeat(np.arange(40), 2))
    half = wilson_interval(20, 40)
    assert (paired.low, paired.high) == pytest.approx((half.low, half.high), abs=0.005)
    mixed = rate_interval([True, False] * 40, np.repeat(np.arange(40), 2))
    assert (mixed.low, mixed.high) == pytest.approx((plain.low, plain.high))
    # Nothing but successes: each frame counts once.
    assert rate_interval([True] * 80, np.repeat(np.arange(40), 2)).low == pytest.approx(wilson_interval(40, 40).low)
    assert rate_interval([], []).value is None


def test_draws_do_not_depend_on_their_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = np.random.default_rng(0).integers(0, 501, (77, 501))
    monkeypatch.setattr(intervals, "_AT_ONCE", 3000)
    blocks = list(draws(501, 77))
    assert len(blocks) > 10
    np.testing.assert_array_equal(np.concatenate(blocks), whole)


@given(n=st.integers(2, 60), q=st.sampled_from([0.5, 0.95]))
def test_one_value_left_out(n: int, q: float) -> None:
    x = np.sort(np.random.default_rng(n).normal(size=n))
    expected = [np.quantile(np.delete(x, i), q) for i in range(n)]
    np.testing.assert_allclose(intervals._left_out_one(x, q), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("statistic", ["median", "p95", "rms"])
def test_groups_of_very_many_frames_give_the_same_interval(statistic: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # Three circles a frame, alike in each: what is independent are 3,000 frames, in 500 groups for speed.
    frame = np.repeat(np.arange(3000), 3)
    x = np.repeat(np.random.default_rng(4).normal(size=3000), 3) + 3
    alone = bootstrap_interval(x, statistic, clusters=frame)
    monkeypatch.setattr(intervals, "MOST_UNITS", 500)
    grouped = bootstrap_interval(x, statistic, clusters=frame)
    assert (grouped.value, grouped.n) == (alone.value, alone.n)
    # The width has a relative standard error of 1 / sqrt(2 * 500) from the groups and less from the resamples.
    assert grouped.high - grouped.low == pytest.approx(alone.high - alone.low, rel=4 * (1 / 1000) ** 0.5)
    assert set(np.bincount(units_of(np.arange(3000)))) == {6}
