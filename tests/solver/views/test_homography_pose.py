import numpy as np
import pytest
from helpers_prints import plane_homography, plane_view

from roundel.scenes.camera.focal_fusion import fused_focal_px
from roundel.scenes.geometry.conic import conic_of_circle
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.views.homography_pose import (
    MeasuredHomography,
    coordinates,
    focal_of_homography,
    homography_of,
    moved,
    poses_of_homography,
)


def test_a_homography_from_ellipse_and_centre_is_that_of_the_plane_up_to_a_rotation() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        pose, K = plane_view(rng)
        matrix = plane_homography(pose, K)
        made = homography_of(conic_of_circle(pose, 1.0, K), matrix[:2, 2])
        np.testing.assert_allclose(coordinates(matrix, made, turns=False), 0.0, atol=1e-9)


def test_a_centre_outside_the_ellipse_is_refused() -> None:
    pose, K = plane_view(np.random.default_rng(2))
    with pytest.raises(ValueError, match="inside the ellipse"):
        homography_of(conic_of_circle(pose, 1.0, K), np.array([-5000.0, 0.0]))


@pytest.mark.parametrize("turns", [True, False])
def test_coordinates_invert_the_move(turns: bool) -> None:
    rng = np.random.default_rng(3)
    pose, K = plane_view(rng)
    matrix = plane_homography(pose, K)
    delta = rng.normal(0, 0.02, 8 if turns else 7)
    np.testing.assert_allclose(coordinates(matrix, moved(matrix, delta), turns), delta, atol=1e-12)


@pytest.mark.parametrize("turns", [True, False])
def test_exact_homographies_give_the_exact_pose_over_500_scenes(turns: bool) -> None:
    rng = np.random.default_rng(4)
    worst = np.zeros(2)
    for _ in range(250):
        pose, K = plane_view(rng)
        measured = MeasuredHomography(plane_homography(pose, K), 1e-6 * np.eye(8 if turns else 7))
        best, _ = poses_of_homography(measured, K)
        assert best.chi2 < 1e-12
        centre = pose[:3, 3]
        error = angle_deg(best.normal, pose[:3, 2]), np.linalg.norm(best.centre - centre) / np.linalg.norm(centre)
        worst = np.maximum(worst, error)
        if turns:
            np.testing.assert_allclose(best.rotation, pose[:3, :3], atol=1e-8)
    assert worst.max() < 1e-6


def test_exact_homographies_give_the_exact_focal_length() -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
        pose, K = plane_view(rng, tilt_deg=(15.0, 65.0), distance=(8.0, 25.0))
        # The camera that is assumed is of no account.
        assumed = K * np.array([[0.7, 1.0, 1.0], [1.0, 0.7, 1.0], [1.0, 1.0, 1.0]])
        found = focal_of_homography(MeasuredHomography(plane_homography(pose, K), 1e-10 * np.eye(7)), assumed, 640)
        assert found is not None
        assert found.focal_px == pytest.approx(K[0, 0], rel=1e-7)


def test_a_plane_parallel_to_the_image_says_no_focal_length() -> None:
    pose, K = plane_view(np.random.default_rng(6), tilt_deg=(0.0, 1e-6))
    measured = MeasuredHomography(plane_homography(pose, K), 1e-8 * np.eye(7))
    assert focal_of_homography(measured, K, 640) is None


@pytest.mark.slow
def test_stated_focal_sigmas_hold_and_fusing_does_no_harm() -> None:
    rng = np.random.default_rng(7)
    z, prior_errors, fused_errors = [], [], []
    asked = 400
    for _ in range(asked):
        pose, K = plane_view(rng, tilt_deg=(5.0, 65.0), distance=(8.0, 60.0))
        matrix = plane_homography(pose, K)
        # Some 0.01 to 0.1 px of noise for a radius of 20 px: a marker's fit at 10 to 1 dn.
        sigma = np.exp(rng.uniform(np.log(5e-4), np.log(5e-3)))
        noisy = MeasuredHomography(moved(matrix, rng.normal(0, sigma, 7)), sigma**2 * np.eye(7))
        prior = K[0, 0] * np.exp(rng.normal(0, 0.115))
        found = focal_of_homography(noisy, K, 640)
        fused = prior
        if found is not None:
            z.append(np.log(found.focal_px / K[0, 0]) * found.focal_px / found.sigma_px)
            fused = fused_focal_px(prior, 0.115, found.focal_px, found.sigma_px)[0]
        prior_errors.append(abs(np.log(prior / K[0, 0])))
        fused_errors.append(abs(np.log(fused / K[0, 0])))
    assert len(z) > asked / 2
    inside = np.mean(np.abs(z) < 1.96)
    assert 0.90 < inside < 0.98
    prior_, fused_ = np.array(prior_errors), np.array(fused_errors)
    assert np.sqrt(np.mean(fused_**2)) < np.sqrt(np.mean(prior_**2))
    assert np.median(fused_) < np.median(prior_)
