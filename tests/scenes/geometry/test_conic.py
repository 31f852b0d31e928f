"""The image of a circle, and the second pose with the same image."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.conic import (
    circle_points_m,
    conic_of_circle,
    conic_of_ellipse,
    ellipse_of_conic,
    ellipse_perimeter_px,
    ellipse_points,
    other_candidate,
    vanishing_line,
)
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of

K = np.array([[1200.0, 3.0, 640.2], [0.0, 1310.0, 355.7], [0.0, 0.0, 1.0]])

poses = st.tuples(
    st.floats(0, 80),
    st.floats(-180, 180),
    st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    st.floats(0.3, 50),
)


def scene(pose: tuple) -> tuple[np.ndarray, np.ndarray, float]:
    tilt, azimuth, (x, y), distance = pose
    normal, centre = normal_of(tilt, azimuth), np.array([x, y, 1.0]) * distance
    radius = 0.05
    # Seen from its printed side, wholly in front of the camera.
    assume(-normal @ centre > 1.01 * radius * np.sin(np.radians(tilt)) and centre[2] > 1.5 * radius)
    assume(-normal @ centre / np.linalg.norm(centre) > 0.05)
    return normal, centre, radius


@given(poses)
def test_projected_points_lie_on_the_conic_and_its_inside_is_positive(pose: tuple) -> None:
    normal, centre, radius = scene(pose)
    transform = camera_from_marker_of(normal, centre)
    conic = conic_of_circle(transform, radius, K)
    points = np.column_stack([project(Camera(1280, 720, K), circle_points_m(transform, radius, 16)), np.ones(16)])
    # Algebraic distance as a fraction of its terms: the conic has unit norm, its terms |x|^2.
    assert np.abs(np.einsum("ni,ij,nj->n", points, conic, points)).max() < 1e-12 * np.sum(points**2, axis=1).max()
    middle = np.append(project(Camera(1280, 720, K), centre), 1.0)
    assert middle @ conic @ middle > 0
    assert np.linalg.norm(conic) == pytest.approx(1.0, abs=1e-14)


@given(st.floats(-2000, 2000), st.floats(-2000, 2000), st.floats(3, 400), st.floats(0.1, 1.0), st.floats(0, 179.9))
def test_ellipse_and_conic_are_inverse(x: float, y: float, a: float, ratio: float, angle: float) -> None:
    ellipse = np.array([x, y, a, a * ratio, angle])
    back = ellipse_of_conic(conic_of_ellipse(ellipse))
    # The corner term is |centre|^2 of the others and loses as many digits: (2e3 / 0.3)^2 * 1e-16, in squared axes.
    np.testing.assert_allclose(back[:4], ellipse[:4], rtol=1e-6, atol=1e-7)
    if ratio < 0.99:
        assert abs((back[4] - angle + 90) % 180 - 90) < 1e-3
    np.testing.assert_allclose(ellipse_of_conic(-3.0 * conic_of_ellipse(ellipse)), back, rtol=1e-9, atol=1e-6)


def test_a_hyperbola_is_no_ellipse() -> None:
    with pytest.raises(ValueError, match="not an ellipse"):
        ellipse_of_conic(np.diag([1.0, -1.0, -1.0]))
    with pytest.raises(ValueError, match="no real points"):
        ellipse_of_conic(np.diag([1.0, 1.0, 1.0]))


@given(poses)
def test_the_other_candidate_has_the_same_image_and_is_its_own_inverse(pose: tuple) -> None:
    normal, centre, radius = scene(pose)
    other_normal, other_centre = other_candidate(normal, centre, radius)
    back_normal, back_centre = other_candidate(other_normal, other_centre, radius)
    np.testing.assert_allclose(back_normal, normal, atol=1e-12)
    np.testing.assert_allclose(back_centre, centre, atol=1e-12 * centre[2])
    assume(other_normal[2] < -0.02)  # a candidate seen edge-on has an ill-conditioned conic
    one = conic_of_circle(camera_from_marker_of(normal, centre), radius, K)
    two = conic_of_circle(camera_from_marker_of(other_normal, other_centre), radius, K)
    # Inverting the homography costs its condition, at worst some 1e5 here.
    np.testing.assert_allclose(one, two, atol=1e-10)


def test_a_circle_seen_along_its_axis_has_one_pose() -> None:
    normal, centre = other_candidate([0.0, 0.0, -1.0], [0.0, 0.0, 2.0], 0.1)
    np.testing.assert_array_equal(normal, [0, 0, -1])
    np.testing.assert_array_equal(centre, [0, 0, 2])


def test_fronto_parallel_off_axis_still_has_two() -> None:
    normal, centre = other_candidate([0.0, 0.0, -1.0], [0.5, 0.0, 2.0], 0.1)
    # Errata, section 2: only a camera on the axis of the circle sees one solution.
    assert angle_deg(normal, [0, 0, -1]) > 20
    assert np.linalg.norm(centre - [0.5, 0, 2]) < 0.01


@given(poses)
def test_the_centre_is_the_pole_of_the_vanishing_line(pose: tuple) -> None:
    normal, centre, radius = scene(pose)
    transform = camera_from_marker_of(normal, centre)
    conic = conic_of_circle(transform, radius, K)
    pole = np.append(project(Camera(1280, 720, K), centre), 1.0)
    # related-systems: v ~ C o. As directions, to the digits that the conic carries.
    line = conic @ pole
    line /= np.linalg.norm(line)
    expected = vanishing_line(transform, K)
    assert min(np.abs(line - expected).max(), np.abs(line + expected).max()) < 1e-6


def test_perimeter_and_points_of_a_circle() -> None:
    circle = np.array([3.0, 4.0, 10.0, 10.0, 0.0])
    assert ellipse_perimeter_px(circle) == pytest.approx(20 * np.pi, rel=1e-14)
    np.testing.assert_allclose(np.hypot(*(ellipse_points(circle, 7) - [3, 4]).T), 10.0, rtol=1e-14)
