"""The board of a sheet in an image: chessboards and ChArUco boards, large images, other sheets, mirrored ones."""

import numpy as np
import pytest
from helpers_albums import sheet_study
from helpers_reports import sheet_image

from roundel.scenes.camera.model import project
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.world.frame import frame_of
from roundel.validate.ingest.board_search import find_board, shows_circle

CHARUCO = (
    "kind: disc_with_chessboard, diameter_m: 0.06, gap_m: 0.015, chessboard: {columns: 5, rows: 4, square_m: 0.02}",
    "kind: disc_with_charuco, diameter_m: 0.06, gap_m: 0.015, "
    "charuco: {columns: 6, rows: 5, square_m: 0.02, tag_m: 0.014}",
)


LARGE = (
    (
        "width_px: 640, height_px: 480, focal_px: 560, principal_point_x_px: 323, principal_point_y_px: 236",
        "width_px: 1920, height_px: 1440, focal_px: 1680, principal_point_x_px: 969, principal_point_y_px: 708",
    ),
    ("[-190, -110]", "[-570, -330]"),
)


def errors_px(frame, corners):
    board = frame.sheet.parts[1]
    return corners.pixels - project(frame.camera, transform_points(frame.camera_from_part(board), corners.points_m))


@pytest.mark.parametrize(("edits", "count", "most_px"), [((), 20, 0.05), ((CHARUCO,), 20, 0.15)])
def test_corners_are_where_the_board_has_them(tmp_path, edits, count, most_px):
    frame = frame_of(sheet_study(tmp_path, *edits), 0)
    circle, board = frame.sheet.parts
    image = sheet_image(frame)
    corners = find_board(image, board)
    assert len(corners.pixels) == count
    assert np.abs(errors_px(frame, corners)).max() < most_px
    assert shows_circle(image, corners, frame.sheet, board, circle)


def test_a_charuco_board_may_be_cut(tmp_path):
    frame = frame_of(sheet_study(tmp_path, CHARUCO), 1)
    image = sheet_image(frame)
    whole = find_board(image, frame.sheet.parts[1])
    hidden = image.copy()
    hidden[:, int(np.median(whole.pixels[:, 0])) :] = 255
    some = find_board(hidden, frame.sheet.parts[1])
    assert 6 <= len(some.pixels) < len(whole.pixels)


def test_corners_of_a_large_image_are_refined_in_it(tmp_path):
    frame = frame_of(sheet_study(tmp_path, *LARGE), 2)
    corners = find_board(sheet_image(frame, 4), frame.sheet.parts[1])
    # The reduced image would have them to some hundredths of its own, larger pixels.
    assert np.abs(errors_px(frame, corners)).max() < 0.03


def test_a_mirrored_chessboard_is_known_by_its_circle(tmp_path):
    # With an odd number of rows of squares the whole sheet would be symmetric, and its mirror image a sheet.
    edit = ("columns: 5, rows: 4, square_m: 0.02", "columns: 6, rows: 5, square_m: 0.016")
    frame = frame_of(sheet_study(tmp_path, edit), 0)
    circle, board = frame.sheet.parts
    mirrored = np.ascontiguousarray(sheet_image(frame)[:, ::-1])
    corners = find_board(mirrored, board)
    assert corners is not None
    assert not shows_circle(mirrored, corners, frame.sheet, board, circle)


def test_a_sheet_without_the_circle_is_another(tmp_path):
    frame = frame_of(sheet_study(tmp_path), 0)
    circle, board = frame.sheet.parts
    image = sheet_image(frame)
    corners = find_board(image, board)
    u, v = project(frame.camera, frame.camera_from_part(circle)[:3, 3]).astype(int)
    image[v - 90 : v + 90, max(u - 90, 0) : u + 75] = 200
    assert not shows_circle(image, corners, frame.sheet, board, circle)


def test_no_board_is_none(tmp_path):
    board = frame_of(sheet_study(tmp_path), 0).sheet.parts[1]
    assert find_board(np.full((240, 320), 128, dtype=np.uint8), board) is None
    charuco = frame_of(sheet_study(tmp_path, CHARUCO), 0).sheet.parts[1]
    assert find_board(np.full((240, 320, 3), 128, dtype=np.uint8), charuco) is None
