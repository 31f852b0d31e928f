"""The guaranteed fit: always an ellipse, within a known distance of the geometric one, with a correct covariance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.geometry.conic import ellipse_points
from roundel.solver.fit.ellipse import EllipseFit, FailedFit, fit_ellipse, shape_of_ellipse
from roundel.solver.fit.ellipse_distance import foot_points
from roundel.solver.fit.guaranteed_fit import guaranteed_ellipse

ELLIPSE = np.array([640.3, 359.2, 43.0, 27.0, 20.0])
NEAR_CIRCLE = np.array([640.3, 359.2, 40.0, 39.9, 70.0])

ellipses = st.tuples(
    st.floats(-500, 1500), st.floats(-500, 1500), st.floats(4, 200), st.floats(0.1, 1.0), st.floats(0, 179)
).map(lambda e: np.array([e[0], e[1], e[2], e[2] * e[3], e[4]]))


def noisy(generator, ellipse, count, sigma, arc=1.0):
    return ellipse_points(ellipse, round(count / arc))[:count] + generator.normal(0, sigma, (count, 2))


@given(ellipses)
def test_exact_points_give_the_ellipse(ellipse):
    fit = guaranteed_ellipse(ellipse_points(ellipse, 40))
    assert isinstance(fit, EllipseFit)
    # As for the geometric fit: 1,500 px are rounded to 1e-13 px, magnified a hundredfold at the tips.
    assert np.abs(shape_of_ellipse(fit.ellipse) - shape_of_ellipse(ellipse)).max() < 1e-8
    assert fit.sigma_px < 1e-9


@given(st.integers(6, 12), st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_any_points_at_all_give_an_ellipse(count, seed, flatness):
    """Points in a box, squeezed toward a line."""
    points = np.random.default_rng(seed).normal(size=(count, 2)) * [30.0, 30.0 * flatness + 0.1] + 300
    check_ellipse(guaranteed_ellipse(points))


X = np.linspace(0.2, 5, 30)
SHAPES = {
    "arc of 10 degrees": lambda g: noisy(g, ELLIPSE, 100, 0.1, 1 / 36),
    "arc of 40 degrees": lambda g: noisy(g, ELLIPSE, 100, 0.3, 1 / 9),
    "nearly straight": lambda g: np.column_stack([np.linspace(0, 100, 50), g.normal(0, 0.1, 50)]),
    "parabola": lambda g: np.column_stack([X, X**2]) + g.normal(0, 0.05, (30, 2)),
    "hyperbola": lambda g: np.column_stack([X, 1 / X]) + g.normal(0, 0.01, (30, 2)),
    "exact parabola": lambda g: np.column_stack([X, X**2]) + g.normal(0, 100.0, 2),
    "far away": lambda g: 1e9 + 1e3 * g.normal(size=(20, 2)),
    "six points": lambda g: noisy(g, ELLIPSE, 6, 1.0),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_what_is_no_ellipse_gets_one_all_the_same(shape):
    generator = np.random.default_rng(1)
    for _ in range(10):
        check_ellipse(guaranteed_ellipse(SHAPES[shape](generator)))


def check_ellipse(fit):
    assert isinstance(fit, EllipseFit), fit
    assert np.all(np.isfinite(fit.ellipse))
    assert fit.ellipse[2] >= fit.ellipse[3] > 0
    assert np.all(np.isfinite(fit.shape_cov))
    assert np.all(np.diag(fit.shape_cov) > 0)
    assert np.all(np.isfinite(fit.residual_px))


def test_an_open_arc_says_how_little_it_knows():
    """A parabola's far end is anywhere: the semi-axis is uncertain by its own size or more."""
    fit = guaranteed_ellipse(SHAPES["parabola"](np.random.default_rng(2)))
    assert isinstance(fit, EllipseFit)
    assert np.sqrt(fit.cov[2, 2]) > 0.5 * fit.ellipse[2]


@pytest.mark.parametrize("ellipse", [ELLIPSE, NEAR_CIRCLE])
@pytest.mark.parametrize(("sigma", "arc"), [(0.3, 1.0), (0.3, 0.5)])
def test_covariance_is_that_of_the_trials(ellipse, sigma, arc):
    generator = np.random.default_rng(4)
    truth, squared = shape_of_ellipse(ellipse), []
    for _ in range(300):
        fit = guaranteed_ellipse(noisy(generator, ellipse, 120, sigma, arc))
        assert isinstance(fit, EllipseFit)
        assert fit.sigma_px == pytest.approx(sigma, rel=0.35)  # 1 / sqrt(230), five of them
        # Near a circle the angle has no bound: the shape's covariance is regular, and it is what is compared.
        difference = shape_of_ellipse(fit.ellipse) - truth
        squared.append(difference @ np.linalg.solve(fit.shape_cov, difference))
    # Mean of 5 F(5, 115) is 5.09, its standard error over 300 trials 0.19; the bias below adds less than 0.1.
    assert np.mean(squared) == pytest.approx(5.1, abs=4 * 0.19)


def test_ellipse_covariance_belongs_to_the_shape_covariance():
    fit = guaranteed_ellipse(noisy(np.random.default_rng(5), ELLIPSE, 100, 0.1))
    other = fit_ellipse(noisy(np.random.default_rng(5), ELLIPSE, 100, 0.1))
    assert isinstance(fit, EllipseFit)
    assert isinstance(other, EllipseFit)
    # Same points, both fits: covariances agree to the ratio of noise to radius of curvature, 0.1 / 17 px.
    for name in ("cov", "shape_cov"):
        one, two = getattr(fit, name), getattr(other, name)
        scale = np.sqrt(np.outer(np.diag(two), np.diag(two)))
        assert np.abs((one - two) / scale).max() < 0.03
    assert np.allclose(fit.residual_px, other.residual_px, atol=0.01)
    assert np.allclose(fit.residual_px, foot_points(fit.ellipse, noisy(np.random.default_rng(5), ELLIPSE, 100, 0.1))[0])


