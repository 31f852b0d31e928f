"""Fusing a prior of the focal length with a measurement."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.camera.focal_fusion import fused_focal_px

FOCAL = st.floats(100, 10_000)
SIGMA = st.floats(1e-4, 2.0)


@given(FOCAL, SIGMA, FOCAL, SIGMA)
def test_the_product_of_two_normal_distributions_of_log_f(prior, prior_sigma, focal, sigma):
    fused, left = fused_focal_px(prior, prior_sigma, focal, sigma * focal)
    assert 1 / left**2 == pytest.approx(1 / prior_sigma**2 + 1 / sigma**2, rel=1e-9)
    weighted = math.log(prior) / prior_sigma**2 + math.log(focal) / sigma**2
    assert math.log(fused) == pytest.approx(weighted * left**2, rel=1e-9)


@given(FOCAL, SIGMA, FOCAL, SIGMA)
def test_it_is_symmetric(prior, prior_sigma, focal, sigma):
    one = fused_focal_px(prior, prior_sigma, focal, sigma * focal)
    other = fused_focal_px(focal, sigma, prior, prior_sigma * prior)
    assert one == pytest.approx(other, rel=1e-9)


@pytest.mark.parametrize(
    ("sigma", "focal", "focal_sigma"), [(0.0, 900.0, 1.0), (0.1, math.nan, 1.0), (0.1, -5.0, 1.0), (0.1, 900, math.inf)]
)
def test_an_exact_prior_and_an_empty_measurement_leave_the_prior(sigma, focal, focal_sigma):
    assert fused_focal_px(1000.0, sigma, focal, focal_sigma) == (1000.0, sigma)


def test_an_exact_measurement_replaces_the_prior():
    assert fused_focal_px(1000.0, 0.1, 900.0, 0.0) == (900.0, 0.0)
