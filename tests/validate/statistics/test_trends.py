"""Slopes, means and ratios: against a bootstrap over frames, against planted laws, and without usable frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.validate.statistics.trends import Estimate, decide, decide_all, log_ratio, log_slope, mean_of


def planted(slope: float, n: int = 240, seed: int = 0, spread: float = 1.0) -> tuple[np.ndarray, ...]:
    """Half-normal errors, their distances, two strata (the second twice as large) and the frames."""
    rng = np.random.default_rng(seed)
    at, stratum = rng.uniform(15, 50, n), np.arange(n) % 2
    noise = np.exp(spread * rng.normal(size=n)) if spread else np.ones(n)
    return at**slope * (1 + stratum) * noise, at, stratum, np.arange(n)


@given(slope=st.floats(-3, 3))
def test_a_law_without_noise_is_found_to_rounding(slope: float) -> None:
    values, at, stratum, frame = planted(slope, n=24, spread=0.0)
    found = log_slope(values, at, stratum, frame)
    assert found is not None
    assert found.value == pytest.approx(slope, abs=1e-8)
    assert found.error < 1e-8
    ratio = log_ratio(values, at, stratum, frame, 1, 0)
    assert ratio is not None
    assert np.exp(ratio.value) == pytest.approx(2.0, rel=1e-8)


@pytest.mark.parametrize("statistic", ["slope", "ratio", "mean"])
def test_the_spread_is_that_of_a_bootstrap_over_frames(statistic: str) -> None:
    values, at, stratum, frame = planted(1.5, spread=0.5)

    def of(rows: np.ndarray) -> Estimate:
        # Drawn frames are frames of their own.
        v, a, s, f = values[rows], at[rows], stratum[rows], frame
        found = {"slope": lambda: log_slope(v, a, s, f), "ratio": lambda: log_ratio(v, a, s, f, 1, 0)}
        estimate = found.get(statistic, lambda: mean_of(v, f))()
        assert estimate is not None
        return estimate

    rng = np.random.default_rng(1)
    draws = [of(rng.integers(0, len(values), len(values))).value for _ in range(400)]
    # 400 draws know a standard deviation to 3.5 %; three of these.
    assert of(frame).error == pytest.approx(np.std(draws, ddof=1), rel=0.11)


def test_intervals_cover_as_often_as_they_say() -> None:
    hits = 0
    for seed in range(400):
        values, at, stratum, frame = planted(1.5, n=60, seed=seed, spread=0.7)
        found = log_slope(values, at, stratum, frame)
        assert found is not None
        low, high = found.interval()
        hits += low <= 1.5 <= high
    # 95 % of 400 is 380; the binomial's standard error is 4.4, and 60 skewed frames cost a percent.
    assert hits >= 380 - 3 * 4.4 - 4


def test_circles_of_one_frame_are_one_draw() -> None:
    values, at, stratum, frame = planted(1.0, n=40)
    once = log_slope(values, at, stratum, frame)
    thrice = log_slope(*(np.tile(x, 3) for x in (values, at, stratum, frame)))
    assert once is not None
    assert thrice is not None
    assert thrice.value == pytest.approx(once.value, abs=1e-9)
    assert thrice.error == pytest.approx(once.error, rel=1e-9)
    alone, triple = mean_of(values, frame), mean_of(np.tile(values, 3), np.tile(frame, 3))
    assert alone is not None
    assert triple is not None
    assert triple.error == pytest.approx(alone.error, rel=1e-12)


def test_differences_of_the_same_frames_are_paired() -> None:
    values, _, _, frame = planted(0.0)
    a, b = mean_of(values + 0.25, frame), mean_of(values, frame)
    assert a is not None
    assert b is not None
    assert (a - b).value == pytest.approx(0.25)
    assert (a - b).error < 1e-12
    assert a.error > 0.01
    ratio = a.over(b)
    assert ratio.value == pytest.approx(a.value / b.value)
    # The delta method is the logarithm's by another road.
    assert ratio.error / ratio.value == pytest.approx((a.log() - b.log()).error, rel=1e-9)


@pytest.mark.parametrize(
    ("values", "at", "stratum"),
    [
        ([1.0, 2.0], [15.0, 50.0], [0, 0]),  # as many coefficients as frames
        ([1.0, 2.0, 3.0, 4.0], [15.0] * 4, [0] * 4),  # one distance
        ([0.0] * 4, [15.0, 20.0, 30.0, 50.0], [0] * 4),  # no error at all
        ([np.nan] * 4, [15.0, 20.0, 30.0, 50.0], [0] * 4),
        ([1.0, 2.0, 3.0, 4.0], [15.0, 15.0, 50.0, 50.0], [0, 0, 1, 1]),  # distance and stratum say the same
    ],
)
def test_what_has_no_slope_has_none(values: list, at: list, stratum: list) -> None:
    assert log_slope(np.array(values), np.array(at), np.array(stratum), np.arange(len(values))) is None


def test_a_stratum_without_errors_has_no_ratio() -> None:
    values, at, stratum, frame = planted(1.0, n=20)
    assert log_ratio(np.where(stratum == 1, np.nan, values), at, stratum, frame, 1, 0) is None
    assert mean_of(np.array([1.0, np.nan]), np.arange(2)) is None


def exact(value: float, error: float) -> Estimate:
    return Estimate(value, np.array([error]), 1000, 1000)


def test_a_decision_is_two_sided_and_of_the_nearest_border() -> None:
    inside = decide(exact(0.0, 0.05), -0.1, 0.1)
    assert inside.inside
    # Both borders lie two standard errors off: twice the tail beyond 2, and not its sum over both.
    assert inside.p == pytest.approx(2 * 0.0228, abs=2e-3)
    outside = decide(exact(0.2, 0.05), -0.1, 0.1)
    assert not outside.inside
    assert outside.p == pytest.approx(inside.p)
    assert decide(exact(0.1, 0.05), 0.1).p == 1.0
    # Without noise the border itself decides nothing.
    assert decide(exact(0.1, 0.0), 0.1).p == 1.0
    assert decide(exact(0.2, 0.0), 0.1).p == 0.0


def test_all_are_inside_if_the_least_sure_one_is_and_one_outside_is_enough() -> None:
    sure, unsure = exact(1.0, 0.1), exact(0.3, 0.1)
    assert decide_all([sure, unsure], 0.1).estimate is unsure
    assert decide_all([sure, unsure], 0.1).p == decide(unsure, 0.1).p
    refused = decide_all([sure, exact(-0.3, 0.1)], 0.1)
    assert not refused.inside
    assert refused.p == pytest.approx(2 * decide(exact(-0.3, 0.1), 0.1).p)
    # Where every p is zero the nearest to the border is named.
    assert decide_all([exact(9.0, 0.0), exact(2.0, 0.0)], 0.1).estimate.value == 2.0
