"""Fits: exact on exact points, the errata's tables under noise, correct covariance, falsy failures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_perimeter_px, ellipse_points
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.fit.ellipse import (
    EllipseFit,
    FailedFit,
    direct_ellipse,
    ellipse_of_shape,
    fit_ellipse,
    shape_of_ellipse,
)
from roundel.solver.fit.ellipse_distance import foot_points
from roundel.solver.pose.circle_pose import poses_from_ellipse

ELLIPSE = np.array([640.3, 359.2, 43.0, 37.0, 20.0])

ellipses = st.tuples(
    st.floats(-500, 1500), st.floats(-500, 1500), st.floats(4, 200), st.floats(0.1, 1.0), st.floats(0, 179)
).map(lambda e: np.array([e[0], e[1], e[2], e[2] * e[3], e[4]]))


@given(ellipses)
def test_exact_points_give_the_ellipse(ellipse):
    points = ellipse_points(ellipse, 40)
    fit = fit_ellipse(points)
    assert fit
    # Points at 1,500 px are rounded to 1e-13 px; the tips of an ellipse of 1:10 magnify that a hundredfold.
    assert np.abs(fit.ellipse[:4] - ellipse[:4]).max() < 1e-8
    assert fit.sigma_px < 1e-9
    assert np.abs(direct_ellipse(points)[:4] - ellipse[:4]).max() < 1e-5


@given(ellipses, st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=20))
def test_foot_points_are_the_nearest(ellipse, offsets):
    points = ellipse[:2] + ellipse[2] * np.array(offsets)
    distance, normal, u = foot_points(ellipse, points)
    feet = points - distance[:, None] * normal
    nearest = np.min(np.linalg.norm(points[:, None] - ellipse_points(ellipse, 3000), axis=-1), axis=1)
    # The brute force can only be farther, by its step.
    assert np.all(np.abs(distance) <= nearest + 1e-9 * ellipse[2])
    assert np.all(np.abs(distance) >= nearest - 2 * np.pi * ellipse[2] / 3000)
    angle = np.radians(ellipse[4])
    local = (feet - ellipse[:2]) @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert np.allclose(np.sum((local / ellipse[2:4]) ** 2, axis=1), 1.0, atol=1e-8)
    assert np.allclose(np.linalg.norm(u, axis=1), 1.0, atol=1e-8)


def test_shape_parameters_round_trip():
    generator = np.random.default_rng(0)
    a = generator.uniform(5, 50, 100)
    ellipse = np.stack(
        [generator.uniform(0, 99, 100), generator.uniform(0, 99, 100), a, a * 0.7, generator.uniform(0, 180, 100)],
        axis=-1,
    )
    assert np.allclose(ellipse_of_shape(shape_of_ellipse(ellipse)), ellipse, atol=1e-11)
    # Exchanged axes are put in order.
    assert np.allclose(ellipse_of_shape(shape_of_ellipse([1, 2, 3, 5, 10])), [1, 2, 5, 3, 100])


def test_minimum_is_a_minimum():
    points = ellipse_points(ELLIPSE, 300) + np.random.default_rng(1).normal(size=(300, 2))
    fit = fit_ellipse(points)
    assert isinstance(fit, EllipseFit)
    best = np.sum(foot_points(fit.ellipse, points)[0] ** 2)
    assert best == pytest.approx(np.sum(fit.residual_px**2), rel=1e-12)
    theta = shape_of_ellipse(fit.ellipse)
    for i in range(5):
        for sign in (-1, 1):
            moved = theta.copy()
            moved[i] += sign * 1e-3
            assert np.sum(foot_points(ellipse_of_shape(moved), points)[0] ** 2) > best


def test_far_from_the_origin_and_any_start():
    points = ellipse_points(ELLIPSE, 100) + np.random.default_rng(2).normal(size=(100, 2))
    near, far = fit_ellipse(points), fit_ellipse(points + 1e6)
    assert isinstance(near, EllipseFit)
    assert isinstance(far, EllipseFit)
    # 1e6 px keeps ten digits behind the point.
    assert np.allclose(far.ellipse[2:], near.ellipse[2:], atol=1e-6)
    rough = fit_ellipse(points, start=ELLIPSE + np.array([5.0, -5.0, 8.0, 3.0, 30.0]))
    assert isinstance(rough, EllipseFit)
    assert np.allclose(rough.ellipse, near.ellipse, atol=1e-5)


def test_covariance_is_that_of_the_trials():
    generator = np.random.default_rng(3)
    truth, squared = shape_of_ellipse(ELLIPSE), []
    for _ in range(300):
        fit = fit_ellipse(ellipse_points(ELLIPSE, 120) + generator.normal(0, 0.3, (120, 2)))
        assert isinstance(fit, EllipseFit)
        difference = shape_of_ellipse(fit.ellipse) - truth
        squared.append(difference @ np.linalg.solve(fit.shape_cov, difference))
        other = fit.ellipse - ELLIPSE
        assert squared[-1] == pytest.approx(other @ np.linalg.solve(fit.cov, other), rel=0.2)  # equal to first order
    # Mean of F(5, 115) times 5 is 5.09, its standard error over 300 trials 0.19.
    assert np.mean(squared) == pytest.approx(5.09, abs=4 * 0.19)


def test_weights_count():
    generator = np.random.default_rng(4)
    sigma = np.where(np.arange(200) % 2, 0.05, 1.0)
    weighted, plain = [], []
    for _ in range(40):
        points = ellipse_points(ELLIPSE, 200) + generator.normal(size=(200, 2)) * sigma[:, None]
        weighted.append(fit_ellipse(points, sigma).ellipse - ELLIPSE)
        plain.append(fit_ellipse(points).ellipse - ELLIPSE)
    # Half the points at 0.05 px against all at 0.7 px: ten times better, of which five are asked.
    assert np.std(weighted, axis=0)[:4].max() < np.std(plain, axis=0)[:4].min() / 5


@pytest.mark.parametrize("loss", ["huber", "tukey"])
def test_robust_loss_ignores_outliers(loss):
    generator = np.random.default_rng(5)
    points = ellipse_points(ELLIPSE, 200) + generator.normal(0, 0.1, (200, 2))
    points[:30] += generator.normal(0, 8.0, (30, 2))
    plain, robust = fit_ellipse(points), fit_ellipse(points, loss=loss)
    assert isinstance(plain, EllipseFit)
    assert isinstance(robust, EllipseFit)
    assert np.abs(robust.ellipse[:4] - ELLIPSE[:4]).max() < 0.1  # four times the noise of a clean fit of 170 points
    assert np.abs(plain.ellipse[:4] - ELLIPSE[:4]).max() > 0.3


@pytest.mark.parametrize("loss", ["huber", "tukey"])
@pytest.mark.parametrize("where", ["anywhere", "on one arc"])
def test_robust_covariance_holds_with_a_fifth_of_outliers(loss, where):
    generator = np.random.default_rng(6)
    truth, squared = shape_of_ellipse(ELLIPSE), []
    for _ in range(120):
        points = ellipse_points(ELLIPSE, 200) + generator.normal(0, 0.2, (200, 2))
        outliers = generator.permutation(200)[:40] if where == "anywhere" else np.arange(40)
        points[outliers] += generator.normal(0, 4.0, (40, 2))  # twenty sigmas
        fit = fit_ellipse(points, loss=loss, tolerance=1e-5)
        assert isinstance(fit, EllipseFit)
        difference = shape_of_ellipse(fit.ellipse) - truth
        squared.append(difference @ np.linalg.solve(fit.shape_cov, difference))
        # The scale is that of the good points, or twice it where Huber's loss lets the outliers of an arc bend the fit;
        # with all of them it would be 1.8 px.
        assert 0.15 < fit.sigma_px < 0.5
    # Chi-square of 5: standard error sqrt(10 / 120) = 0.29, four of those. The sandwich is itself estimated, from a few
    # outliers: the expectation is 5.09 as for the plain fit, and up to half of one more was seen.
    assert 5.09 - 4 * 0.29 < np.mean(squared) < 5.6 + 4 * 0.29


def test_robust_loss_costs_little_where_there_are_no_outliers():
    generator = np.random.default_rng(7)
    truth, squared = shape_of_ellipse(ELLIPSE), []
    for _ in range(120):
        fit = fit_ellipse(ellipse_points(ELLIPSE, 200) + generator.normal(0, 0.2, (200, 2)), loss="huber")
        assert isinstance(fit, EllipseFit)
        difference = shape_of_ellipse(fit.ellipse) - truth
        squared.append(difference @ np.linalg.solve(fit.shape_cov, difference))
    assert np.mean(squared) == pytest.approx(5.09, abs=4 * 0.29)


def test_weights_count_in_the_robust_loss_too():
    generator = np.random.default_rng(8)
    sigma = np.where(np.arange(200) % 2, 0.05, 2.0)  # a poor point is no outlier: its residual is as it was declared
    points = ellipse_points(ELLIPSE, 200) + generator.normal(size=(200, 2)) * sigma[:, None]
    fit, plain = fit_ellipse(points, sigma, loss="tukey"), fit_ellipse(points, sigma)
    assert isinstance(fit, EllipseFit)
    assert isinstance(plain, EllipseFit)
    assert np.abs(fit.ellipse[:4] - plain.ellipse[:4]).max() < 0.02  # the good points' own error
    assert fit.sigma_px == pytest.approx(plain.sigma_px, rel=0.3)


LINE = np.stack([np.arange(10.0), np.arange(10.0)], axis=1)
CORNERS = np.array([[0, 0], [4, 0], [4, 2], [0, 2.0]])


@pytest.mark.parametrize("fit", [fit_ellipse, direct_ellipse])
@pytest.mark.parametrize(
    ("points", "says"),
    [
        (np.zeros((10, 2)), "coincide"),
        (np.full((10, 2), 1e-200), "coincide"),
        (1e9 + 1e-3 * np.random.default_rng(0).normal(size=(10, 2)), "coincide"),
        (LINE, "line"),
        (LINE * 1e9, "line"),
        (np.stack([np.arange(10.0), np.zeros(10)], axis=1), "line"),
        (np.zeros((3, 2)), "only 3 points"),
        (ellipse_points(ELLIPSE, 5), "only 5 points"),
        (np.tile(CORNERS, (5, 1)), "only 4 distinct points"),
        (np.tile(ellipse_points(ELLIPSE, 5), (2, 1)), "only 5 distinct points"),
        (np.zeros((0, 2)), "only 0 points"),
        (np.full((9, 2), np.nan), "not finite"),
        (np.vstack([ellipse_points(ELLIPSE, 9), [[np.inf, 0.0]]]), "not finite"),
        (1e200 * ellipse_points(ELLIPSE, 9), "beyond"),
        (np.zeros(4), "array"),
        (np.zeros((9, 3)), "array"),
        ([["a", "b"]] * 9, "numbers"),
        ([[1, 2], [3]], "numbers"),
    ],
)
def test_failures_are_falsy_and_say_why(fit, points, says):
    failed = fit(points)
    assert isinstance(failed, FailedFit)
    assert not failed
    assert says in failed.reason


def test_an_open_curve_has_no_ellipse():
    failed = fit_ellipse(np.stack([np.arange(10.0), np.arange(10.0) ** 2], axis=1))
    assert isinstance(failed, FailedFit)
    assert "without bound" in failed.reason


@pytest.mark.parametrize("sigma", [0.0, np.zeros(20), np.full(20, np.nan), -np.ones(20), np.r_[np.ones(19), np.inf]])
def test_sigmas_that_are_none(sigma):
    failed = fit_ellipse(ellipse_points(ELLIPSE, 20), sigma_px=sigma)
    assert isinstance(failed, FailedFit)
    assert "positive and finite" in failed.reason


def test_other_wrong_arguments():
    points = ellipse_points(ELLIPSE, 20)
    assert "one number per point" in fit_ellipse(points, sigma_px=np.ones(7)).reason
    assert "start" in fit_ellipse(points, start=[1, 2, 3, -1, 0]).reason
    assert "start" in fit_ellipse(points, start=[1, 2, 3]).reason
    with pytest.raises(ValueError, match="unknown loss"):
        fit_ellipse(points, loss="cauchy")  # type: ignore[arg-type]


@pytest.mark.parametrize(("offset", "size"), [(1e9, 1e3), (-1e9, 1.0), (0.0, 1e-6), (0.0, 1e6)])
def test_huge_and_tiny_coordinates(offset, size):
    ellipse = np.array([offset, offset, 40.0 * size, 30.0 * size, 20.0])
    fit = fit_ellipse(ellipse_points(ellipse, 100))
    assert isinstance(fit, EllipseFit)
    # What the coordinates have for digits, and ten times that.
    assert np.abs(fit.ellipse[:4] - ellipse[:4]).max() < 1e-15 * abs(offset) + 1e-11 * size


# Errata, section 5: mean over 300 trials, maximum likelihood, oracle, sigma 1 px, N = perimeter.
NORMAL_DEG = {
    (15, 15): 1.11,
    (15, 30): 0.54,
    (15, 45): 0.40,
    (30, 30): 1.52,
    (50, 15): 6.77,
    (50, 30): 3.51,
    (50, 45): 2.35,
}
POSITION_D = {(15, 30): 0.031, (30, 30): 0.181, (50, 30): 0.683}


@pytest.mark.parametrize(("distance", "tilt"), NORMAL_DEG)
def test_published_errors(distance, tilt):
    k = np.array([[1280.0, 0.0, 639.5], [0.0, 1280.0, 359.5], [0.0, 0.0, 1.0]])
    generator = np.random.default_rng(distance + tilt)
    normal, centre = normal_of(tilt, 90.0), np.array([0.0, 0.0, float(distance)])
    ellipse = ellipse_of_conic(conic_of_circle(camera_from_marker_of(normal, centre), 0.5, k))
    contour = ellipse_points(ellipse, round(float(ellipse_perimeter_px(ellipse))))
    fits = [fit_ellipse(contour + generator.normal(size=contour.shape)) for _ in range(300)]
    assert all(fits)
    poses = poses_from_ellipse(np.stack([fit.ellipse for fit in fits if isinstance(fit, EllipseFit)]), k, 0.5)
    angles = angle_deg(poses.normal, normal)
    best = np.argmin(angles, axis=1)
    errors = np.take_along_axis(angles, best[:, None], axis=1)[:, 0]
    # Both means have the standard error of 300 trials: about 3 % of the value, 4.5 % together; 4 of those.
    assert np.mean(errors) == pytest.approx(NORMAL_DEG[distance, tilt], rel=0.18)
    if (distance, tilt) in POSITION_D:
        off = np.linalg.norm(poses.centre_m[np.arange(300), best] - centre, axis=1)
        assert np.mean(off) == pytest.approx(POSITION_D[distance, tilt], rel=0.18)
