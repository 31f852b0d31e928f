"""Tags and ChArUco boards: their bits are OpenCV's, and OpenCV detects them where the truth says."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers_reports import sheet_image
from helpers_studies import small_study
from make_tag_bits import FAMILIES, OUT, text

from roundel.render.run import render_study
from roundel.scenes.camera.model import project
from roundel.scenes.errors import UsageError
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.tags import charuco_grid, tag_cells, tag_grid
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import Frame, frame_of
from roundel.solver.methods.solve import solve_dataset
from roundel.validate.metrics.ground_truth import true_targets


def dictionary(family: str):
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[family][0]))


def test_the_shipped_bits_are_those_of_opencv() -> None:
    assert OUT.read_text(encoding="utf-8") == text()


@pytest.mark.parametrize("family", FAMILIES)
def test_tags_are_drawn_as_opencv_draws_them(family: str) -> None:
    count, tags = FAMILIES[family][1], dictionary(family)
    cells = tag_cells(family, 0, count)
    side = tags.markerSize + 2
    for i in range(count):
        np.testing.assert_array_equal(cv2.aruco.generateImageMarker(tags, i, side, None, 1), 255 * (1 - cells[i]))
    np.testing.assert_array_equal(tag_cells(family, count - 3, 3), cells[-3:])
    with pytest.raises(ValueError, match=f"marker.first_id: 4 tags .* but {family} ends at {count - 1}"):
        tag_cells(family, count - 3, 4)


@pytest.mark.parametrize(("columns", "rows"), [(2, 2), (5, 4), (4, 5), (7, 5), (6, 6)])
def test_boards_are_laid_out_as_opencv_lays_them_out(columns: int, rows: int) -> None:
    tags, side = dictionary("aruco_5x5_100"), 7
    # A pixel a cell; a square is two cells wider than its tag, and grid tags stand three cells apart.
    board = cv2.aruco.CharucoBoard((columns, rows), side + 2.0, float(side), tags)
    image = board.generateImage((columns * (side + 2), rows * (side + 2)), None, 0, 1)
    row, column = np.mgrid[:rows, :columns]
    squares = np.where((row + column) % 2 == 0, 0, 255).astype(np.uint8)
    expected = np.kron(squares, np.ones((side + 2, side + 2), dtype=np.uint8)).reshape(
        rows, side + 2, columns, side + 2
    )
    grid = charuco_grid("aruco_5x5_100", 0, columns, rows)
    white = (row + column) % 2 == 1
    expected = expected.transpose(0, 2, 1, 3)
    expected[white, 1:-1, 1:-1] = 255 * (1 - grid[white])
    assert not grid[~white].any()
    np.testing.assert_array_equal(image, expected.transpose(0, 2, 1, 3).reshape(image.shape))

    plain = cv2.aruco.GridBoard((columns, rows), float(side), 3.0, tags)
    image = plain.generateImage((columns * (side + 3) - 3, rows * (side + 3) - 3), None, 0, 1)
    padded = np.pad(1 - tag_grid("aruco_5x5_100", 0, columns, rows), [(0, 0)] * 2 + [(0, 3)] * 2, constant_values=1)
    expected = padded.transpose(0, 2, 1, 3).reshape(rows * (side + 3), columns * (side + 3))[:-3, :-3]
    np.testing.assert_array_equal(image, 255 * expected)


VIEW = """\
schema: 1
name: boards
seed: 7
camera: {width_px: 640, height_px: 480, focal_px: 700, distortion: [-0.15, 0.05, 0.001, -0.002]}
marker: {MARKER}
pose: {distance_m: 0.42, tilt_deg: 28, azimuth_deg: 65, roll_deg: 17}
frames: 1
"""


def view(folder: Path, marker: str) -> Frame:
    path = folder / "view.yaml"
    path.write_text(VIEW.replace("MARKER", marker))
    return frame_of(load_study(path), 0)


def seen(frame: Frame, drawn: np.ndarray) -> np.ndarray:
    """Image (n, 2) of points of OpenCV's board: x right, y down from its top-left corner."""
    half_w, half_h = frame.sheet.parts[0].half_size_m()
    flat = np.column_stack([drawn[:, 0] - half_w, half_h - drawn[:, 1], np.zeros(len(drawn))])
    return project(frame.camera, transform_points(frame.camera_from_sheet, flat))


SOFT = "edge_softness_m: 0.0006, clutter: {cell_m: 0.03}"


