"""Angles, normals and rotations."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.geometry.pose import (
    angle_deg,
    camera_from_marker_of,
    minimal_rotation,
    normal_of,
    tilt_azimuth_deg,
    transform_points,
)

tilt = st.floats(0.01, 85.0)
azimuth = st.floats(-179.9, 179.9)


@given(st.floats(1e-12, 1.0))
def test_small_angles_keep_their_digits(radians: float) -> None:
    a, b = np.array([1.0, 0.0, 0.0]), np.array([np.cos(radians), np.sin(radians), 0.0])
    exact = mpmath.atan2(mpmath.mpf(float(b[1])), mpmath.mpf(float(b[0])))
    # A few ulps of a double; acos(a . b) would have lost everything below 1e-8.
    assert float(np.radians(angle_deg(a, b))) == pytest.approx(float(exact), rel=1e-14)


@given(tilt, azimuth)
def test_tilt_and_azimuth_are_inverse_to_the_normal(t: float, a: float) -> None:
    normal = normal_of(t, a)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-15)
    assert normal[2] < 0  # toward the camera
    back_t, back_a = tilt_azimuth_deg(normal)
    # The azimuth of a small tilt is worse conditioned by 1 / sin(tilt): 1e-15 / sin(0.01 deg) is 6e-12 rad.
    assert back_t == pytest.approx(t, abs=1e-11)
    assert back_a == pytest.approx(a, abs=1e-9)


@given(tilt, azimuth, tilt, azimuth)
def test_minimal_rotation_is_a_rotation_by_the_angle_between(t1: float, a1: float, t2: float, a2: float) -> None:
    u, v = normal_of(t1, a1), normal_of(t2, a2)
    r = minimal_rotation(u, v)
    # The division by 1 + u.v costs digits near opposite vectors; tilts to 85 deg keep it above 0.015.
    np.testing.assert_allclose(r @ u, v, atol=1e-13)
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(r) == pytest.approx(1.0, abs=1e-12)
    assert np.trace(r) == pytest.approx(1 + 2 * np.cos(np.radians(angle_deg(u, v))), abs=1e-12)


def test_opposite_vectors_have_no_minimal_rotation() -> None:
    with pytest.raises(ValueError, match="not unique"):
        minimal_rotation([0.0, 0.0, 1.0], [0.0, 0.0, -1.0])


@given(tilt, azimuth, st.floats(-180, 180))
def test_marker_frame_is_right_handed_with_its_z_on_the_normal(t: float, a: float, roll: float) -> None:
    pose = camera_from_marker_of(normal_of(t, a), [0.1, -0.2, 3.0], roll)
    np.testing.assert_allclose(pose[:3, 2], normal_of(t, a), atol=1e-14)
    np.testing.assert_allclose(np.cross(pose[:3, 0], pose[:3, 1]), pose[:3, 2], atol=1e-14)


def test_an_upright_page_has_x_to_the_right_and_y_up() -> None:
    pose = camera_from_marker_of([0.0, 0.0, -1.0], [0.0, 0.0, 2.0])
    # Up in the marker is -y in the camera.
    np.testing.assert_array_equal(transform_points(pose, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), [[1, 0, 2], [0, -1, 2]])
