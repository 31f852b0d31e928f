"""Szpak 2015: the guaranteed ellipse as a method, and its confidence band."""

import numpy as np
import pytest
from helpers_circles import circle_scene
from helpers_views import printed, view_of

from roundel.scenes.geometry.conic import ellipse_of_conic, ellipse_points
from roundel.solver.fit.ellipse import EllipseFit
from roundel.solver.fit.ellipse_distance import foot_points
from roundel.solver.fit.guaranteed_fit import guaranteed_ellipse
from roundel.solver.methods.plugin import MethodFailure
from roundel.solver.related.szpak2015 import confidence_band, find

ELLIPSE = np.array([320.0, 240.0, 50.0, 30.0, 25.0])


def fitted(generator, sigma_px=0.2, count=160):
    points = ellipse_points(ELLIPSE, count)
    return guaranteed_ellipse(points + generator.normal(0.0, sigma_px, points.shape))


def inside(band, fit):
    """Whether the true ellipse lies within the band: its distance from each contour point, along the normal."""
    distance = foot_points(ELLIPSE, band.contour_px)[0]
    return bool(np.all(np.abs(distance) <= band.half_width_px))


def test_500_random_ellipses_are_recovered():
    generator = np.random.default_rng(1)
    for _ in range(500):
        scene = circle_scene(generator, np.zeros((1, 2)), np.array([0.5]))
        ellipse = ellipse_of_conic(scene.conics[0])
        fit = guaranteed_ellipse(ellipse_points(ellipse, 40))
        assert isinstance(fit, EllipseFit)
        assert np.abs(fit.ellipse[:4] - ellipse[:4]).max() < 1e-6 * ellipse[2]


def test_the_band_of_the_whole_contour_holds_the_truth():
    """Scheffe's bound: at least 95 % of 300 trials, less three standard deviations of that count."""
    generator = np.random.default_rng(2)
    held = [inside(confidence_band(fit), fit) for fit in (fitted(generator) for _ in range(300))]
    assert np.mean(held) > 0.95 - 3 * np.sqrt(0.95 * 0.05 / 300)
    # It is a bound, but not an empty one: half as wide, it fails.
    generator = np.random.default_rng(2)
    half = [inside(confidence_band(fit, 0.3), fit) for fit in (fitted(generator) for _ in range(300))]
    assert np.mean(half) < 0.8


def test_the_band_of_a_point_holds_it_95_times_in_100():
    generator = np.random.default_rng(3)
    held = []
    for _ in range(300):
        band = confidence_band(fitted(generator), pointwise=True, count=8)
        held.append(np.abs(foot_points(ELLIPSE, band.contour_px)[0]) <= band.half_width_px)
    # Eight points of one contour are not independent: about three are.
    assert abs(np.mean(held) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / (300 * 3))


def test_the_band_grows_with_level_and_noise():
    generator = np.random.default_rng(4)
    fit = fitted(generator)
    assert np.all(confidence_band(fit, 0.99).half_width_px > confidence_band(fit, 0.5).half_width_px)
    noisier = fitted(np.random.default_rng(4), 0.8)
    ratio = confidence_band(noisier).half_width_px / confidence_band(fit).half_width_px
    assert np.all((ratio > 3.0) & (ratio < 5.5))
    band = confidence_band(fit)
    assert np.allclose(np.linalg.norm(band.outer_px - band.inner_px, axis=1), 2 * band.half_width_px)


def test_bad_levels_and_fits_without_covariance_are_refused():
    fit = fitted(np.random.default_rng(5))
    with pytest.raises(ValueError, match="between 0 and 1"):
        confidence_band(fit, 95)
    blind = EllipseFit(fit.ellipse, fit.cov * np.nan, 1.0, 10, fit.shape_cov * np.nan, fit.residual_px)
    with pytest.raises(ValueError, match="no covariance"):
        confidence_band(blind)


def test_it_finds_a_disc_in_an_image():
    scene = circle_scene(
        np.random.default_rng(6),
        np.zeros((1, 2)),
        np.array([0.04]),
        distance=(8, 8),
        focal_px=700.0,
        principal_point=(319.5, 239.5),
        off_axis_deg=8.0,
    )
    (found,) = find(view_of(scene, printed("disc", [0.08])))
    assert np.abs(found.ellipse[:4] - ellipse_of_conic(scene.conics[0])[:4]).max() < 0.1
    with pytest.raises(MethodFailure, match="the printed marker is chessboard"):
        find(view_of(scene, printed("chessboard", [0.08])))