@pytest.mark.parametrize(
    ("family", "more"),
    [
        ("apriltag_36h11", ""),
        ("apriltag_36h11", SOFT),
        ("aruco_4x4_50", ""),
        ("aruco_6x6_250", "inverted: true"),
    ],
)
def test_opencv_reads_every_tag_of_a_board_where_the_truth_has_it(tmp_path: Path, family: str, more: str) -> None:
    keys = f"kind: tags, columns: 3, rows: 2, tag_m: 0.05, gap_m: 0.015, family: {family}, first_id: 11, margin_m: 0.03"
    frame = view(tmp_path, f"{keys}, {more}")
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    settings.detectInvertedMarker = "inverted" in more
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary(family), settings).detectMarkers(sheet_image(frame, 4))
    assert sorted(ids.ravel().tolist()) == [11, 12, 13, 14, 15, 16]
    board = cv2.aruco.GridBoard((3, 2), 0.05, 0.015, dictionary(family), np.arange(11, 17))
    drawn = dict(zip(board.getIds().ravel().tolist(), board.getObjPoints(), strict=True))
    tags = zip(ids.ravel().tolist(), corners, strict=True)
    error = np.array([found[0] - seen(frame, drawn[tag_id]) for tag_id, found in tags])
    # OpenCV's refinement pulls each corner of a square inward, by 0.2 to 0.35 px here; over the four of a tag that
    # cancels (0.01 px was seen). A corner out of order would be 80 px off, half a pixel of ours would show in the mean.
    assert np.linalg.norm(error, axis=-1).max() < 0.5
    assert np.linalg.norm(error.mean(axis=(0, 1))) < 0.05


@pytest.mark.parametrize(("columns", "rows", "more"), [(7, 5, ""), (5, 4, SOFT)])
def test_opencv_finds_every_corner_of_a_charuco_board_where_the_truth_has_it(
    tmp_path: Path, columns: int, rows: int, more: str
) -> None:
    size = f"columns: {columns}, rows: {rows}, square_m: 0.03, tag_m: 0.021"
    frame = view(tmp_path, f"kind: charuco, {size}, family: aruco_5x5_100, first_id: 4, {more}")
    tags = columns * rows // 2
    board = cv2.aruco.CharucoBoard((columns, rows), 0.03, 0.021, dictionary("aruco_5x5_100"), np.arange(4, 4 + tags))
    corners, ids, _, tag_ids = cv2.aruco.CharucoDetector(board).detectBoard(sheet_image(frame, 4))
    assert sorted(tag_ids.ravel().tolist()) == list(range(4, 4 + tags))
    assert ids.ravel().tolist() == list(range((columns - 1) * (rows - 1)))
    error = corners.reshape(-1, 2) - seen(frame, board.getChessboardCorners())
    # Tags lie within OpenCV's window round a saddle and pull it: 0.15 px at most, 0.05 px on average were seen.
    assert np.linalg.norm(error, axis=1).max() < 0.25
    assert np.linalg.norm(error.mean(axis=0)) < 0.05


def test_a_dataset_of_tags_alone_is_rendered_verified_and_left_alone_by_the_solver(tmp_path: Path) -> None:
    edits = (
        ("kind: disc, diameter_m: 0.08", f"kind: tags, columns: 2, rows: 2, tag_m: 0.04, gap_m: 0.01, {SOFT}"),
        ("distance_D: {uniform: [7, 9]}", "distance_m: 0.6"),
        ("frames: 4", "frames: 1"),
        ("band_samples: 256", "band_samples: 64"),
    )
    dataset = render_study(small_study(tmp_path, *edits), tmp_path / "tags")
    assert dataset is not None
    assert dataset.verify(full=True) == []
    (row,) = dataset.truth.to_pylist()
    assert (row["kind"], row["radius_m"], row["visible_fraction"]) == ("tags", None, 1.0)
    (marker,) = dataset.images.markers(0)
    layout = {"columns": 2, "rows": 2, "tag_m": 0.04, "gap_m": 0.01, "family": "apriltag_36h11", "first_id": 0}
    assert marker == {"marker_id": 0, "kind": "tags", "diameter_m": None, "layout": layout, "size_m": [0.09, 0.09]}
    with pytest.raises(UsageError, match="no frame with a circular marker"):
        solve_dataset(tmp_path / "tags", tmp_path / "estimates")
    assert len(true_targets(dataset, 3.0)) == 0
