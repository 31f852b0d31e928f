"""The camera and the poses of boards, from corners: unbiased, and as far off as their covariance says."""

import numpy as np
import pytest
from helpers_albums import CAMERA, chi_square, noisy_boards, pose_error
from scipy.stats import chi2

from roundel.scenes.camera.model import project
from roundel.scenes.camera.parameter_covariance import parameter_names
from roundel.scenes.errors import NotComparableError
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of, transform_points
from roundel.scenes.markers.marker import Part
from roundel.validate.calibration.board_bundle import (
    BoardCorners,
    _linearised,
    _State,
    adjusted_poses,
    least_squares_covariance,
)
from roundel.validate.calibration.opencv import least_squares_camera
from roundel.validate.ingest.reference import beside, calibrated, posed

SIZE = 640, 480


def parameters(camera):
    k = camera.K
    return np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], *camera.distortion])


def test_derivatives_are_those_of_the_residuals():
    (board,), (pose,) = noisy_boards(np.random.default_rng(0), 1, (0.1, 0.1))
    residual, by_camera, by_pose = _linearised(board, CAMERA, pose)
    start = _State(CAMERA, pose[None], np.ones(1))
    for column, step in enumerate((1e-3,) * 4 + (1e-6,) * 4):
        moved = start.moved(step * np.eye(8)[column], np.zeros((1, 6)))
        after = _linearised(board, moved.camera, pose)[0]
        np.testing.assert_allclose((residual - after) / step, by_camera[:, column], rtol=1e-4, atol=1e-5)
    for column in range(6):
        moved = start.moved(np.zeros(8), 1e-6 * np.eye(6)[column][None])
        after = _linearised(board, CAMERA, moved.poses[0])[0]
        np.testing.assert_allclose((residual - after) / 1e-6, by_pose[:, column], rtol=1e-3, atol=2e-2)


def test_exact_corners_give_the_camera_and_the_poses():
    boards, poses = noisy_boards(np.random.default_rng(1), 12, (0.0, 0.0))
    fit = calibrated(boards, SIZE).fit
    np.testing.assert_allclose(parameters(fit.camera), parameters(CAMERA), atol=1e-5)
    np.testing.assert_allclose(fit.poses, poses, atol=1e-7)


def test_errors_are_as_large_as_their_covariance_says():
    # Chi-squares per degree of freedom over 30 sets: 240 of the camera, 360 poses of 6; three standard deviations.
    rng = np.random.default_rng(2)
    board, disc = Part(1, "chessboard", 0.12, 0.01, None), Part(0, "disc", 0.0, 0.0, 0.03)
    to_disc = np.array([-0.12, -0.01, 0.0])
    camera, both, alone = [], [], []
    for _ in range(30):
        boards, poses = noisy_boards(rng, 12, (0.03, 0.1))
        measured = calibrated(boards, SIZE)
        camera.append(chi_square(parameters(measured.fit.camera) - parameters(CAMERA), measured.fit.covariance) / 8)
        assert measured.fit.widened == 1.0
        truth = poses.copy()
        truth[:, :3, 3] += poses[:, :3, :3] @ to_disc
        for fit, found in ((measured.fit, both), (posed(boards, CAMERA, np.zeros((8, 8))).fit, alone)):
            estimate = beside(fit.poses, fit.pose_covariance, board, disc)
            found += [chi_square(pose_error(p, q), c) / 6 for p, c, q in zip(*estimate, truth, strict=True)]
    assert np.mean(camera) == pytest.approx(1.0, abs=0.3)
    assert np.mean(alone) == pytest.approx(1.0, abs=0.1)
    # Poses of a set share the error of their camera: fewer degrees of freedom than they seem to have.
    assert np.mean(both) == pytest.approx(1.0, abs=0.2)
    assert np.mean(np.array(both) < 16.81 / 6) > 0.95  # the ellipsoid of 99 %


def test_an_uncertain_camera_makes_poses_less_certain():
    boards, poses = noisy_boards(np.random.default_rng(3), 2, (0.05, 0.05))
    exact, unsure = (
        adjusted_poses(boards, CAMERA, poses, c) for c in (np.zeros((8, 8)), np.diag([4.0] * 4 + [0.0] * 4))
    )
    np.testing.assert_allclose(exact.poses, unsure.poses)
    more = unsure.pose_covariance - exact.pose_covariance
    assert np.linalg.eigvalsh(more).min() > -1e-15
    # A focal length of 560 +- 2 px alone moves the board along its ray by 2 / 560 of its distance.
    assert np.sqrt(more[:, 5, 5]) == pytest.approx(poses[:, 2, 3] * 2 / 560, rel=0.5)
    assert parameter_names(CAMERA) == ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")


