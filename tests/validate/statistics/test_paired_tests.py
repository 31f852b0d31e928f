"""Paired comparisons: they pass without a change, fail with one, and report their power correctly."""

import numpy as np
import pytest
from scipy import stats

from roundel.validate.statistics.paired_tests import (
    mcnemar_test,
    mean_ratio_test,
    rate_difference,
    rms_ratio_test,
    shift_test,
    sign_test,
)


def errors(generator, n=600, k=2):
    return generator.normal(size=(n, k))


def test_identical_is_no_loss():
    e = errors(np.random.default_rng(1))
    for test in (rms_ratio_test(e, e, alpha=0.01), shift_test(e[:, 0], e[:, 0], alpha=0.01)):
        assert (test.effect, test.p_value) == (0.0, 1.0)
    assert mcnemar_test(np.ones(9, bool), np.ones(9, bool), alpha=0.01).p_value == 1.0


def test_rms_p_values_are_uniform_without_a_change():
    generator = np.random.default_rng(2)
    p = [rms_ratio_test(errors(generator), errors(generator), alpha=0.01).p_value for _ in range(200)]
    # Kolmogorov-Smirnov at 0.1 %: one false alarm in a thousand seeds, and this seed is fixed.
    assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_a_loss_at_the_stated_power_is_found():
    generator = np.random.default_rng(4)
    alpha = 0.01
    power = rms_ratio_test(errors(generator), errors(generator), alpha=alpha).detectable
    found = 0
    for _ in range(100):
        worse = errors(generator) * np.exp(power)
        found += rms_ratio_test(worse, errors(generator), alpha=alpha).p_value < alpha
    # Promised are 95 of 100; three standard deviations of a binomial are 6.5.
    assert found >= 88


def test_pairing_pays():
    generator = np.random.default_rng(5)
    e = errors(generator, 300)
    noise = 0.3 * errors(generator, 300)
    paired = rms_ratio_test(e + noise, e, alpha=0.01)
    fresh = rms_ratio_test(e + noise, errors(generator, 300), alpha=0.01)
    assert paired.standard_error < 0.5 * fresh.standard_error


def test_a_shift_hides_in_the_rms_and_not_in_the_mean():
    generator = np.random.default_rng(6)
    old, new = errors(generator, 1000, 1)[:, 0], errors(generator, 1000, 1)[:, 0] + 0.25
    assert shift_test(new, old, alpha=0.01).p_value < 1e-4
    assert shift_test(new, old, alpha=0.01).effect == pytest.approx(0.25, abs=3 * np.sqrt(2 / 1000))
    assert rms_ratio_test(new, old, alpha=0.01).p_value > 1e-4


def test_mcnemar_by_hand():
    old, new = np.ones(100, bool), np.ones(100, bool)
    new[:8] = False
    old[8] = False
    # Eight lost, one won: P(8 or more of 9 heads) = 10 / 512.
    test = mcnemar_test(new, old, alpha=0.01)
    assert test.p_value == pytest.approx(10 / 512)
    assert test.effect == pytest.approx(0.07)


def test_mcnemars_power_is_that_of_losses_alone():
    generator = np.random.default_rng(7)
    n = 1000
    rate = mcnemar_test(np.ones(n, bool), np.ones(n, bool), alpha=0.01).detectable
    found = sum(
        mcnemar_test(generator.random(n) >= rate, np.ones(n, bool), alpha=0.01).p_value < 0.01 for _ in range(200)
    )
    # 95 % of 200, less three standard deviations of a binomial.
    assert found >= 190 - 9


@pytest.mark.parametrize(
    ("new", "old", "message"),
    [([1.0], [1.0], "at least two"), ([1.0, 2.0], [1.0], "one shape"), ([1.0, np.nan], [1.0, 1.0], "not finite")],
)
def test_what_cannot_be_compared(new, old, message):
    with pytest.raises(ValueError, match=message):
        rms_ratio_test(new, old, alpha=0.01)


def test_the_linearised_standard_deviation_is_that_of_a_bootstrap():
    generator = np.random.default_rng(8)
    new, old = errors(generator, 300), errors(generator, 300)
    power = [np.sum(v**2, axis=1) for v in (new, old)]

    def log_ratio(a, b, axis):
        return 0.5 * np.log(a.sum(axis=axis) / b.sum(axis=axis))

    drawn = stats.bootstrap(power, log_ratio, paired=True, vectorized=True, method="basic", rng=generator)
    # 9,999 resamples know a standard deviation to 0.7 %; the linearisation errs by the order of 1 / 300.
    assert rms_ratio_test(new, old, alpha=0.01).standard_error == pytest.approx(drawn.standard_error, rel=0.03)


def test_circles_of_one_frame_go_together():
    generator = np.random.default_rng(9)
    new, old = errors(generator, 200), errors(generator, 200)
    # Each row four times, as if a frame had four alike circles: no more is known than before.
    one = rms_ratio_test(new, old, alpha=0.01)
    four = [np.repeat(v, 4, axis=0) for v in (new, old)]
    together = rms_ratio_test(*four, alpha=0.01, clusters=np.repeat(np.arange(200), 4))
    assert together.standard_error == pytest.approx(one.standard_error, rel=1e-12)
    assert together.p_value == pytest.approx(one.p_value, rel=1e-9)
    assert rms_ratio_test(*four, alpha=0.01).standard_error == pytest.approx(one.standard_error / 2, rel=0.01)


def test_a_mean_over_items_is_students_where_each_frame_has_one():
    generator = np.random.default_rng(10)
    a, b, one = generator.normal(0.1, 1, 200), generator.normal(0, 1, 200), np.ones(200)
    found = mean_ratio_test((a, one), (b, one), alpha=0.05)
    expected = stats.ttest_rel(a, b, alternative="greater")
    assert found.p_value == pytest.approx(expected.pvalue, rel=1e-9)
    # A frame whose items one side alone has: the means are over what each has.
    more = mean_ratio_test(
        (np.array([1.0, 4.0]), np.array([1, 2])), (np.array([1.0, 0.0]), np.array([1, 0])), alpha=0.05
    )
    assert more.effect == pytest.approx(5 / 3 - 1)
    with pytest.raises(ValueError, match="no items"):
        mean_ratio_test((a, one), (b, 0 * one), alpha=0.05)


def test_the_sign_test_by_hand():
    old = np.zeros(50, int)
    new = old.copy()
    new[:5] = [1, 1, 3, 1, 1]
    found = sign_test(new, old, alpha=0.01)
    assert (found.p_value, found.effect) == (pytest.approx(1 / 32), pytest.approx(0.1))


@pytest.mark.parametrize(("n", "lost", "won"), [(20, 0.1, 0.1), (48, 0.05, 0.15), (48, 0.01, 0.0), (240, 0.02, 0.03)])
def test_the_interval_of_a_difference_of_rates_covers_it(n: int, lost: float, won: float) -> None:
    """Over all outcomes of n frames that only the first or only the second solves, by their probabilities."""
    b, c = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
    there = b + c <= n
    b, c = b[there], c[there]
    chance = stats.multinomial.pmf(np.stack([b, c, n - b - c], axis=1), n, [lost, won, 1 - lost - won])
    likely = chance > 1e-7
    found = [rate_difference(int(i), int(j), n) for i, j in zip(b[likely], c[likely], strict=True)]
    inside = [(f.low or 0) <= won - lost <= (f.high or 0) for f in found]
    assert 0.94 < float(chance[likely][inside].sum()) <= 1.0
    assert rate_difference(3, 1, 10).value == pytest.approx(-0.2)
