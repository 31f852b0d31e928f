"""OpenCV's lens model: its forward map against OpenCV's own, its Jacobian, its exact inverse, and its field."""

import cv2
import numpy as np
import pytest
from helpers_lenses import OPENCV, K, image_grid, lens
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from roundel.scenes.camera.lens_opencv import distort, field_of, tilt_matrix
from roundel.scenes.camera.model import (
    Camera,
    denormalise,
    distort_normalised,
    distort_px,
    folds_inside_image,
    normalise,
    project,
    undistort_normalised,
    undistort_px,
)

SQUARE = np.array([[913.0, 0.0, 641.2], [0.0, 905.0, 355.7], [0.0, 0.0, 1.0]])

# How far each coefficient is drawn from that of a real lens.
SPREAD = (0.05, 0.05, 0.003, 0.003, 0.03, 0.05, 0.05, 0.03, 0.005, 0.005, 0.005, 0.005, 0.08, 0.08)


@st.composite
def coefficients(draw: st.DrawFn) -> tuple[float, ...]:
    base = OPENCV[draw(st.sampled_from(["4", "5", "8", "12", "14"]))]
    return tuple(b + draw(st.floats(-s, s)) for b, s in zip(base, SPREAD, strict=False))


@given(coefficients())
def test_forward_is_opencvs(c: tuple[float, ...]) -> None:
    points = np.random.default_rng(1).uniform([-0.8, -0.6, 1.0], [0.8, 0.6, 1.0], (60, 3)) * 1.7
    ours = project(Camera(1280, 720, SQUARE, c), points)
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), SQUARE, np.array(c))
    seen = np.isfinite(ours).all(axis=1)
    # Two float64 evaluations at 1,000 px, with coefficients up to 3: rounding is some 1e-12 px.
    np.testing.assert_allclose(ours[seen], theirs[seen, 0], rtol=0, atol=1e-9)
    # What has no image here lies beyond the determinant's first zero, which is never near the axis.
    assert seen[np.hypot(points[:, 0], points[:, 1]) < 0.9].all()


@settings(max_examples=40)
@given(coefficients())
def test_the_inverse_is_exact_over_the_whole_image(c: tuple[float, ...]) -> None:
    camera = Camera(1280, 720, K, c)
    assume(not folds_inside_image(camera))
    image = image_grid(camera, 33, 19)
    straight = undistort_px(camera, image)
    # The promise is 1e-5 px. Rounding of 1e-16 in normalised coordinates is 1e-13 px; where the lens squeezes a corner
    # tenfold, undistorted pixels see ten times that.
    assert np.abs(distort_px(camera, straight) - image).max() < 1e-9
    assert np.abs(undistort_px(camera, distort_px(camera, straight)) - straight).max() < 1e-8


@pytest.mark.parametrize("name", OPENCV)
def test_round_trips_of_real_lenses(name: str) -> None:
    camera = lens(name)
    assert not folds_inside_image(camera)
    image = image_grid(camera, 161, 91)
    straight = undistort_px(camera, image)
    assert np.abs(distort_px(camera, straight) - image).max() < 1e-11
    assert np.abs(undistort_px(camera, distort_px(camera, straight)) - straight).max() < 1e-11


@given(coefficients())
def test_jacobian_is_the_derivative(c: tuple[float, ...]) -> None:
    points = np.random.default_rng(2).uniform(-0.6, 0.6, (20, 2))
    step = 1e-5 * np.eye(2)
    _, jacobian = distort(c, points)
    ahead, behind = (distort(c, points[:, None] + sign * step)[0] for sign in (1, -1))
    numeric = np.swapaxes(ahead - behind, -1, -2) / 2e-5
    # Central differences: the third derivative, some 100 at most, times 1e-10 / 6, and rounding of 1e-16 / 1e-5.
    np.testing.assert_allclose(jacobian, numeric, rtol=0, atol=1e-8)


def test_the_tilted_sensor_keeps_the_axis() -> None:
    homography = tilt_matrix(0.2, -0.3)
    np.testing.assert_allclose((homography @ [0.0, 0.0, 1.0])[:2], 0.0, atol=1e-16)
    theirs, _ = cv2.projectPoints(
        np.array([[0.1, 0.2, 1.0]]), np.zeros(3), np.zeros(3), np.eye(3), np.array([0.0] * 12 + [0.2, -0.3])
    )
    by_hand = homography @ [0.1, 0.2, 1.0]
    np.testing.assert_allclose(theirs[0, 0], by_hand[:2] / by_hand[2], atol=1e-15)


def test_missing_coefficients_are_zeros() -> None:
    grid = image_grid(lens("4"))
    expected = distort_px(lens("4"), grid)
    for count in (5, 8, 12, 14):
        padded = Camera(1280, 720, K, OPENCV["4"] + (0.0,) * (count - 4))
        np.testing.assert_array_equal(distort_px(padded, grid), expected)


# r (1 - 0.6 r^2 + 0.13 r^4) grows up to r = 0.877, where it is 0.540, falls, and grows again beyond r = 1.414.
BENT = (-0.6, 0.13, 0.0, 0.0)


