"""Focal length from one view of a square: exact, refused where nothing tells, and with an honest standard deviation."""

from dataclasses import replace

import numpy as np
import pytest
from helpers_boards import SQUARE, PlaneView, pinhole, plane_views

from roundel.scenes.camera.focal_fusion import fused_focal_px
from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of, transform_points
from roundel.solver.pose.direct_homography import homography
from roundel.solver.pose.plane_focal import focal_from_plane, squared_focals
from roundel.solver.pose.plane_pose import plane_points

PRIOR_SIGMA = 0.115
SCENES = [50, pytest.param(500, marks=pytest.mark.slow)]


@pytest.mark.parametrize("scenes", SCENES)
def test_exact_corners_give_the_focal_length_whatever_camera_is_assumed(scenes):
    for view in plane_views(scenes, 1):
        found = focal_from_plane(plane_points(SQUARE, view.pixels, pinhole(800), 1e-4), square=True)
        assert found.focal_px == pytest.approx(view.camera.K[0, 0], rel=1e-6)
        np.testing.assert_allclose(found.pose.camera_from_marker, view.camera_from_marker, atol=1e-6)


def test_both_constraints_hold_on_exact_homographies():
    for view in plane_views(500, 2):
        h = homography(SQUARE[:, :2], view.pixels - [319.5, 239.5])
        f2 = view.camera.K[0, 0] ** 2
        scale = np.abs(h[2, :2]).max() ** 2 * f2
        (first, second), (zero, one) = squared_focals(h), (h[2, 0] * h[2, 1], h[2, 0] ** 2 - h[2, 1] ** 2)
        # Each is as exact as its denominator is far from zero.
        if abs(zero) > 1e-3 * scale / f2:
            assert first == pytest.approx(f2, rel=1e-6)
        if abs(one) > 1e-3 * scale / f2:
            assert second == pytest.approx(f2, rel=1e-6)


def test_square_pixels_are_those_of_the_camera():
    """fx / fy and skew are taken from the camera, its focal length is not."""
    view = next(iter(plane_views(1, 4, tilt_deg=(40, 50))))
    k = np.array([[700.0, 3.0, 330.0], [0.0, 770.0, 250.0], [0.0, 0.0, 1.0]])
    pixels = project(Camera(640, 480, k), transform_points(view.camera_from_marker, SQUARE))
    assumed = k.copy()
    assumed[:2, :2] *= 1.4
    found = focal_from_plane(plane_points(SQUARE, pixels, Camera(640, 480, assumed), 1e-4), square=True)
    assert found.focal_px == pytest.approx(700, rel=1e-6)


@pytest.mark.parametrize("tilt_deg", [0.0, 0.5])
def test_a_square_that_faces_the_camera_is_refused(tilt_deg):
    pose = camera_from_marker_of(normal_of(tilt_deg, 30.0), np.array([0.0, 0.0, 0.6]))
    pixels = project(pinhole(700), transform_points(pose, SQUARE))
    with pytest.raises(ValueError, match="too close to fronto-parallel: its points do not bound the focal length"):
        focal_from_plane(plane_points(SQUARE, pixels, pinhole(800), 0.05**2), square=True)


def measured(views: list[PlaneView], sigma_px: float, seed: int) -> np.ndarray:
    """Rows of log error, its sigma, and the log errors of the prior and of both fused; refused views are left out."""
    rng, rows = np.random.default_rng(seed), []
    for view in views:
        true = view.camera.K[0, 0]
        prior = true * np.exp(rng.normal(0, PRIOR_SIGMA))
        pixels = view.pixels + rng.normal(0, sigma_px, (4, 2))
        given = plane_points(SQUARE, pixels, replace(view.camera, K=pinhole(prior).K), sigma_px**2)
        try:
            found = focal_from_plane(given, square=True)
        except ValueError:
            continue
        fused = fused_focal_px(prior, PRIOR_SIGMA, found.focal_px, found.sigma_px)[0]
        rows.append(
            [np.log(found.focal_px / true), found.sigma_px / found.focal_px, np.log(prior / true), np.log(fused / true)]
        )
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize("sigma_px", [0.05, 0.2])
def test_the_standard_deviation_is_honest(sigma_px):
    error, sigma, prior, fused = measured(list(plane_views(500, 5)), sigma_px, 6).T
    assert 0.90 < np.mean(np.abs(error) < 1.96 * sigma) < 0.98
    assert np.mean(fused**2) < np.mean(prior**2)
    # Nor is it worse where the square tells little.
    for low, high in [(0, 0.05), (0.05, 0.15), (0.15, np.inf)]:
        inside = (sigma >= low) & (sigma < high)
        if inside.sum() > 20:
            assert np.mean(fused[inside] ** 2) < np.mean(prior[inside] ** 2)


def test_a_hundred_noisy_squares_are_covered():
    error, sigma, prior, fused = measured(list(plane_views(100, 7, tilt_deg=(20, 60))), 0.05, 8).T
    # 95 of 100 are expected; 87 or fewer have a chance of 1 in 700.
    assert np.sum(np.abs(error) < 1.96 * sigma) > 87
    assert np.sqrt(np.mean(fused**2)) < 0.5 * np.sqrt(np.mean(prior**2))