@pytest.mark.parametrize("views", [5, 20])
def test_the_covariance_of_opencvs_calibration_is_that_of_its_replicates(views):
    # Corners of some views scatter four times as much as those of others; OpenCV weights them alike.
    rng = np.random.default_rng(8)
    found = []
    while len(found) < 40:
        boards, _ = noisy_boards(rng, views, (0.03, 0.12))
        camera, _, poses = least_squares_camera(boards, SIZE)
        covariance, widened = least_squares_covariance(boards, camera, poses)
        assert widened < 1.6
        found.append(chi_square(parameters(camera) - parameters(CAMERA), covariance))
    # Chi-square of eight degrees of freedom over 40 sets: a mean of 8 scatters by 0.63; covariances from the residuals
    # of five views are themselves uncertain.
    assert np.mean(found) == pytest.approx(8.0, abs=2.5)
    assert np.mean(np.array(found) < chi2.ppf(0.95, 8)) > 0.84


def test_the_covariance_of_calibration_knows_a_bent_board():
    boards, _ = noisy_boards(np.random.default_rng(9), 14, (0.02, 0.02))
    x, y = boards[0].points_m[:, :2].T / 0.05
    bent = [BoardCorners(b.points_m, b.pixels + np.stack([0.5 * x * y, 0.5 * x**2], axis=-1)) for b in boards]
    for of, more in ((boards, False), (bent, True)):
        camera, _, poses = least_squares_camera(of, SIZE)
        assert (least_squares_covariance(of, camera, poses)[1] > 1.5) == more


def test_views_that_leave_the_camera_open_have_no_covariance():
    points = noisy_boards(np.random.default_rng(7), 1, (0.05, 0.05))[0][0].points_m
    frontal = [BoardCorners(points, frontal_px(points, 0)) for _ in range(4)]
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (4, 1, 1))
    poses[:, 2, 3] = 0.4
    covariance, _ = least_squares_covariance(frontal, CAMERA, poses)
    assert not np.isfinite(covariance).all()


def test_a_bent_board_widens_the_covariance():
    boards, _ = noisy_boards(np.random.default_rng(4), 14, (0.02, 0.02))
    bent = []
    for board in boards:
        x, y = board.points_m[:, :2].T / 0.05
        bent.append(BoardCorners(board.points_m, board.pixels + np.stack([0.5 * x * y, 0.5 * x**2], axis=-1)))
    assert calibrated(bent, SIZE).fit.widened > 1.5


def test_a_photograph_of_something_else_is_left_out():
    boards, _ = noisy_boards(np.random.default_rng(5), 12, (0.05, 0.05))
    rng = np.random.default_rng(6)
    boards[4] = BoardCorners(boards[4].points_m, boards[4].pixels + 5 * rng.standard_normal(boards[4].pixels.shape))
    measured = calibrated(boards, SIZE)
    assert list(measured.left_out) == [4]
    assert "from those of a flat board" in measured.left_out[4]
    assert measured.kept == [i for i in range(12) if i != 4]


def test_too_few_or_frontal_photographs_are_refused():
    boards, _ = noisy_boards(np.random.default_rng(7), 9, (0.05, 0.05))
    with pytest.raises(NotComparableError, match="9 photographs with the board are too few"):
        calibrated(boards, SIZE)
    points = boards[0].points_m
    frontal = [BoardCorners(points, frontal_px(points, i)) for i in range(18)]
    with pytest.raises(NotComparableError, match=r"too few .* so small that two poses explain it"):
        calibrated(frontal, SIZE)
    parallel = [tilted(points, i) for i in range(18)]
    with pytest.raises(NotComparableError, match=r"determine the focal length .* tilt it by 20 to 45 degrees"):
        calibrated(parallel, SIZE)


def frontal_px(points_m, i):
    exact = CAMERA.K[:2, 2] + 560 * points_m[:, :2] * [1, -1] / (0.4 + 0.01 * i)
    return exact + 0.05 * np.random.default_rng(i).standard_normal(exact.shape)


def tilted(points_m, i):
    """A view tilted by six degrees, like all others."""
    pose = camera_from_marker_of(normal_of(6.0, 30.0), [0.004 * i - 0.03, 0.02, 0.3 + 0.01 * i])
    px = project(CAMERA, transform_points(pose, points_m))
    return BoardCorners(points_m, px + 0.04 * np.random.default_rng(i).standard_normal(px.shape))
