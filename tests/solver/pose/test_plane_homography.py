"""Homography of a plane from the ellipses of its circles."""

import numpy as np
from helpers_circles import circle_scene, noisy_ellipses, scattered

from roundel.scenes.geometry.conic import ellipse_of_conic
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.pose.plane_homography import PlaneHomography, fit_homography


def dots(generator, count=5, **keys):
    """A scene of scattered circles, their places (n, 2) in metres, and the true homography of unit norm."""
    offsets, radii = scattered(generator, count, gap=0.1)
    scene = circle_scene(generator, offsets, radii, **keys)
    h = scene.K @ scene.poses[0][:3, [0, 1, 3]]
    return scene, offsets * 2 * radii[0], h / np.linalg.norm(h)


def test_exact_ellipses_give_the_homography():
    generator = np.random.default_rng(1)
    for _ in range(200):
        scene, places, h = dots(generator)
        fit = fit_homography(ellipse_of_conic(scene.conics), np.array([np.eye(5)] * 5), places, scene.radii_m)
        assert isinstance(fit, PlaneHomography)
        assert np.abs(fit.H - h).max() < 1e-9
        assert fit.freedom == 17


def test_the_covariance_is_that_of_the_errors():
    generator = np.random.default_rng(2)
    scene, places, h = dots(generator)
    squares, chi2 = [], []
    for _ in range(200):
        ellipses, covs = noisy_ellipses(generator, scene, 0.1)
        fit = fit_homography(ellipses, covs, places, scene.radii_m)
        assert isinstance(fit, PlaneHomography)
        squares.append((fit.H - h).ravel() @ np.linalg.pinv(fit.cov, rcond=1e-12, hermitian=True) @ (fit.H - h).ravel())
        chi2.append(fit.chi2)
    # Means of chi-square with 8 and 17 degrees of freedom: standard deviations sqrt(2 k / 200), four of them.
    assert abs(np.mean(squares) - 8.0) < 4 * np.sqrt(16 / 200)
    assert abs(np.mean(chi2) - 17.0) < 4 * np.sqrt(34 / 200)


def test_too_few_circles_and_wrong_places_fail_with_a_reason():
    generator = np.random.default_rng(3)
    scene, places, _ = dots(generator)
    ellipses, covs = noisy_ellipses(generator, scene, 0.1)
    few = fit_homography(ellipses[:3], covs[:3], places[:3], scene.radii_m[:3])
    assert isinstance(few, FailedFit)
    assert "needs four circles" in few.reason
    line = np.column_stack([np.arange(5.0), np.zeros(5)])
    assert isinstance(fit_homography(ellipses, covs, line, scene.radii_m), FailedFit)
    mixed = fit_homography(ellipses, covs, places[::-1], scene.radii_m[::-1])
    assert isinstance(mixed, FailedFit) or mixed.chi2 > 1e3 * mixed.freedom
