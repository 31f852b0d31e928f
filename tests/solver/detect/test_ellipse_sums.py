"""The direct fit in closed form, against the one by matrices."""

from __future__ import annotations

import numpy as np
import pytest

from roundel.scenes.geometry.conic import ellipse_points
from roundel.solver.detect.ellipse_sums import direct_fit, sampson
from roundel.solver.fit.ellipse import direct_ellipse
from roundel.solver.fit.ellipse_distance import foot_points


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("noise_px", [0.0, 0.3])
def test_same_as_the_fit_by_matrices(seed, noise_px):
    generator = np.random.default_rng(seed)
    b = generator.uniform(4, 200)
    ellipse = np.array([*generator.uniform(0, 4000, 2), b * generator.uniform(1, 5), b, generator.uniform(0, 180)])
    points = ellipse_points(ellipse, 300)[: generator.integers(120, 300)] + generator.normal(0, noise_px, 2)
    points += generator.normal(0, noise_px, points.shape)
    out = np.zeros(5)
    assert direct_fit(points[:, 0].copy(), points[:, 1].copy(), len(points), out)
    # Both are the minimum of one quadratic form: rounding, enlarged by the arc's condition.
    assert np.abs(out - direct_ellipse(points))[:4].max() < 1e-6 * ellipse[2]


def test_points_that_determine_no_ellipse():
    out, t = np.zeros(5), np.linspace(0, 1, 30)
    assert not direct_fit(t, 2 * t, 30, out)
    assert not direct_fit(t, t, 5, out)
    assert not direct_fit(np.ones(30), np.ones(30), 30, out)


def test_sampson_distance_is_the_distance_of_near_points():
    ellipse = np.array([30.0, 20.0, 12.0, 7.0, 25.0])
    for point in ellipse_points(ellipse, 16) + np.random.default_rng(0).normal(0, 0.1, (16, 2)):
        # First order: the second is the square over the least radius of curvature, 0.1^2 / 4.
        assert sampson(ellipse, *point) == pytest.approx(float(foot_points(ellipse, point[None])[0][0]), abs=0.02)
