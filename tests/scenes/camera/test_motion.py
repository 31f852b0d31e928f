"""Constant twists in closed form, and the image of a point that moves during the readout."""

from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from roundel.scenes.camera.model import project
from roundel.scenes.camera.motion import adjoint, exp_twist, image_of, pose_at
from roundel.scenes.errors import StudyError
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import frame_of

numbers = st.floats(-3, 3).map(lambda v: v if abs(v) > 1e-6 else 0.0)
twists = st.lists(numbers, min_size=6, max_size=6).map(np.array)
times = st.floats(-1, 1)


def generator(twist):
    vx, vy, vz, wx, wy, wz = twist
    return np.array([[0, -wz, wy, vx], [wz, 0, -wx, vy], [-wy, wx, 0, vz], [0, 0, 0, 0]])


@given(twists, times)
def test_the_closed_form_is_the_matrix_exponential(twist, time) -> None:
    # scipy's Pade approximant is good to some 1e-14 of the largest entry, which is below 10 here.
    np.testing.assert_allclose(exp_twist(twist, time), expm(generator(twist) * time), atol=1e-12)


@given(twists, times, times)
def test_a_constant_twist_is_a_one_parameter_group(twist, a, b) -> None:
    np.testing.assert_allclose(exp_twist(twist, a) @ exp_twist(twist, b), exp_twist(twist, a + b), atol=1e-12)


@given(st.floats(-9, -3), twists)
@settings(max_examples=40)
def test_small_angles_keep_their_digits(exponent, twist) -> None:
    small = twist * np.array([1, 1, 1, *3 * [10**exponent]])
    np.testing.assert_allclose(exp_twist(small, 1.0), expm(generator(small)), atol=1e-13)


@given(twists, twists)
def test_the_adjoint_carries_a_twist_to_another_frame(where, twist) -> None:
    transform = exp_twist(where, 1.0)
    there = exp_twist(adjoint(transform, twist), 1.0)
    # Shifts of some 100 m in a product of three: 1e-14 of each.
    np.testing.assert_allclose(there, transform @ exp_twist(twist, 1.0) @ np.linalg.inv(transform), atol=1e-10)


ROLLING = (
    "pose:",
    "motion: {exposure_s: 0.004, readout_s: 0.02, camera: {velocity_m_s: [0.3, 0.2, 0], rate_deg_s: [10, 0, 20]},\n"
    "         marker: {velocity_m_s: [0.1, 0, 0.2], rate_deg_s: [0, 30, 0]}}\npose:",
)


def test_a_rolling_shutter_images_a_point_on_the_row_exposed_just_then(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, ROLLING), 0)
    points = np.random.default_rng(0).uniform(-0.04, 0.04, (50, 3)) * [1, 1, 0]
    px, time = image_of(frame.camera, frame.motion, frame.camera_from_sheet, points)
    np.testing.assert_allclose(time, frame.motion.row_time_s(px[:, 1]), atol=1e-12)
    for point, at, there in zip(points, time, px, strict=True):
        pose = pose_at(frame.motion, frame.camera_from_sheet, at)
        np.testing.assert_allclose(project(frame.camera, transform_points(pose, point)), there, atol=1e-8)


def test_the_pose_of_record_is_that_of_the_centre_row_and_the_shutter_stands_round_it(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, ROLLING), 0)
    row = truth_of(frame)[0]

    def pose(prefix: str):
        return np.array([[row[f"{prefix}camera_from_marker_{i}{j}"] for j in range(4)] for i in range(4)])

    np.testing.assert_allclose(pose(""), frame.camera_from_sheet, atol=1e-15)
    for prefix, after in (("open_", -0.002), ("close_", 0.002)):
        np.testing.assert_allclose(pose(prefix), pose_at(frame.motion, frame.camera_from_sheet, after), atol=1e-15)
    # The image of the centre is on the row of record, whatever moves.
    assert row["centre_image_y_px"] == pytest.approx(frame.motion.centre_row_px, abs=1e-9)
    still = truth_of(frame_of(small_study(tmp_path, name="still.yaml"), 0))[0]
    assert row["centre_image_x_px"] == pytest.approx(still["centre_image_x_px"], abs=1e-9)
    assert np.ptp(np.array(row["contour_x_px"]) - still["contour_x_px"]) > 0.2  # but the contour is sheared


def test_a_still_camera_has_one_pose_only(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, ("pose:", "motion: {exposure_s: 0.01, readout_s: 0.03}\npose:")), 0)
    row = truth_of(frame)[0]
    assert not frame.motion.moves
    assert row["open_camera_from_marker_03"] == row["camera_from_marker_03"] == row["close_camera_from_marker_03"]


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ("motion: {exposure_s: 0.05, frame_s: 0.033}", "motion.exposure_s: 0.05 s exceeds the frame time of 0.033 s"),
        ("motion: {readout_s: 0.05, frame_s: 0.033}", "motion.readout_s: 0.05 s exceeds the frame time of 0.033 s"),
        ("motion: {readout_s: 0.5, camera: {velocity_m_s: [0, -2, 0]}}", "marker 0 outruns the rolling shutter"),
        ("motion: {exposure_s: -1}", "motion.exposure_s: -1 is out of range"),
        ("motion: {camera: {velocity_m_s: [0, 2]}}", "motion.camera.velocity_m_s"),
    ],
)
def test_motion_that_cannot_be_is_refused_in_a_line(tmp_path: Path, edit, message) -> None:
    with pytest.raises(StudyError, match=message.replace(".", r"\.")) as caught:
        frame_of(small_study(tmp_path, ("pose:", f"{edit}\npose:")), 0)
    assert caught.value.line == 6
