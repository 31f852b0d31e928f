"""Standard deviations of log f: of a closed form, and of a least sum of squares."""

import math

import numpy as np
import pytest

from roundel.solver.fit.ellipse import shape_of_ellipse
from roundel.solver.pose.focal_uncertainty import log_focal_sigma, profiled_focal

ELLIPSES = np.array([[10.0, 20.0, 30.0, 20.0, 40.0], [100.0, -20.0, 25.0, 20.0, 10.0]])


def test_a_linear_perspective_has_the_standard_deviation_of_its_inverse():
    """1 / f = (x1 - x2) / -90000: the standard deviation of the difference of two centres, over 90 px."""
    covs = np.array([np.diag([0.09, 1.0, 1.0, 1.0, 1.0]), np.diag([0.16, 4.0, 1.0, 1.0, 1.0])])
    sigma = log_focal_sigma(lambda e: 90000.0 / (e[1, 0] - e[0, 0]), ELLIPSES, covs)
    share = math.sqrt(0.09 + 0.16) / 90.0
    assert sigma == pytest.approx(-math.log(1 - 1.96 * share) / 1.96, rel=1e-9)


def test_a_bent_one_has_more():
    """1 / f with a square term: the variance a^2 + 2 b^2 and the bias b of a normal distribution, by 200,000 draws."""
    curve = 0.3

    def focal(ellipses):
        x = ellipses[0, 0] - 10.0
        return 1.0 / (1.0 + 0.05 * x + curve * x * x * 0.1)

    cov = np.zeros((2, 5, 5))
    cov[:, range(5), range(5)] = 1e-12
    cov[0, 0, 0] = 1.0
    x = np.random.default_rng(1).normal(size=200_000)
    drawn = 0.05 * x + curve * 0.1 * x * x
    share = math.sqrt(np.mean(drawn**2))
    found = log_focal_sigma(focal, ELLIPSES, cov)
    assert found == pytest.approx(-math.log(1 - 1.96 * share) / 1.96, rel=0.02)


def test_a_closed_form_that_one_standard_deviation_breaks_determines_nothing():
    def focal(ellipses):
        if ellipses[0, 2] > 30.5:
            raise ValueError("no focal length fits")
        return 800.0

    assert log_focal_sigma(focal, ELLIPSES, np.array([np.eye(5)] * 2)) == math.inf
    assert (
        log_focal_sigma(lambda e: 1.0 / (1.0 + e[0, 0] - 10.0), ELLIPSES, np.array([np.eye(5)] * 2) * 0.5) == math.inf
    )
    assert shape_of_ellipse(ELLIPSES).shape == (2, 5)


def test_the_profile_of_a_parabola_in_the_inverse():
    """chi2 = ((1/f - 1/800) / s)^2: 95 % end at 1 - 1.96 share."""
    share = 0.1
    found = profiled_focal(lambda log_f: ((800.0 * math.exp(-log_f) - 1.0) / share) ** 2, math.log(900.0), 0.05)
    assert found is not None
    assert found.focal_px == pytest.approx(800.0, rel=1e-3)
    assert found.sigma == pytest.approx(-math.log(1 - 1.96 * share) / 1.96, rel=0.03)


def test_a_flat_profile_determines_nothing():
    assert profiled_focal(lambda log_f: 1.0 + 1e-3 * log_f**2, math.log(900.0), 0.1) is None
    assert profiled_focal(lambda log_f: -log_f, math.log(900.0), 0.1) is None
