"""Calibration from pictures: without the bias of circle centres, and with one sentence for what is no calibration."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers_boards import ASYMMETRIC_GRID, GRID, GRID_CAMERA, grid_image, grid_poses
from numpy.typing import NDArray

from roundel.scenes.errors import DataError, NotComparableError
from roundel.solver.calibration.calibrate_images import calibrate_images
from roundel.solver.calibration.grid_layout import GridLayout, layout_of

VIEWS = grid_poses(6, seed=1)
# Near and wide: circle centres are displaced by a^2 sin(2 tilt) / (2 f), half a pixel here.
WIDE = replace(GRID_CAMERA, K=np.array([[400.0, 0.0, 322.0], [0.0, 402.0, 236.0], [0.0, 0.0, 1.0]]))
NEAR = grid_poses(6, seed=1, distance_m=0.24)


@pytest.fixture(scope="module")
def pictures() -> list[NDArray[np.uint8]]:
    return [grid_image(WIDE, p, GRID, 0.5, seed=i) for i, p in enumerate(NEAR)]


def opencv(pictures: list[NDArray[np.uint8]]) -> NDArray[np.float64]:
    board = np.column_stack([GRID.centres_m(), np.zeros(30)]).astype(np.float32)
    found = [cv2.findCirclesGrid(image, (6, 5)) for image in pictures]
    assert all(ok for ok, _ in found)
    size = GRID_CAMERA.width_px, GRID_CAMERA.height_px
    points = [board] * len(found)
    _, k, _, _, _ = cv2.calibrateCamera(points, [c for _, c in found], size, None, None, flags=cv2.CALIB_FIX_K3)
    return np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2]])


def test_no_bias_of_circle_centres(pictures: list[NDArray[np.uint8]]) -> None:
    found = calibrate_images(pictures, GRID, "linear")
    k, true = found.camera.K, WIDE.K
    errors = np.array([k[0, 0] - true[0, 0], k[1, 1] - true[1, 1], k[0, 2] - true[0, 2], k[1, 2] - true[1, 2]])
    # Four standard deviations: four numbers of one run, one chance in 4,000.
    assert np.all(np.abs(errors) < 4 * np.sqrt(np.diag(found.covariance))[:4])
    assert np.abs(errors).max() < 0.1
    theirs = opencv(pictures) - np.array([true[0, 0], true[1, 1], true[0, 2], true[1, 2]])
    assert np.linalg.norm(theirs) > 3 * np.linalg.norm(errors)
    assert found.chi_square < 1.5
    assert len(found.views) == 6


def test_an_asymmetric_grid(pictures: list[NDArray[np.uint8]]) -> None:
    found = calibrate_images(
        [grid_image(GRID_CAMERA, p, ASYMMETRIC_GRID, seed=9) for p in VIEWS[:4]], ASYMMETRIC_GRID, "linear"
    )
    assert found.used == 4 * 28
    sigma = np.sqrt(np.diag(found.covariance))
    assert abs(found.camera.K[0, 0] - 700.0) < 4 * sigma[0]


def test_views_without_the_board_are_missed(pictures: list[NDArray[np.uint8]]) -> None:
    blank = np.full((480, 640), 128, dtype=np.uint8)
    found = calibrate_images([blank, *pictures[:3], blank], GRID, "linear")
    assert found.views == [1, 2, 3]
    with pytest.raises(NotComparableError, match="the circle grid was found in 2 of 3 views; a calibration needs 3"):
        calibrate_images([blank, *pictures[:2]], GRID, "linear")


def test_another_board_is_not_found(pictures: list[NDArray[np.uint8]]) -> None:
    with pytest.raises(NotComparableError, match=r"found in 0 of 3 views.*check its columns"):
        calibrate_images(pictures[:3], GridLayout(6, 5, 0.03, 0.009), "linear")


def test_images_and_layouts_that_are_none(pictures: list[NDArray[np.uint8]]) -> None:
    with pytest.raises(ValueError, match="2 sizes; calibrate one camera at a time"):
        calibrate_images([*pictures[:3], pictures[0][:-1]], GRID)
    with pytest.raises(ValueError, match=r"dots of 0\.04 m touch at a distance of 0\.03 m"):
        calibrate_images(pictures[:3], GridLayout(6, 5, 0.03, 0.04))
    with pytest.raises(NotComparableError, match="found in 0 of 0 views"):
        calibrate_images([], GRID)


def test_layouts_of_records() -> None:
    record = {"columns": 4, "rows": 7, "spacing_m": 0.02, "diameter_m": 0.014, "layout": "asymmetric"}
    assert layout_of(record) == ASYMMETRIC_GRID
    for wrong in ({}, {**record, "layout": "round"}, {**record, "rows": 1}, {**record, "spacing_m": float("nan")}):
        with pytest.raises(DataError, match="a circle grid's layout"):
            layout_of(wrong)