def test_it_agrees_with_the_geometric_fit_within_a_fraction_of_sigma():
    generator = np.random.default_rng(6)
    for arc, limit in ((1.0, 0.05), (0.4, 0.1)):
        for _ in range(40):
            points = noisy(generator, ELLIPSE, 100, 0.2, arc)
            guaranteed, geometric = guaranteed_ellipse(points), fit_ellipse(points)
            assert isinstance(guaranteed, EllipseFit)
            assert isinstance(geometric, EllipseFit)
            apart = shape_of_ellipse(guaranteed.ellipse) - shape_of_ellipse(geometric.ellipse)
            # Squared, in units of the covariance, all five together: 0.05 is a tenth of a sigma each.
            assert apart @ np.linalg.solve(geometric.shape_cov, apart) < limit


@pytest.mark.parametrize("radius", [12.8, 40.0])
def test_the_difference_is_the_curvature_of_sampsons_distance(radius):
    """d (1 - d / 2 rho) instead of d: circles come out smaller by 3/2 sigma^2 / rho than by orthogonal distances."""
    generator = np.random.default_rng(7)
    circle, apart = np.array([0, 0, radius, radius, 0]), []
    for _ in range(200):
        points = noisy(generator, circle, 80, 1.0)
        guaranteed, geometric = guaranteed_ellipse(points), fit_ellipse(points)
        apart.append(np.mean(guaranteed.ellipse[2:4]) - np.mean(geometric.ellipse[2:4]))
    # Next order: sigma / rho of it, at most 8 %; the scatter of sigma^2 itself, 1 % over 200 trials.
    assert np.mean(apart) == pytest.approx(-1.5 / radius, rel=0.12)


def test_weights_count():
    generator = np.random.default_rng(8)
    sigma = np.where(np.arange(200) % 2, 0.05, 1.0)
    squared, plain, weighted = [], [], []
    for _ in range(60):
        points = ellipse_points(ELLIPSE, 200) + generator.normal(size=(200, 2)) * sigma[:, None]
        fit = guaranteed_ellipse(points, sigma)
        difference = shape_of_ellipse(fit.ellipse) - shape_of_ellipse(ELLIPSE)
        squared.append(difference @ np.linalg.solve(fit.shape_cov, difference))
        weighted.append(fit.ellipse - ELLIPSE)
        plain.append(guaranteed_ellipse(points).ellipse - ELLIPSE)
    assert np.std(weighted, axis=0)[:4].max() < np.std(plain, axis=0)[:4].min() / 5
    # Standard error sqrt(10 / 60) = 0.41, four of those.
    assert np.mean(squared) == pytest.approx(5.05, abs=1.64)


def test_equal_sigmas_change_nothing():
    points = noisy(np.random.default_rng(9), ELLIPSE, 50, 0.3)
    one, two = guaranteed_ellipse(points), guaranteed_ellipse(points, 7.0)
    assert isinstance(one, EllipseFit)
    assert isinstance(two, EllipseFit)
    assert np.allclose(one.ellipse, two.ellipse, rtol=1e-12)
    assert np.allclose(one.shape_cov, two.shape_cov, rtol=1e-9)
    assert one.sigma_px == pytest.approx(two.sigma_px, rel=1e-9)


@given(st.floats(0, 180), st.floats(-1e4, 1e4), st.floats(0.01, 100))
def test_the_answer_moves_with_the_points(turn_deg, shift, scale):
    """A similarity of the points is one of the ellipse: what the centring and turning inside must not disturb."""
    points = noisy(np.random.default_rng(10), np.array([0, 0, 40.0, 25.0, 30.0]), 60, 0.3)
    angle = np.radians(turn_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    one, two = guaranteed_ellipse(points), guaranteed_ellipse(scale * points @ turn.T + shift)
    assert isinstance(one, EllipseFit)
    assert isinstance(two, EllipseFit)
    assert np.allclose(two.ellipse[2:4], scale * one.ellipse[2:4], rtol=1e-6)
    assert np.allclose(two.ellipse[:2], scale * turn @ one.ellipse[:2] + shift, atol=1e-6 * scale + 1e-9)
    assert np.allclose(two.cov[:, :][2:4, 2:4], scale**2 * one.cov[2:4, 2:4], rtol=1e-4)


@pytest.mark.parametrize(
    ("points", "sigma", "says"),
    [
        (np.zeros((10, 2)), None, "coincide"),
        (np.column_stack([np.arange(10.0), np.arange(10.0)]), None, "line"),
        (ellipse_points(ELLIPSE, 5), None, "only 5 points"),
        (np.full((9, 2), np.nan), None, "not finite"),
        (1e300 * ellipse_points(ELLIPSE, 9), None, "beyond"),
        (np.zeros(4), None, "array"),
        (ellipse_points(ELLIPSE, 9), np.zeros(9), "positive and finite"),
        (ellipse_points(ELLIPSE, 9), np.ones(8), "one number per point"),
    ],
)
def test_failures_are_falsy_and_say_why(points, sigma, says):
    failed = guaranteed_ellipse(points, sigma)
    assert isinstance(failed, FailedFit)
    assert not failed
    assert says in failed.reason
