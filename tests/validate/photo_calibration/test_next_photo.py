"""What to photograph next: the predicted uncertainty is the one that a calibration then states."""

import numpy as np
from helpers_boards import grid_pose

from roundel.scenes.camera.model import Camera, project
from roundel.validate.photo_calibration.coverage import coverage_lines, coverage_of
from roundel.validate.photo_calibration.from_corners import calibrated_from_corners
from roundel.validate.photo_calibration.next_photo import candidates, next_photographs, uncertainty_px
from roundel.validate.photo_calibration.record import Board, BoardPhoto, PhotoCalibration

CAMERA = Camera(
    800, 600, np.array([[760.0, 0.0, 405.0], [0.0, 762.0, 296.0], [0.0, 0.0, 1.0]]), (-0.12, 0.04, 6e-4, -4e-4)
)
_X, _Y = np.meshgrid((np.arange(8) - 3.5) * 0.02, (2 - np.arange(5)) * 0.02)
POINTS = np.stack([_X.ravel(), _Y.ravel(), np.zeros(40)], axis=-1)
BOARD = Board("chessboard", "a chessboard", POINTS, (0.09, 0.06), True)
NOISE_PX = 0.05


def photo_of(pose: np.ndarray, number: int) -> BoardPhoto:
    noise = np.random.default_rng(number).normal(0, NOISE_PX, (len(POINTS), 2))
    pixels = project(CAMERA, POINTS @ pose[:3, :3].T + pose[:3, 3]) + noise
    return BoardPhoto(f"{number}.jpg", (800, 600), "", pixels, POINTS)


def calibration_of(poses: list[np.ndarray]) -> PhotoCalibration:
    found = calibrated_from_corners(BOARD, (800, 600), [photo_of(pose, i) for i, pose in enumerate(poses)])
    assert found.fitted is not None, found.problem
    return found


def views(count: int, tilts: tuple[float, float], seed: int = 1) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [
        grid_pose(rng.uniform(*tilts), 360 * k / count, rng.uniform(-20, 20), *rng.uniform(-0.04, 0.04, 2), 0.4)
        for k in range(count)
    ]


def test_the_prediction_comes_true_and_beats_what_was_done_so_far() -> None:
    poses = views(10, (1, 4))
    found = calibration_of(poses)
    assert found.fitted is not None
    first = next_photographs(found.fitted, BOARD)[0]
    # All tilts are small: what is open is the focal length, and a tilted board closes it.
    assert first.weakest == "focal length"
    assert first.candidate.tilt_deg >= 25
    assert first.candidate.text.startswith("tilt the board by")
    then = calibration_of([*poses, first.candidate.camera_from_board])
    assert then.fitted is not None
    stated = uncertainty_px(then.fitted.camera, then.fitted.covariance)
    # The noise is measured anew in each photograph, to some per cent, and the first camera was a little off.
    np.testing.assert_allclose(stated[first.weakest], first.after_px[first.weakest], rtol=0.25)
    same = calibration_of([*poses, poses[0]])
    assert same.fitted is not None
    repeated = uncertainty_px(same.fitted.camera, same.fitted.covariance)
    assert stated[first.weakest] < 0.5 * repeated[first.weakest]


def test_candidates_are_whole_in_the_image_and_tilted_as_they_say() -> None:
    found = candidates(CAMERA, BOARD)
    assert {c.place for c in found} == {(i, j) for i in range(3) for j in range(3)}
    outline = np.array([[x, y, 0.0] for x in (-0.09, 0.09) for y in (-0.06, 0.06)])
    for one in found:
        pose = one.camera_from_board
        px = project(CAMERA, outline @ pose[:3, :3].T + pose[:3, 3])
        assert np.all((px > 0) & (px < [799, 599]))
        np.testing.assert_allclose(np.degrees(np.arccos(-pose[2, 2])), one.tilt_deg, atol=1e-6)
    # "Its right side away": the corners to the right of the image are farther.
    right = next(c for c in found if c.tilt_deg == 40 and c.away == 0)
    depth = (outline @ right.camera_from_board[:3, :3].T)[:, 2]
    assert depth[outline[:, 0] > 0].min() > depth[outline[:, 0] < 0].max()
    assert "its right side away from you" in right.text


def test_many_good_photographs_leave_nothing_to_advise_but_little() -> None:
    many = calibration_of(views(60, (20, 45)))
    assert many.fitted is not None
    for advice in next_photographs(many.fitted, BOARD, 1):
        assert advice.after_px[advice.weakest] < 0.97 * advice.before_px[advice.weakest]


def test_coverage_names_what_is_missing() -> None:
    pose = grid_pose(30, 0, 0, -0.05, -0.03, 0.4)
    away = coverage_of(calibration_of([pose, *views(6, (20, 40))]).used[:1], (800, 600))
    # The board is tilted about the image's x axis: its upper or lower side recedes, the others never.
    assert len(away.missing_tilts) == 3
    assert {"right", "left"} <= set(away.missing_tilts)
    assert "the lower right corner" in away.empty
    lines = coverage_lines(away, 1)
    assert lines[0] == "take at least 9 more photographs that show the board"
    assert "the lower right corner" in lines[1]
    flat = coverage_of(calibration_of(views(8, (1, 5))).used, (800, 600))
    assert "degrees at most: tilt it by 20 to 45 degrees" in coverage_lines(flat, 10)[-1]
