"""The chessboard as a method: exact corners, rendered boards, focal length, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers_boards import board_image, board_views, plane_views

from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.detect.chessboard_corners import BoardLayout, board_points_m
from roundel.solver.methods.plugin import MethodFailure, View
from roundel.solver.related.chessboard import find
from roundel.solver.views.plane_marker import found_plane

LAYOUT = BoardLayout(6, 5, 0.016)
CAMERA = Camera(640, 480, np.array([[600.0, 0, 317.3], [0, 600.0, 242.2], [0, 0, 1.0]]), (-0.1, 0.03, 0.0005, -0.0007))
MARKER = {
    "marker_id": 0,
    "kind": "chessboard",
    "diameter_m": None,
    "layout": {"columns": 6, "rows": 5, "square_m": 0.016},
}
DISC = {"marker_id": 0, "kind": "disc", "diameter_m": 0.08, "layout": {}}


@pytest.mark.parametrize("scenes", [50, pytest.param(500, marks=pytest.mark.slow)])
def test_exact_corners_give_the_pose_and_the_focal_length(scenes):
    points = board_points_m(LAYOUT)
    measured = 0
    for true in plane_views(scenes, 12, points):
        view = View(np.zeros((480, 640), np.uint8), true.camera, 0.08)
        found = found_plane(view, points, true.pixels, 1e-4)
        np.testing.assert_allclose(found.poses[0][0], true.camera_from_marker[:3, 2], atol=1e-6)
        np.testing.assert_allclose(found.poses[0][1], true.camera_from_marker[:3, 3], atol=1e-6)
        if found.focal_px is not None:
            measured += 1
            assert found.focal_px == pytest.approx(true.camera.K[0, 0], rel=1e-6)
    assert measured > 0.9 * scenes


@pytest.mark.parametrize("beside", [[], [DISC]])
def test_boards_are_found_and_measured(beside):
    scores = []
    for pose in board_views(CAMERA, LAYOUT, 12, seed=3, span=0.35):
        view = View(board_image(CAMERA, pose, LAYOUT), CAMERA, 0.08, [*beside, MARKER])
        (found,) = find(view)
        assert found.chosen == 0
        assert float(angle_deg(found.poses[0][0], pose[:3, 2])) < 0.1
        assert np.linalg.norm(found.poses[0][1] - pose[:3, 3]) < 5e-4 * np.linalg.norm(pose[:3, 3])
        if found.focal_px is not None:
            scores.append(np.log(found.focal_px / 600) / (found.focal_sigma_px / found.focal_px))
    assert len(scores) >= 6
    # Residual offsets of OpenCV's corners are shared by neighbours: up to 2 standard deviations RMS are allowed.
    assert np.sqrt(np.mean(np.square(scores))) < 2


def test_boards_with_squares_of_six_pixels_are_found():
    errors = []
    for pose in board_views(CAMERA, LAYOUT, 12, seed=5, span=0.085):
        (found,) = find(View(board_image(CAMERA, pose, LAYOUT), CAMERA, 0.08, [MARKER]))
        assert not found.failure
        centre = np.asarray(found.poses[0][1])
        errors.append(CAMERA.K[0, 0] * (centre / centre[2] - pose[:3, 3] / pose[2, 3])[:2])
    # The magnified image's pixels are turned into ours: a quarter of a pixel would stand out.
    np.testing.assert_allclose(np.mean(errors, axis=0), 0, atol=0.05)


@pytest.mark.parametrize(
    ("markers", "sentence"),
    [
        ([DISC], "reads chessboard; the printed marker is disc"),
        ([], "nothing tells what is printed"),
    ],
)
def test_other_markers_are_refused(markers, sentence):
    with pytest.raises(MethodFailure, match=sentence):
        find(View(np.zeros((120, 160), np.uint8), CAMERA, 0.08, markers))


def test_a_missing_board_and_a_wrong_layout_are_failures_with_their_reason():
    view = View(np.full((120, 160), 90, np.uint8), CAMERA, 0.08, [MARKER])
    (found,) = find(view)
    assert found.failure == "no chessboard of 6 by 5 inner corners was found"
    (found,) = find(replace(view, markers=[{**MARKER, "layout": {"columns": 6}}]))
    assert found.failure.startswith("a chessboard's layout needs columns, rows and square_m")