def test_a_third_branch_is_never_the_answer() -> None:
    third = 1.75
    image, _ = distort(BENT, np.array([[0.5, 0.0]]))
    polynomial = third * (1 - 0.6 * third**2 + 0.13 * third**4)
    assert (
        polynomial > 0.55
    )  # beyond the largest image of the first branch: only the third has an answer, and it is exact
    assert np.isnan(undistort_normalised(Camera(640, 480, K, BENT), [polynomial, 0.0])).all()
    np.testing.assert_allclose(undistort_normalised(Camera(640, 480, K, BENT), image[0]), [0.5, 0.0], atol=1e-15)
    # And what lies on the second and third branch has no image, though the formula has a pixel for it.
    assert np.isnan(distort(BENT, np.array([[1.2, 0.0], [third, 0.0]]))[0]).all()
    near, far = (
        Camera(*size, np.array([[500.0, 0, (size[0] - 1) / 2], [0, 500.0, (size[1] - 1) / 2], [0, 0, 1]]), BENT)
        for size in ((300, 300), (600, 600))
    )
    assert not folds_inside_image(near)  # corners at 0.42
    assert folds_inside_image(far)  # corners at 0.85


@given(st.floats(-1.0, 1.0), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
def test_the_first_fold_is_where_the_determinant_vanishes(k2: float, p1: float, p2: float) -> None:
    c = (-0.4 - abs(k2), k2 / 10, p1, p2)
    field = field_of(c)
    assert np.isfinite(field.edge).all()
    angle = np.arange(33) * 2 * np.pi / 32
    edge = field.edge[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    inward = distort(c, edge * (1 - 1e-9))[1]
    np.testing.assert_allclose(np.linalg.det(inward[np.isfinite(inward).all(axis=(1, 2))]), 0.0, atol=1e-6)
    assert np.isfinite(distort(c, edge * 0.999)[0]).all()
    assert np.isnan(distort(c, edge * 1.001)[0]).all()


def test_a_fold_between_two_samples_is_found() -> None:
    # d/dr r (1 + k1 u + k2 u^2) = 1 + 3 k1 u + 5 k2 u^2 touches zero at u = 0.36 and dips below over 1e-4 of it.
    u = 0.36
    k1, k2 = -2 / (3 * u), 1 / (5 * u * u)
    assert np.isinf(field_of((k1, k2 * (1 + 1e-7), 0.0, 0.0)).edge[0])
    assert field_of((k1, k2 * (1 - 1e-7), 0.0, 0.0)).edge[0] == pytest.approx(0.6, abs=5e-3)


def test_poles_of_the_rational_model() -> None:
    # 1 / (1 - r^2) has a pole at r = 1, and grows without bound on the way: the whole plane is imaged before it.
    division = Camera(1280, 720, K, (0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0))
    assert not folds_inside_image(division)
    assert np.linalg.norm(normalise(division, undistort_px(division, image_grid(division))), axis=-1).max() < 1.0
    # (1 - 1.2 r^2) / (1 - r^2) turns round before its pole.
    assert folds_inside_image(Camera(1280, 720, K, (-1.2, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0)))
    # A pole that the numerator all but cancels, far narrower than any grid: everything beyond r = 0.5 is behind it.
    hidden = Camera(1280, 720, K, (-4.0 - 1e-9, 0.0, 0.0, 0.0, 0.0, -4.0, 0.0, 0.0))
    assert folds_inside_image(hidden)
    assert np.isnan(distort_normalised(hidden, [0.6, 0.0])[0]).all()


def test_a_sensor_tilted_to_its_horizon_folds() -> None:
    # y / (cos tx - y sin tx) is above -1 / sin tx for every y in front of the lens: that is where the image ends.
    wide = np.array([[300.0, 0.0, 640.0], [0.0, 300.0, 360.0], [0.0, 0.0, 1.0]])
    assert not folds_inside_image(Camera(1280, 720, wide, (0.0,) * 12 + (0.95, 0.0)))
    assert folds_inside_image(Camera(1280, 720, wide, (0.0,) * 12 + (1.05, 0.0)))


def test_points_far_outside_do_not_return_into_the_image() -> None:
    # At 68 degrees from the axis r (1 - 0.16 r^2) is back at 0.05: a pixel near the centre, for a point out of sight.
    camera = Camera(1280, 720, K, (-0.16, 0.0, 0.0, 0.0))
    assert not folds_inside_image(camera)
    theirs, _ = cv2.projectPoints(
        np.array([[2.48, 0.0, 1.0]]), np.zeros(3), np.zeros(3), K, np.array(camera.distortion)
    )
    assert 641 < theirs[0, 0, 0] < 720
    assert np.isnan(project(camera, [2.48, 0.0, 1.0])).all()


def test_shapes_and_empty_arrays() -> None:
    camera = lens("14")
    assert undistort_px(camera, np.empty((0, 2))).shape == (0, 2)
    grid = image_grid(camera, 5, 4).reshape(4, 5, 2)
    together = undistort_px(camera, grid)
    # One point at a time is the same to rounding: the fixed number of steps depends on the worst point of an array.
    alone = np.array([[undistort_px(camera, p) for p in row] for row in grid])
    np.testing.assert_allclose(together, alone, atol=1e-11)
    assert np.isnan(undistort_px(camera, [np.nan, 3.0])).all()
    back = denormalise(camera, distort_normalised(camera, normalise(camera, together))[0])
    np.testing.assert_allclose(back, grid, atol=1e-11)
