"""The chessboard as a reference: corners, order, pose and calibration on boards whose truth is exact."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_boards import board_image, board_views, true_corners

from roundel.datasets.layout.contents import Contents
from roundel.datasets.layout.images import Images
from roundel.datasets.store.folder import Folder
from roundel.scenes.camera.model import Camera, camera_from_json, camera_to_json
from roundel.scenes.errors import DataError, NotComparableError, UsageError
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.detect.chessboard_corners import (
    BoardLayout,
    board_points_m,
    detect_corners,
    grey,
    layout_of,
)
from roundel.validate.calibration.camera_errors import calibration_errors, corner_offsets_px, projection_difference
from roundel.validate.calibration.chessboard import board_pose
from roundel.validate.calibration.opencv import calibrate, calibration_to_json, read_camera

LAYOUT = BoardLayout(9, 6, 0.025)
CAMERA = Camera(640, 480, np.array([[600.0, 0, 317.3], [0, 600.0, 242.2], [0, 0, 1.0]]), (-0.1, 0.03, 0.0005, -0.0007))


class FakeImages(Images):
    """Images that are held in memory."""

    def __init__(self, records: list[dict[str, Any]], pixels: list[np.ndarray]) -> None:
        super().__init__(records, Contents(Folder(Path("memory")), "", True, "", (), (), {}))
        object.__setattr__(self, "pixels", pixels)

    def image(self, i: int) -> np.ndarray:
        return self.pixels[i]  # type: ignore[attr-defined, no-any-return]


def record(frame_id: int, camera: Camera, layout: BoardLayout, group: str = "board") -> dict[str, Any]:
    marker = {"marker_id": 1, "kind": "chessboard", "diameter_m": None, "layout": vars(layout)}
    return {"frame_id": frame_id, "group": group, "mode": "images", "markers": [marker], **camera_to_json(camera)}


@pytest.fixture(scope="module")
def views() -> tuple[list[np.ndarray], FakeImages]:
    # The second of these views is small and tilted: the detector alone is off by 0.4 px in it.
    poses = board_views(CAMERA, LAYOUT, 10, seed=5)
    pixels = [board_image(CAMERA, pose, LAYOUT) for pose in poses]
    return poses, FakeImages([record(10 + i, CAMERA, LAYOUT) for i in range(len(poses))], pixels)


def test_object_points_are_in_the_marker_frame() -> None:
    points = board_points_m(BoardLayout(3, 4, 0.1))
    np.testing.assert_allclose(points[0], [-0.1, 0.15, 0.0], atol=1e-15)
    np.testing.assert_allclose(points[1] - points[0], [0.1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(points[3] - points[0], [0, -0.1, 0], atol=1e-15)
    np.testing.assert_allclose(points.mean(axis=0), 0, atol=1e-15)


@pytest.mark.parametrize("layout", [BoardLayout(9, 6, 0.025), BoardLayout(6, 9, 0.02), BoardLayout(7, 4, 0.03)])
@pytest.mark.parametrize("roll_deg", [0.0, 100.0, 180.0, -70.0])
def test_the_order_is_the_print_s_whatever_the_roll(layout: BoardLayout, roll_deg: float) -> None:
    pose = camera_from_marker_of(normal_of(25, 40), [0.01, -0.01, 0.45], roll_deg)
    corners = detect_corners(board_image(CAMERA, pose, layout, subpixels=4), layout.columns, layout.rows)
    assert corners is not None
    # A wrong order misses by a square or more, some 20 px; 0.2 px is the worst corner at so few subpixels.
    assert np.abs(corners - true_corners(CAMERA, pose, layout)).max() < 0.2


def test_corners_have_no_common_offset(views: tuple[list[np.ndarray], FakeImages]) -> None:
    poses, images = views
    offsets = []
    for i, pose in enumerate(poses):
        corners = detect_corners(images.image(i), LAYOUT.columns, LAYOUT.rows)
        assert corners is not None
        offsets.append(corner_offsets_px(corners, pose, LAYOUT, CAMERA))
    mean = np.array([o.mean(axis=0) for o in offsets])
    # Half a pixel wrong would be 0.5. The promise is 0.02 px on each axis; measured 0.005 in the worst view.
    assert np.abs(mean).max() < 0.02
    assert np.abs(np.concatenate(offsets).mean(axis=0)).max() < 0.005
    assert np.concatenate(offsets).std() < 0.02


def test_calibration_recovers_the_camera(views: tuple[list[np.ndarray], FakeImages]) -> None:
    calibration = calibrate(views[1], "board")
    errors = calibration_errors(calibration.camera, CAMERA)
    assert calibration.frame_ids == list(range(10, 20))
    assert calibration.rms_px < 0.05
    # calibrateCamera works in float32 within: its RMS and ours differ in the fourth digit.
    assert calibration.rms_px == pytest.approx(calibration.rms_check_px, rel=1e-2)
    # The promises: focal length within 0.05 %, principal point within 0.3 px.
    assert abs(errors["fx_error_pct"]) < 0.05
    assert abs(errors["fy_error_pct"]) < 0.05
    assert abs(errors["cx_error_px"]) < 0.3
    assert abs(errors["cy_error_px"]) < 0.3
    # A shift of the principal point, which a rotation takes up.
    assert errors["projection_mean_px"] < 0.45
    assert errors["projection_mean_rotated_px"] < 0.1


def test_calibration_as_a_camera_file(views: tuple[list[np.ndarray], FakeImages], tmp_path: Path) -> None:
    calibration = calibrate(views[1])
    record = calibration_to_json(calibration, "abc", "board")
    file = tmp_path / "phone.json"
    file.write_text(json.dumps(record))
    assert read_camera(file).distortion == calibration.camera.distortion
    np.testing.assert_array_equal(camera_from_json(record).K, calibration.camera.K)
    assert record["calibration"]["views"] == 10
    with pytest.raises(UsageError, match="no such camera file"):
        read_camera(tmp_path / "nowhere.json")
    file.write_text("[1, 2]")
    with pytest.raises(DataError, match="not a camera file"):
        read_camera(file)


def test_calibration_needs_three_views(views: tuple[list[np.ndarray], FakeImages]) -> None:
    _, images = views
    blank = np.full((480, 640), 200, np.uint8)
    few = FakeImages(images.records[:4], [images.image(0), images.image(1), blank, blank])
    with pytest.raises(NotComparableError, match="found in 2 of 4 views"):
        calibrate(few)
    with pytest.raises(UsageError, match="no group 'boards'"):
        calibrate(few, "boards")


def test_projection_difference_counts_a_shift_and_forgives_a_rotation() -> None:
    k = CAMERA.K.copy()
    k[0, 2] += 1.0
    shifted = Camera(640, 480, k, CAMERA.distortion)
    difference = projection_difference(shifted, CAMERA)
    np.testing.assert_allclose(difference.plain[..., 0], 1.0, atol=1e-9)
    np.testing.assert_allclose(difference.plain[..., 1], 0.0, atol=1e-9)
    figures = difference.figures()
    assert figures["projection_mean_px"] == pytest.approx(1.0, abs=1e-9)
    assert figures["projection_max_px"] == pytest.approx(1.0, abs=1e-9)
    # A pixel is 0.1 deg: a rotation takes up all of it but the second order at the corners.
    assert figures["projection_mean_rotated_px"] < 0.15
    assert difference.share == 1.0


def test_a_calibration_of_a_lens_with_more_terms_is_compared_by_projection() -> None:
    # The same polynomial to 1e-3 px: a fourth of k1 moved into the denominator.
    rational = Camera(640, 480, CAMERA.K, (*CAMERA.distortion, 0.0, 1e-7, 0.0, 0.0))
    errors = calibration_errors(CAMERA, rational)
    assert set(errors) == {
        f"projection_{n}" for n in ("mean_px", "max_px", "mean_rotated_px", "max_rotated_px", "share")
    }
    assert errors["projection_max_px"] < 1e-3
    assert errors["projection_share"] == 1.0
    # Zeros are no terms.
    padded = Camera(640, 480, CAMERA.K, (*CAMERA.distortion, 0.0, 0.0, 0.0, 0.0))
    assert calibration_errors(CAMERA, padded)["k1_error"] == 0.0


def test_a_calibration_of_a_fisheye_is_compared_where_both_see() -> None:
    fisheye = Camera(640, 480, CAMERA.K * [[0.4], [0.4], [1.0]], (0.0,) * 4, distortion_model="fisheye")
    # theta = r - r^3 / 3 + ...: what a polynomial makes of it ends at r = 1, the image's corners are at 1.67 rad.
    polynomial = Camera(640, 480, fisheye.K, (-1 / 3, 0.0, 0.0, 0.0))
    errors = calibration_errors(polynomial, fisheye)
    assert "fx_error_pct" not in errors
    assert 0.2 < errors["projection_share"] < 0.9
    assert np.isfinite(list(errors.values())).all()


@pytest.mark.parametrize("tilt_deg", [3.0, 30.0, 55.0])
def test_board_pose(tilt_deg: float) -> None:
    pose = camera_from_marker_of(normal_of(tilt_deg, 200), [0.02, 0.03, 0.5], 170)
    found = board_pose(board_image(CAMERA, pose, LAYOUT), LAYOUT, CAMERA)
    assert found is not None
    # Corners scatter by 0.01 px over 200 px: 0.003 deg and some 0.01 mm were measured.
    assert angle_deg(found[:3, 2], pose[:3, 2]) < 0.05
    assert angle_deg(found[:3, 0], pose[:3, 0]) < 0.05
    assert np.linalg.norm(found[:3, 3] - pose[:3, 3]) < 1e-4


def test_no_board_is_none() -> None:
    assert board_pose(np.full((480, 640), 128, np.uint8), LAYOUT, CAMERA) is None


def test_grey_of_any_depth() -> None:
    ramp = np.arange(256, dtype=np.uint8).reshape(16, 16)
    np.testing.assert_array_equal(grey(ramp), ramp)
    np.testing.assert_allclose(grey(ramp.astype(np.uint16) * 257), ramp, atol=1e-9)
    np.testing.assert_allclose(grey(np.repeat(ramp[..., None], 3, axis=-1)), ramp, atol=1e-9)


def test_a_layout_that_is_none() -> None:
    with pytest.raises(DataError, match="columns, rows and square_m"):
        layout_of({"columns": 9})
