"""The truth of a frame: its numbers agree with one another."""

from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.datasets.layout.truth_table import TRUTH_SCHEMA, truth_table
from roundel.scenes.camera.model import undistort_px
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import camera_from_marker_of
from roundel.scenes.truth.edge_points import edge_points_of
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import frame_of, frames_of

DISTORTED = ("focal_px: 320", "focal_px: 320, distortion: [-0.3, 0.1, 0.004, -0.003, 0.02]")


def vector(row: dict, name: str, suffix: str = "") -> np.ndarray:
    return np.array([row[f"{name}_{axis}{suffix}"] for axis in "xyz"])


def test_a_row_agrees_with_itself(tmp_path: Path) -> None:
    for frame in frames_of(small_study(tmp_path, DISTORTED)):
        (row,) = truth_of(frame)
        assert set(row) | {"flags"} == set(TRUTH_SCHEMA.names)  # flags come from the developed image
        normal, centre = vector(row, "normal"), vector(row, "centre", "_m")
        assert row["tilt_deg"] == pytest.approx(frame.settings.pose.tilt_deg, abs=1e-12)
        assert row["azimuth_deg"] == pytest.approx(frame.settings.pose.azimuth_deg, abs=1e-10)
        assert row["distance_D"] == pytest.approx(frame.settings.pose.distance_D, rel=1e-14)
        assert normal @ centre < 0  # the printed face looks at the camera
        # Both candidates have the recorded conic and ellipse.
        conic = np.array([[row[f"conic_{min(i, j)}{max(i, j)}"] for j in range(3)] for i in range(3)])
        other = camera_from_marker_of(vector(row, "other_normal"), vector(row, "other_centre", "_m"))
        np.testing.assert_allclose(conic_of_circle(other, 0.04, frame.camera.K), conic, atol=1e-12)
        ellipse = [row[f"ellipse_{n}"] for n in ("x_px", "y_px", "a_px", "b_px", "angle_deg")]
        np.testing.assert_allclose(ellipse_of_conic(conic), ellipse, rtol=1e-9)
        # The distorted contour, undistorted, lies on the conic: algebraic distance over gradient is a distance in px.
        contour = undistort_px(frame.camera, np.column_stack([row["contour_x_px"], row["contour_y_px"]]))
        h = np.column_stack([contour, np.ones(len(contour))])
        distance = np.einsum("ni,ij,nj->n", h, conic, h) / (2 * np.linalg.norm((h @ conic)[:, :2], axis=1))
        assert np.abs(distance).max() < 1e-9
        # The image of the centre is asked of the study, and is not the centre of the ellipse.
        asked = frame.camera.K[:2, 2] + [frame.settings.pose.offset_x_px, 0]
        np.testing.assert_allclose([row["centre_image_x_px"], row["centre_image_y_px"]], asked, atol=1e-9)
        assert row["visible_fraction"] == 1.0


def test_a_marker_cut_by_the_border_says_how_much_is_left(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, ("{uniform: [-20, 20]}", "-79.5"), ("{uniform: [10, 50]}", "0")), 0)
    # Its centre stands in the middle of the first column: a little more than half of it is seen.
    assert truth_of(frame)[0]["visible_fraction"] == pytest.approx(0.5, abs=0.02)


def test_a_board_beside_a_disc_has_a_row_of_its_own(tmp_path: Path) -> None:
    edits = (
        (
            "kind: disc, diameter_m: 0.08",
            "kind: disc_with_chessboard, diameter_m: 0.02, gap_m: 0.01, "
            "chessboard: {columns: 4, rows: 3, square_m: 0.01}",
        ),
        ("distance_D: {uniform: [7, 9]}", "distance_m: 0.4"),
    )
    frame = frame_of(small_study(tmp_path, *edits), 0)
    disc, board = truth_of(frame)
    assert (disc["kind"], board["kind"], board["marker_id"]) == ("disc", "chessboard", 1)
    # Disc radius + gap + half of five squares, along the marker's X.
    along = np.array([disc[f"camera_from_marker_{i}0"] for i in range(3)])
    np.testing.assert_allclose(vector(board, "centre", "_m") - vector(disc, "centre", "_m"), 0.045 * along, atol=1e-14)
    assert board["ellipse_x_px"] is None
    assert board["radius_m"] is None
    assert truth_table([disc, board]).num_rows == 2


def test_edge_points_scatter_about_the_contour_as_asked(tmp_path: Path) -> None:
    points = ("frames: 4", "frames: 4\nmode: points\npoints: {count: 20000, sigma_px: 0.3}")
    frame = frame_of(small_study(tmp_path, points), 2)
    row = truth_of(frame)[0]
    conic = np.array([[row[f"conic_{min(i, j)}{max(i, j)}"] for j in range(3)] for i in range(3)])
    xy = edge_points_of(frame, frame.sheet.parts[0])
    h = np.column_stack([xy, np.ones(len(xy))])
    distance = np.einsum("ni,ij,nj->n", h, conic, h) / (2 * np.linalg.norm((h @ conic)[:, :2], axis=1))
    # The component along the normal has the sigma of one coordinate; 20,000 points give it to 0.5 %, Sampson to 1 %.
    assert distance.std() == pytest.approx(0.3, rel=0.03)
    again = edge_points_of(frame, frame.sheet.parts[0])
    np.testing.assert_array_equal(xy, again)
