"""Noisy edge points to poses, with many trials: the bound is reached, and the regions have their coverage."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from roundel.scenes.geometry.conic import ellipse_points
from roundel.solver.fit.ellipse import ellipse_of_shape, fit_ellipse
from roundel.solver.theory.curvature_bias import without_curvature_bias


@pytest.fixture(scope="module")
def monte_carlo():
    path = Path(__file__).resolve().parents[3] / "benchmarks" / "solver" / "monte_carlo.py"
    spec = importlib.util.spec_from_file_location("monte_carlo", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["monte_carlo"] = module  # dataclasses look their own module up
    spec.loader.exec_module(module)
    yield module
    del sys.modules["monte_carlo"]


def test_the_batch_fits_as_the_solver_does(monte_carlo):
    ellipse = np.array([700.0, 300.0, 20.0, 14.0, 30.0])
    points = monte_carlo.noisy_points(ellipse, 90, 0.7, 20, np.random.default_rng(0))
    theta, cov, settled = monte_carlo.fit_many(points, ellipse)
    assert settled.all()
    for i, own in enumerate(points):
        fit = fit_ellipse(own)
        # Both stop at steps of 1e-7 or less of the ellipse, the digits doubling: far below the noise of 0.1 px.
        assert np.allclose(ellipse_of_shape(theta[i]), fit.ellipse, rtol=0, atol=1e-4)
        assert np.allclose(cov[i], fit.shape_cov, rtol=1e-3, atol=1e-6)


def test_the_batch_takes_out_the_bias_as_the_solver_does(monte_carlo):
    ellipse = np.array([700.0, 300.0, 20.0, 14.0, 30.0])
    points = monte_carlo.noisy_points(ellipse, 90, 0.7, 5, np.random.default_rng(0))
    theta, _, _ = monte_carlo.fit_many(points, ellipse)
    for own, less in zip(points, monte_carlo.less_bias(theta, points), strict=True):
        assert np.allclose(without_curvature_bias(fit_ellipse(own), own).ellipse, ellipse_of_shape(less), atol=1e-4)


@pytest.mark.slow
def test_isotropic_noise_enlarges_the_fit_and_the_correction_does_not(monte_carlo):
    ellipse = np.array([700.0, 300.0, 20.0, 10.0, 30.0])
    points = monte_carlo.noisy_points(ellipse, 100, 1.0, 2000, np.random.default_rng(0))
    theta, _, _ = monte_carlo.fit_many(points, ellipse)
    plain, less = (
        ellipse_of_shape(t)[:, 2:4].mean(axis=0) - ellipse[2:4] for t in (theta, monte_carlo.less_bias(theta, points))
    )
    # Standard error of a mean semi-axis 0.004 px; of 0.1 px the next order leaves (k sigma)^2, 0.04, a few times.
    assert plain[0] > 0.08  # the sharp ends carry most of it
    assert np.all(np.abs(less) < 0.02)


def test_points_lie_on_the_contour_evenly(monte_carlo):
    ellipse = np.array([700.0, 300.0, 20.0, 5.0, 30.0])
    (points,) = monte_carlo.noisy_points(ellipse, 100, 0.0, 1, np.random.default_rng(0))
    dense = ellipse_points(ellipse, 100_000)
    apart = np.min(np.linalg.norm(points[:, None] - dense[None, ::10], axis=2), axis=1)
    assert np.max(apart) < 0.01  # the dense points are 0.01 px apart
    chord = np.linalg.norm(points - np.roll(points, 1, 0), axis=1)
    assert np.min(chord) > 0.96 * np.max(chord)  # an arc's chord is shorter at the sharp ends


@pytest.mark.slow
@pytest.mark.parametrize(
    ("view", "azimuth", "tilt", "distance", "sigma", "points"),
    [
        ("on axis", 30.0, 15.0, 15.0, 1.0, "perimeter"),
        ("on axis", 30.0, 30.0, 30.0, 1.0, "200"),
        ("off axis", 26.6, 15.0, 30.0, 1.0, "200"),
        ("off axis", 116.6, 45.0, 50.0, 0.1, "perimeter"),
    ],
)
def test_the_bound_is_reached_and_the_regions_hold(monte_carlo, view, azimuth, tilt, distance, sigma, points):
    case = monte_carlo.Case(view, azimuth, tilt, distance, sigma, points, judged=True)
    outcome = monte_carlo.run(case, 2000, seed=1)
    assert outcome.failed == 0
    # The ratio of 2,000 runs has a standard error of 0.013, coverage one of 0.005.
    assert 0.95 < outcome.std_normal < 1.05
    assert 0.95 < outcome.std_position < 1.05
    assert 0.93 <= outcome.covered_normal <= 0.97
    assert 0.93 <= outcome.covered_position <= 0.97
