"""The camera: its distortion against OpenCV's, its inverse, its file."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.camera.model import (
    Camera,
    camera_from_json,
    camera_to_json,
    distort_px,
    focal_at_focus_px,
    folds_inside_image,
    principal_point_at_centre,
    project,
    undistort_px,
)
from roundel.scenes.errors import DataError

K = np.array([[1200.0, 0.0, 640.2], [0.0, 1210.0, 355.7], [0.0, 0.0, 1.0]])
small = st.floats(-0.05, 0.05)


@given(k1=st.floats(-0.2, 0.2), k2=small, p1=st.floats(-0.003, 0.003), p2=st.floats(-0.003, 0.003), k3=small)
def test_projection_is_opencvs_and_undistortion_its_inverse(
    k1: float, k2: float, p1: float, p2: float, k3: float
) -> None:
    camera = Camera(1280, 720, K, (k1, k2, p1, p2, k3))
    points = np.random.default_rng(1).uniform([-0.5, -0.28, 1.0], [0.5, 0.28, 1.0], (50, 3)) * [[2.0]]
    ours = project(camera, points)
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(camera.distortion))
    # Two float64 evaluations of one polynomial, at 1,000 px: a few ulps.
    np.testing.assert_allclose(ours, theirs[:, 0], atol=1e-10)
    undistorted = project(Camera(1280, 720, K), points)
    # Newton's method reaches the last bits; 1e-9 px is a thousand ulps.
    np.testing.assert_allclose(undistort_px(camera, ours), undistorted, atol=1e-9)
    np.testing.assert_allclose(distort_px(camera, undistort_px(camera, ours)), ours, atol=1e-9)


def test_four_coefficients_are_five_with_a_zero() -> None:
    grid = np.random.default_rng(0).uniform(0, 700, (20, 2))
    four, five = Camera(1280, 720, K, (-0.1, 0.02, 1e-3, 2e-3)), Camera(1280, 720, K, (-0.1, 0.02, 1e-3, 2e-3, 0.0))
    np.testing.assert_array_equal(distort_px(four, grid), distort_px(five, grid))


def test_a_point_behind_the_camera_has_no_image() -> None:
    assert np.isnan(project(Camera(1280, 720, K), [0.0, 0.0, -1.0])).all()


def test_folding_is_seen() -> None:
    assert not folds_inside_image(Camera(1280, 720, K, (-0.2, 0.05, 0.001, -0.001)))
    assert folds_inside_image(Camera(1280, 720, K, (-2.5, 0.0, 0.0, 0.0)))


def test_principal_point_of_a_centred_camera_follows_opencvs_pixels() -> None:
    # Two pixels: centres at 0 and 1, so the middle of the image is at 0.5.
    assert principal_point_at_centre(2, 1) == (0.5, 0.0)


def test_focal_length_grows_when_focused_close() -> None:
    # f = 50 mm at u = 0.55 m: v = 50 * 550 / 500 = 55 mm; at a pitch of 5 um that is 11,000 px.
    assert focal_at_focus_px(50.0, 0.55, 5.0) == pytest.approx(11_000.0, rel=1e-14)
    assert focal_at_focus_px(50.0, float("inf"), 5.0) == 10_000.0
    with pytest.raises(ValueError, match="inside the focal length"):
        focal_at_focus_px(50.0, 0.05, 5.0)


@pytest.mark.parametrize(
    ("model", "distortion", "written"),
    [
        ("opencv", (), "none"),
        ("opencv", (-0.1, 0.02, 1e-3, 2e-3), "opencv"),
        ("opencv", tuple(0.001 * i for i in range(14)), "opencv"),
        ("fisheye", (0.0, 0.0, 0.0, 0.0), "fisheye"),
    ],
)
def test_camera_file_round_trip(model: str, distortion: tuple[float, ...], written: str) -> None:
    camera = Camera(1280, 720, K, distortion, focal_35mm_mm=26.0, distortion_model=model)
    record = camera_to_json(camera)
    assert record["distortion_model"] == written
    back = camera_from_json(record)
    np.testing.assert_array_equal(back.K, camera.K)
    assert (back.distortion, back.distortion_model) == (distortion, model)
    assert (back.width_px, back.focal_35mm_mm) == (1280, 26.0)


def test_a_camera_file_without_a_model_is_opencvs() -> None:
    record = camera_to_json(Camera(1280, 720, K, (-0.1, 0.02, 1e-3, 2e-3)))
    del record["distortion_model"]
    assert camera_from_json(record).distortion_model == "opencv"


def test_a_lens_model_that_is_none_is_refused() -> None:
    for model, distortion in (("pinhole", ()), ("opencv", (0.1,) * 6), ("fisheye", ()), ("fisheye", (0.1,) * 5)):
        with pytest.raises(ValueError, match="distortion"):
            project(Camera(1280, 720, K, distortion, distortion_model=model), [0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    "broken",
    [
        {},
        {"width_px": 10, "height_px": 10, "K": [[1, 0], [0, 1]]},
        {"width_px": 10, "height_px": 10, "K": [[-1, 0, 5], [0, 1, 5], [0, 0, 1]]},
        {"width_px": 10, "height_px": 10, "K": [[1, 0, 5], [0.1, 1, 5], [0, 0, 1]]},
        {"width_px": 10, "height_px": 10, "K": [[1, 0, float("nan")], [0, 1, 5], [0, 0, 1]]},
        {"width_px": 10, "height_px": 10, "K": [[1, 0, 5], [0, 1, 5], [0, 0, 1]], "distortion": [1, 2]},
        {"width_px": 9, "height_px": 9, "K": [[1, 0, 5], [0, 1, 5], [0, 0, 1]], "distortion_model": "brown"},
        {"width_px": 9, "height_px": 9, "K": [[1, 0, 5], [0, 1, 5], [0, 0, 1]], "distortion_model": "fisheye"},
        {"width_px": 9, "height_px": 9, "K": [[1, 0, 5], [0, 1, 5], [0, 0, 1]], "distortion": [float("inf")] * 4},
        {
            "width_px": 9,
            "height_px": 9,
            "K": [[1, 0, 5], [0, 1, 5], [0, 0, 1]],
            "distortion_model": "none",
            "distortion": [0.1, 0, 0, 0],
        },
        {"width_px": 0, "height_px": 10, "K": [[1, 0, 5], [0, 1, 5], [0, 0, 1]]},
    ],
)
def test_a_broken_camera_file_is_refused(broken: dict) -> None:
    with pytest.raises(DataError, match="camera record") as caught:
        camera_from_json(broken)
    assert "\n" not in str(caught.value)
