"""The fisheye: against OpenCV's, its Jacobian, its exact inverse to 90 degrees and beyond, and its field."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers_lenses import FISHEYE, K_WIDE, image_grid, lens
from helpers_studies import small_study
from hypothesis import assume, given
from hypothesis import strategies as st

from roundel.datasets.fidelity.selection import effects_of
from roundel.scenes.camera.lens_fisheye import angle_of, distort, image_radius, widest_angle
from roundel.scenes.camera.model import (
    Camera,
    denormalise,
    distort_px,
    distorts,
    folds_inside_image,
    project,
    ray_direction,
    undistort_px,
)
from roundel.scenes.errors import StudyError
from roundel.scenes.world.frame import frame_of

coefficients = st.tuples(
    st.floats(-0.05, 0.1), st.floats(-0.005, 0.01), st.floats(-0.001, 0.002), st.floats(-2e-4, 2e-4)
)


@given(coefficients)
def test_forward_is_opencvs(c: tuple[float, float, float, float]) -> None:
    camera = Camera(1280, 720, K_WIDE, c, distortion_model="fisheye")
    points = np.random.default_rng(1).uniform([-2.0, -2.0, 1.0], [2.0, 2.0, 1.0], (50, 3)) * 1.3
    k = K_WIDE.copy()
    k[0, 1] = 0.0
    theirs, _ = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), k, np.array(c), alpha=K_WIDE[0, 1] / K_WIDE[0, 0]
    )
    # Rounding at 1,000 px.
    ours = project(camera, points)
    seen = np.arctan(np.hypot(points[:, 0], points[:, 1]) / points[:, 2]) < widest_angle(c)
    np.testing.assert_allclose(ours[seen], theirs[seen, 0], rtol=0, atol=1e-9)
    assert np.isnan(ours[~seen]).all()


@given(coefficients)
def test_jacobian_is_the_derivative(c: tuple[float, float, float, float]) -> None:
    radius = np.array([0.0, 1e-6, 9.9e-4, 1.01e-3, 0.1, 1.0, 3.0])[:, None]
    points = radius * np.array([np.cos(0.7), np.sin(0.7)])
    _, jacobian = distort(c, points)
    step = 1e-5 * np.eye(2)
    ahead, behind = (distort(c, points[:, None] + sign * step)[0] for sign in (1, -1))
    # Rounding of 1e-16 / 1e-5 and a third derivative of some 10 times 1e-10 / 6.
    np.testing.assert_allclose(jacobian, np.swapaxes(ahead - behind, -1, -2) / 2e-5, rtol=0, atol=1e-8)


@given(coefficients)
def test_the_inverse_is_exact_over_the_whole_image(c: tuple[float, float, float, float]) -> None:
    camera = Camera(1280, 720, K_WIDE, c, distortion_model="fisheye")
    assume(not folds_inside_image(camera))
    image = image_grid(camera)
    ray = ray_direction(camera, image)
    np.testing.assert_allclose(np.linalg.norm(ray, axis=-1), 1.0, atol=1e-15)
    # Forward again from the direction alone, which is defined beyond 90 degrees.
    theta = np.arctan2(np.hypot(ray[:, 0], ray[:, 1]), ray[:, 2])
    phi = np.arctan2(ray[:, 1], ray[:, 0])
    radius = image_radius(c, theta)[0]
    back = denormalise(camera, radius[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=-1))
    assert np.abs(back - image).max() < 1e-11
    straight = undistort_px(camera, image)
    seen = ray[:, 2] > 0
    np.testing.assert_array_equal(np.isfinite(straight).all(axis=1), seen)
    # Towards 90 degrees tan(theta) takes every error times 1 / cos^2: compared relatively, in angle it is rounding.
    assert np.abs(distort_px(camera, straight[seen]) - image[seen]).max() < 1e-10
    within = ray[:, 2] > 0.1
    again = undistort_px(camera, distort_px(camera, straight[within]))
    assert np.abs(again - straight[within]).max() < 1e-9


def test_zeros_are_no_pinhole() -> None:
    camera = lens("equidistant")
    assert distorts(camera)
    assert not distorts(Camera(1280, 720, K_WIDE, (0.0,) * 4))
    # theta_d = theta: 45 degrees are imaged at f pi / 4.
    np.testing.assert_allclose(project(camera, [1.0, 0.0, 1.0])[0], 640.2 + 400 * np.pi / 4, atol=1e-10)


def test_ninety_degrees_and_beyond() -> None:
    camera = lens("equidistant")
    # The last column is seen at 91.6 degrees.
    radius = (1279.0 - 640.2) / 400
    np.testing.assert_allclose(
        ray_direction(camera, [1279.0, 355.7]), [np.sin(radius), 0.0, np.cos(radius)], atol=1e-15
    )
    assert ray_direction(camera, [1279.0, 355.7])[2] < 0
    assert np.isnan(undistort_px(camera, [1279.0, 355.7])).all()
    assert np.isnan(project(camera, [1.0, 0.0, -0.01])).all()
    np.testing.assert_array_equal(ray_direction(camera, [640.2, 355.7]), [0.0, 0.0, 1.0])


def test_a_pinholes_rays() -> None:
    camera = Camera(1280, 720, K_WIDE)
    np.testing.assert_allclose(
        ray_direction(camera, [1040.2, 355.7]), np.array([1.0, 0.0, 1.0]) / np.sqrt(2), atol=1e-15
    )


def test_folding() -> None:
    for name in FISHEYE:
        assert not folds_inside_image(lens(name))
    # theta (1 - 0.15 theta^2) is largest at 1.49 rad, where it is 0.99; the corners are at 1.83.
    bent = Camera(1280, 720, K_WIDE, (-0.15, 0.0, 0.0, 0.0), distortion_model="fisheye")
    assert widest_angle(bent.distortion) == pytest.approx(np.sqrt(1 / 0.45), rel=1e-12)
    assert folds_inside_image(bent)
    assert np.isnan(ray_direction(bent, [1279.0, 719.0])).all()
    # The same lens on a sensor half as large is one.
    k = np.array([[400.0, 0.0, 200.0], [0.0, 400.0, 150.0], [0.0, 0.0, 1.0]])
    assert not folds_inside_image(Camera(401, 301, k, bent.distortion, distortion_model="fisheye"))
    # No lens sees farther than all round: corners at more than pi.
    k = np.array([[200.0, 0.0, 639.5], [0.0, 200.0, 359.5], [0.0, 0.0, 1.0]])
    assert folds_inside_image(Camera(1280, 720, k, (0.0,) * 4, distortion_model="fisheye"))


def test_a_branch_beyond_the_fold_is_never_the_answer() -> None:
    # Grows to 0.72 at 1.05 rad, falls to 0.61 at 1.6, and grows again: 0.75 is met at 1.95 rad only.
    c = (-0.4, 0.07, 0.0, 0.0)
    widest = widest_angle(c)
    largest = float(image_radius(c, np.array(widest))[0])
    beyond = np.linspace(widest, np.pi, 1000)
    assert (image_radius(c, beyond)[0] > largest + 0.01).any()
    assert np.isnan(angle_of(c, np.array([largest + 0.01]))).all()
    assert np.isnan(distort(c, np.array([[np.tan(widest + 0.01), 0.0]]))[0]).all()
    np.testing.assert_allclose(angle_of(c, image_radius(c, np.array([0.9 * widest]))[0]), 0.9 * widest, rtol=1e-14)


@pytest.mark.parametrize(("focal_px", "fits"), [(120, True), (40, False)])
def test_an_aperture_on_a_fisheye_that_sees_to_the_side_is_refused(tmp_path: Path, focal_px, fits) -> None:
    lens = f"focal_px: {focal_px}, distortion_model: fisheye, distortion: [0, 0, 0, 0], aperture_mm: 2, focus_m: 0.5"
    study = small_study(tmp_path, ("focal_px: 320", lens))
    if fits:
        frame_of(study, 0)
        return
    with pytest.raises(StudyError, match="a thin lens cannot focus rays at 90 degrees from its axis") as caught:
        frame_of(study, 0)
    assert caught.value.line == 4


def test_a_fisheye_without_coefficients_still_counts_as_distortion(tmp_path: Path) -> None:
    lens = ("focal_px: 320", "focal_px: 320, distortion_model: fisheye, distortion: [0, 0, 0, 0]")
    assert effects_of(frame_of(small_study(tmp_path, lens), 0)) == ["distortion"]
