"""The metrics: identities, hand-computed values, and the errata's published table."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from roundel.scenes.camera.model import Camera, distort_px, project
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_points
from roundel.scenes.geometry.information import contour_information
from roundel.scenes.geometry.pose import camera_from_marker_of, minimal_rotation, normal_of
from roundel.validate.metrics.metric import METRICS
from roundel.validate.metrics.pose_errors import (
    _nearest_on_ellipse,
    contour_error_px,
    ellipse_centre_offset_px,
    normal_error_deg,
    pose_error_bounds,
    position_errors,
    reprojection_error_px,
)

PLAIN = Camera(1280, 720, np.array([[1280.0, 0, 639.5], [0, 1280.0, 359.5], [0, 0, 1.0]]))
LENS = Camera(1280, 720, PLAIN.K, (-0.2, 0.05, 0.001, -0.0005))


def scaled(camera: Camera, factor: float) -> Camera:
    k = camera.K.copy()
    k[[0, 1], [0, 1]] *= factor
    return Camera(camera.width_px, camera.height_px, k)


def pose(tilt_deg: float, azimuth_deg: float, centre_m: list[float]) -> np.ndarray:
    return camera_from_marker_of(normal_of(tilt_deg, azimuth_deg), centre_m)


@given(st.floats(0, 180), st.floats(0, 360), st.floats(1e-12, 90))
def test_normal_error_is_the_angle_that_was_turned(tilt: float, azimuth: float, turn: float) -> None:
    a = normal_of(tilt, azimuth)
    across = normal_of(tilt + 90, azimuth)
    b = np.cos(np.radians(turn)) * a + np.sin(np.radians(turn)) * across
    # The vectors' own rounding is 1e-16 rad, i.e. 6e-15 deg, a few times over.
    assert normal_error_deg(a, b) == pytest.approx(turn, rel=1e-12, abs=5e-14)


def test_normal_error_sees_what_acos_cannot() -> None:
    a = np.array([0.0, 0.0, -1.0])
    b = np.array([1e-10, 0.0, -1.0])
    assert normal_error_deg(a, b) == pytest.approx(np.degrees(1e-10), rel=1e-12)


def test_normal_error_broadcasts_and_refuses_other_shapes() -> None:
    assert normal_error_deg(np.ones((4, 1, 3)), np.ones((2, 3))).shape == (4, 2)
    with pytest.raises(ValueError, match="last axis must be 3"):
        normal_error_deg([0.0, 1.0], [0.0, 1.0])


def test_position_errors_by_hand() -> None:
    e = position_errors([[3.0, 0.1, 4.4]], [[3.0, 0.0, 4.0]], [0.1])
    # Error (0, 0.1, 0.4); the ray is (0.6, 0, 0.8).
    assert e.absolute_m[0] == pytest.approx(np.sqrt(0.17))
    assert e.in_D[0] == pytest.approx(np.sqrt(17))
    assert e.percent[0] == pytest.approx(20 * np.sqrt(0.17))
    assert e.along_ray_m[0] == pytest.approx(0.32)
    assert e.across_ray_m[0] == pytest.approx(np.sqrt(0.17 - 0.32**2))


@given(st.floats(-80, 80), st.floats(0.5, 20))
def test_position_error_is_split_at_right_angles(angle: float, distance: float) -> None:
    truth = distance * np.array([np.sin(np.radians(angle)), 0.2, np.cos(np.radians(angle))])
    e = position_errors(truth + np.array([0.03, -0.02, 0.05]), truth, 0.1)
    assert np.hypot(e.along_ray_m, e.across_ray_m) == pytest.approx(e.absolute_m, rel=1e-12)


def test_reprojection_of_the_truth_is_zero() -> None:
    t = pose(40, 30, [0.05, 0.02, 1.5])
    for camera in (PLAIN, LENS):
        assert reprojection_error_px(t, camera, t[:3, 2], t[:3, 3], camera, 0.3) < 1e-10  # rounding of 1e3 px


def test_reprojection_depends_on_the_grid_alone_not_on_which_corner_is_first() -> None:
    centre, normal = [0.02, 0.01, 1.0], normal_of(30, 70)
    estimate, at = normal_of(32, 75), [0.02, 0.012, 1.01]
    errors = [
        reprojection_error_px(camera_from_marker_of(normal, centre, roll), PLAIN, estimate, at, PLAIN, 0.3)
        for roll in (0.0, 90.0, 180.0)
    ]
    # A quarter turn carries the grid to itself; 1e-12 is the rounding of 1e3 px.
    np.testing.assert_allclose(errors, errors[0], rtol=1e-12)
    centre_alone = reprojection_error_px(camera_from_marker_of(normal, centre), PLAIN, estimate, at, PLAIN, 0.0)
    expected = np.linalg.norm(project(PLAIN, np.array(centre)) - project(PLAIN, np.array(at)))
    assert centre_alone == pytest.approx(expected, rel=1e-12)


def test_reprojection_is_without_number_behind_the_camera() -> None:
    t = pose(70, 0, [0.0, 0.0, 0.2])
    assert np.isnan(reprojection_error_px(t, PLAIN, t[:3, 2], t[:3, 3], PLAIN, 0.6))
    assert np.isnan(reprojection_error_px(t, PLAIN, -t[:3, 2], t[:3, 3], PLAIN, 0.01))


def test_reprojection_is_vectorised_over_frames() -> None:
    poses = np.stack([pose(tilt, 20, [0.0, 0.05, 1.0]) for tilt in (10, 30, 50)])
    normal, centre = normal_of([12, 30, 50], 25), poses[:, :3, 3] + [0, 0, 0.01]
    together = reprojection_error_px(poses, PLAIN, normal, centre, LENS, [0.1, 0.2, 0.3])
    alone = [
        reprojection_error_px(poses[i], PLAIN, normal[i], centre[i], LENS, extent)
        for i, extent in enumerate([0.1, 0.2, 0.3])
    ]
    np.testing.assert_allclose(together, alone, rtol=1e-13)


@pytest.mark.parametrize(("distance_D", "factor", "bias_px"), [(15, 0.7, 0.91), (25, 0.7, 0.33), (50, 0.7, 0.08)])
def test_reprojection_bias_of_the_errata(distance_D: float, factor: float, bias_px: float) -> None:
    # Errata, section 5, verdict 3: noise-free bias on the +-1 D grid at alpha = 30. The pose under a wrong focal length
    # is the closed form of the errata's section 2, written out here so that the solver is not asked.
    t = pose(30, 90, [0.0, 0.0, float(distance_D)])
    used = scaled(PLAIN, factor)
    normal, centre = _closed_form(conic_of_circle(t, 0.5, PLAIN.K), used.K, 0.5, t[:3, 2])
    # The errata prints two digits.
    assert reprojection_error_px(t, PLAIN, normal, centre, used, 1.0) == pytest.approx(bias_px, abs=0.006)


def _closed_form(conic: np.ndarray, K: np.ndarray, radius: float, towards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a = K.T @ conic @ K
    values, vectors = np.linalg.eigh(a / np.cbrt(np.linalg.det(a)))
    l3, l2, l1 = values
    e1, e3 = (v * np.sign(v[2]) for v in (vectors[:, 2], vectors[:, 0]))
    cos, sin = np.sqrt((l1 - l2) / (l1 - l3)), np.sqrt((l2 - l3) / (l1 - l3))
    found = []
    for s in (1, -1):
        n = cos * e1 + s * sin * e3
        c = radius * (cos * np.sqrt(-l3 / l1) * e1 - s * sin * np.sqrt(-l1 / l3) * e3)
        found.append((-n, c))
    return min(found, key=lambda pair: float(normal_error_deg(pair[0], towards)))


def test_position_error_of_a_wrong_focal_length_is_the_errata_s() -> None:
    # Errata, section 5, verdict 2: at 15 D and x0.7 the noise-free error is 4.4985 D (its own print, four digits).
    t = pose(30, 90, [0.0, 0.0, 15.0])
    _, centre = _closed_form(conic_of_circle(t, 0.5, PLAIN.K), scaled(PLAIN, 0.7).K, 0.5, t[:3, 2])
    assert position_errors(centre, t[:3, 3], 1.0).in_D == pytest.approx(4.4985, abs=5e-5)


@given(st.floats(5, 200), st.floats(0.1, 1.0), st.floats(0, 180), st.floats(0, 6.28), st.floats(-0.5, 3.0))
def test_nearest_point_on_an_ellipse(a: float, ratio: float, angle: float, turn: float, offset: float) -> None:
    b = a * ratio
    ellipse = np.array([10.0, -20.0, a, b, angle])
    # A point laid off along the normal, no deeper than the evolute, has its foot where it came from.
    depth = offset if offset > 0 else offset * b * b / a
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    rotate = np.array([[cos, -sin], [sin, cos]])
    foot = np.array([a * np.cos(turn), b * np.sin(turn)])
    normal = np.array([np.cos(turn) / a, np.sin(turn) / b])
    point = foot + depth * normal / np.linalg.norm(normal)
    found = _nearest_on_ellipse((rotate @ point + ellipse[:2])[None], ellipse)[0]
    distance = np.linalg.norm(found - (rotate @ point + ellipse[:2]))
    # A thousandth of a pixel or of the distance: the metric is a mean of 256 such lengths.
    assert distance == pytest.approx(abs(depth), rel=1e-3, abs=1e-3)


@given(st.floats(-3, 3))
def test_contour_error_of_a_larger_circle_is_the_difference_of_radii(excess: float) -> None:
    contour = ellipse_points(np.array([300.0, 200.0, 40.0, 40.0, 0.0]), 256)
    assert contour_error_px(contour, [300.0, 200.0, 40 + excess, 40 + excess, 0.0], PLAIN) == pytest.approx(
        abs(excess), abs=1e-9
    )


def test_contour_error_of_a_shifted_circle_is_the_mean_of_the_cosine() -> None:
    contour = ellipse_points(np.array([300.0, 200.0, 80.0, 80.0, 0.0]), 256)
    # mean |cos| = 2 / pi to first order in the shift.
    assert contour_error_px(contour, [300.1, 200.0, 80.0, 80.0, 0.0], PLAIN) == pytest.approx(0.2 / np.pi, rel=1e-3)


def test_image_errors_vanish_through_the_same_lens_and_show_a_missing_one() -> None:
    t = pose(35, 20, [0.3, 0.15, 1.0])
    ellipse = ellipse_of_conic(conic_of_circle(t, 0.05, LENS.K))
    contour = distort_px(LENS, ellipse_points(ellipse, 256))
    assert contour_error_px(contour, ellipse, LENS) < 1e-6  # Newton's inverse of the lens, over 1e3 px
    assert np.all(ellipse_centre_offset_px(ellipse, LENS, ellipse, LENS) == 0)
    shift = np.linalg.norm(distort_px(LENS, ellipse[:2]) - ellipse[:2])
    offset = ellipse_centre_offset_px(ellipse, LENS, ellipse, PLAIN)
    assert np.linalg.norm(offset) == pytest.approx(shift)


def test_contour_error_leaves_missing_points_out() -> None:
    contour = ellipse_points(np.array([300.0, 200.0, 40.0, 40.0, 0.0]), 256)
    contour[:100] = np.nan
    assert contour_error_px(contour, [300.0, 200.0, 41.0, 41.0, 0.0], PLAIN) == pytest.approx(1.0)
    assert np.isnan(contour_error_px(np.full((256, 2), np.nan), [300.0, 200.0, 41.0, 41.0, 0.0], PLAIN))


def test_every_metric_says_what_it_is() -> None:
    assert len({m.column for m in METRICS}) == len(METRICS)
    assert all(m.title and m.unit and m.frame and m.definition.endswith(".") for m in METRICS)


@pytest.mark.parametrize("size", [1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, np.pi - 1e-6, np.pi - 1e-12, np.pi - 1e-15])
def test_normal_error_against_fifty_digits(size: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        a = rng.normal(size=3)
        a /= np.linalg.norm(a)
        across = np.cross(a, rng.normal(size=3))
        b = np.cos(size) * a + np.sin(size) * across / np.linalg.norm(across)
        with mpmath.workdps(50):
            # The angle between the vectors as they are stored, by Kahan's formula, which is exact everywhere.
            u, v = mpmath.matrix(a.tolist()), mpmath.matrix(b.tolist())
            p, q = u / mpmath.norm(u), v / mpmath.norm(v)
            exact = 2 * mpmath.atan2(mpmath.norm(p - q), mpmath.norm(p + q))
            assert abs(mpmath.mpf(float(np.radians(normal_error_deg(a, b)))) - exact) < 1e-12


def test_agreement_with_the_definitions_of_evo() -> None:
    # evo's documentation: the absolute error of a pose is E = Q^-1 P, the relative one of a step from i to j
    # E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j), for a reference Q and an estimate P; their translation part is the norm of E's
    # translation, their rotation angle that of its rotation. A circle's pose has no in-plane rotation: it is carried
    # by the minimal one, and the camera itself is the pose that both sides start from.
    rng = np.random.default_rng(2)
    for _ in range(50):
        camera = np.eye(4)
        camera[:3, :3], camera[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
        truth = pose(rng.uniform(0, 70), rng.uniform(0, 360), [*rng.uniform(-0.3, 0.3, 2), rng.uniform(0.5, 3)])
        estimate = truth.copy()
        normal = normal_of(rng.uniform(0, 70), rng.uniform(0, 360))
        estimate[:3, :3] = minimal_rotation(truth[:3, 2], normal) @ truth[:3, :3]
        estimate[:3, 3] += rng.normal(size=3)
        absolute = np.linalg.inv(truth) @ estimate
        step = [np.linalg.inv(camera) @ (camera @ m) for m in (truth, estimate)]
        relative = np.linalg.inv(step[0]) @ step[1]
        ours = position_errors(estimate[:3, 3], truth[:3, 3], 0.1).absolute_m
        angle = normal_error_deg(normal, truth[:3, 2])
        for error in (absolute, relative):
            assert ours == pytest.approx(np.linalg.norm(error[:3, 3]), abs=1e-9, rel=0)
            turned = np.degrees(Rotation.from_matrix(error[:3, :3]).magnitude())
            assert angle == pytest.approx(turned, abs=1e-9, rel=0)


@given(st.integers(0, 10**6))
def test_errors_do_not_see_from_where_they_are_measured(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_matrix()
    a, b = normal_of(rng.uniform(0, 90, 2), rng.uniform(0, 360, 2))
    assert normal_error_deg(turn @ a, turn @ b) == pytest.approx(float(normal_error_deg(a, b)), abs=1e-12)
    truth, estimate = rng.normal(size=(2, 3))
    one, two = position_errors(estimate, truth, 0.1), position_errors(turn @ estimate, turn @ truth, 0.1)
    for name in ("absolute_m", "in_D", "percent", "along_ray_m", "across_ray_m"):
        assert getattr(one, name) == pytest.approx(float(getattr(two, name)), rel=1e-9, abs=1e-9)


def test_pose_error_in_bounds_is_the_contour_that_was_moved() -> None:
    # What the information promises: a small move w, d changes the sum over edge points of (distance / sigma)^2 by
    # e^T F e. The distances are taken here from the conics themselves, not from F's derivatives.
    rng = np.random.default_rng(3)
    radius, sigma, count = 0.05, 0.3, 200.0
    for _ in range(6):
        t = camera_from_marker_of(
            normal_of(rng.uniform(5, 60), rng.uniform(0, 360)), [0.1, -0.05, rng.uniform(0.5, 2)], rng.uniform(0, 360)
        )
        f = contour_information(t, radius, PLAIN.K, sigma, count)
        w = 1e-5 * rng.normal(size=2)
        d = 1e-6 * rng.normal(size=3)
        normal = Rotation.from_rotvec(t[:3, :2] @ w).as_matrix() @ t[:3, 2]
        found = pose_error_bounds(t, normal, t[:3, 3] + d, f)
        m = t.copy()
        m[:3, :3] = minimal_rotation(t[:3, 2], normal) @ t[:3, :3]
        m[:3, 3] += d
        points = ellipse_points(ellipse_of_conic(conic_of_circle(t, radius, PLAIN.K)), 4000)
        homogeneous = np.column_stack([points, np.ones(len(points))])
        conic = conic_of_circle(m, radius, PLAIN.K)
        slope = 2 * np.linalg.norm((homogeneous @ conic)[:, :2], axis=1)
        away = np.einsum("ni,ij,nj->n", homogeneous, conic, homogeneous) / slope
        weight = np.linalg.norm(np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0), axis=1)
        power = count / sigma**2 * np.sum(weight * away**2) / np.sum(weight)
        # First order in moves of 1e-5, and rounding of a conic's value: 1e-16 of 1e6 over slopes of some 1e3.
        assert found == pytest.approx(np.sqrt(power / 5), rel=1e-3)


def test_pose_error_in_bounds_of_an_efficient_method_is_one() -> None:
    rng = np.random.default_rng(4)
    t = pose(40, 30, [0.05, 0.0, 1.0])
    f = contour_information(t, 0.05, PLAIN.K, 0.1, 150)
    e = rng.multivariate_normal(np.zeros(5), np.linalg.inv(f), size=4000)
    normals = Rotation.from_rotvec(e[:, :2] @ t[:3, :2].T).apply(t[:3, 2])
    found = pose_error_bounds(t, normals, t[:3, 3] + e[:, 2:], f)
    # The RMS of 4,000 chi-square numbers of 5 degrees: 0.5 %; four times that.
    assert np.sqrt(np.mean(found**2)) == pytest.approx(1.0, abs=0.02)
    # Opposite normals are half a turn apart, and no number is lost.
    assert np.isfinite(pose_error_bounds(t, -t[:3, 2], t[:3, 3], f))
    assert np.isnan(pose_error_bounds(t, t[:3, 2], t[:3, 3], np.full((5, 5), np.nan)))


@given(
    st.one_of(
        st.tuples(st.floats(0.5, 1.0), st.floats(0.0, 3.0)), st.tuples(st.floats(0.1, 1.0), st.floats(0.0, 0.02))
    ),
    st.floats(0.0, 6.28),
)
def test_nearest_point_reaches_its_promised_precision(shape: tuple[float, float], turn: float) -> None:
    ratio, depth = shape
    # Points outside, laid off along the normal: the foot is known exactly. 1e-9 of the axis, as the docstring says.
    ellipse = np.array([0.0, 0.0, 1.0, ratio, 0.0])
    foot = np.array([np.cos(turn), ratio * np.sin(turn)])
    normal = np.array([np.cos(turn), np.sin(turn) / ratio])
    point = foot + depth * normal / np.linalg.norm(normal)
    assert np.abs(_nearest_on_ellipse(point[None], ellipse)[0] - foot).max() < 1e-9
