"""Both poses of a plane: exact points give the true pose, and the derivatives and the covariance are right."""

from dataclasses import replace

import numpy as np
import pytest
from helpers_boards import SQUARE, pinhole, plane_views

from roundel.scenes.camera.model import project
from roundel.scenes.geometry.pose import angle_deg, transform_points
from roundel.solver.pose.plane_pose import plane_points, plane_poses, refined_pose

GRID = np.stack([*np.meshgrid(np.linspace(-0.05, 0.05, 5), np.linspace(-0.04, 0.04, 4))], axis=-1).reshape(-1, 2)
GRID = np.concatenate([GRID, np.zeros((len(GRID), 1))], axis=1)


@pytest.mark.parametrize(("points", "square"), [(SQUARE, True), (GRID, False)])
def test_exact_points_give_the_true_pose_first(points, square):
    for view in plane_views(500, 1, points):
        poses = plane_poses(plane_points(points, view.pixels, view.camera), square=square)
        np.testing.assert_allclose(poses[0].camera_from_marker, view.camera_from_marker, atol=1e-10)
        # The other one is a minimum, too, in front of the camera and seen from the printed side.
        for pose in poses[1:]:
            assert pose.centre_m[2] > 0
            assert pose.normal @ pose.centre_m < 0
            assert pose.chi2 > poses[0].chi2


def test_far_away_there_are_two_poses_mirrored_about_the_line_of_sight():
    for view in plane_views(100, 2, SQUARE / 20, tilt_deg=(20, 60)):
        first, second = plane_poses(plane_points(SQUARE / 20, view.pixels, view.camera), square=True)
        sight = first.centre_m / np.linalg.norm(first.centre_m)
        mirrored = 2 * (first.normal @ sight) * sight - first.normal
        assert angle_deg(second.normal, mirrored) < 2.0
        # A hundredth of a pixel of noise is more than what tells them apart.
        assert second.chi2 < 0.5**2


def test_a_pose_without_distortion_needs_the_focal_length_that_is_asked_for():
    view = next(iter(plane_views(1, 3)))
    wrong = replace(view.camera, K=pinhole(0.5 * view.camera.K[0, 0]).K)
    given = plane_points(SQUARE, view.pixels, wrong)
    assert plane_poses(given, square=True)[0].chi2 > 1e-4
    poses = plane_poses(given, log_scale=np.log(2.0), square=True)
    np.testing.assert_allclose(poses[0].camera_from_marker, view.camera_from_marker, atol=1e-9)


def test_the_information_is_that_of_the_reprojection_error():
    """Its inverse is the covariance of the estimate, pose and focal length together."""
    view = next(iter(plane_views(1, 6, GRID, tilt_deg=(45, 50))))
    rng, sigma = np.random.default_rng(1), 0.02
    true = refined_pose(plane_points(GRID, view.pixels, view.camera, sigma**2), view.camera_from_marker, free=True)
    predicted = np.sqrt(np.diag(np.linalg.inv(true.information)))[3:]
    seen = []
    for _ in range(400):
        pixels = view.pixels + rng.normal(0, sigma, view.pixels.shape)
        pose = refined_pose(plane_points(GRID, pixels, view.camera, sigma**2), view.camera_from_marker, free=True)
        seen.append([*(pose.centre_m - view.camera_from_marker[:3, 3]), pose.log_scale])
    # The standard deviation of 400 samples is known to 3.5 %; four times that.
    np.testing.assert_allclose(np.std(seen, axis=0) / predicted, 1, atol=0.14)


def test_the_covariance_of_the_pixels_weighs_them():
    view = next(iter(plane_views(1, 8, GRID)))
    pixels = view.pixels.copy()
    pixels[0] += 5.0
    cov = np.diag(np.repeat(np.r_[1e8, np.ones(len(GRID) - 1)], 2))
    weighed = plane_poses(plane_points(GRID, pixels, view.camera, cov))[0]
    even = plane_poses(plane_points(GRID, pixels, view.camera))[0]
    np.testing.assert_allclose(weighed.camera_from_marker, view.camera_from_marker, atol=1e-6)
    assert np.abs(even.camera_from_marker - view.camera_from_marker).max() > 1e-3


def test_a_plane_seen_from_behind_has_no_pose():
    view = next(iter(plane_views(1, 9, GRID)))
    mirrored = GRID * [-1, 1, 1]
    pixels = project(view.camera, transform_points(view.camera_from_marker, GRID))
    assert plane_poses(plane_points(mirrored, pixels, view.camera)) == []


@pytest.mark.parametrize("pixels", [np.zeros((3, 2)), np.full((4, 2), np.nan)])
def test_too_few_points_are_refused(pixels):
    with pytest.raises(ValueError, match="needs four or more points that the lens images"):
        plane_points(SQUARE[: len(pixels)], pixels, pinhole(500))
