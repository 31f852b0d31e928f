"""Predicted ellipses and their derivatives by every parameter."""

from dataclasses import replace

import numpy as np
import pytest
from helpers_boards import GRID, GRID_CAMERA, exact_dots, grid_contours, grid_poses

from roundel.scenes.camera.model import Camera
from roundel.solver.calibration.contour_model import CONTOUR_POINTS, Model, contours_px, predicted_shapes, rotations

VIEWS = np.array(grid_poses(3, seed=2))
DOTS = exact_dots(GRID_CAMERA, VIEWS, GRID)
MODEL = Model(GRID_CAMERA, GRID.diameter_m, VIEWS)


def test_contours_are_those_of_the_camera() -> None:
    expected = np.concatenate([grid_contours(GRID_CAMERA, p, GRID, CONTOUR_POINTS) for p in VIEWS])
    np.testing.assert_allclose(contours_px(MODEL, DOTS), expected, atol=1e-10)


def test_predicted_ellipses_are_those_of_exact_dots() -> None:
    np.testing.assert_allclose(predicted_shapes(MODEL, DOTS)[0], DOTS.shape, atol=1e-8)


@pytest.mark.parametrize("bend_m", [(), (2e-3, -1e-3, 1e-3, 5e-4, 0.0, -1e-3, 1e-3)])
@pytest.mark.parametrize("lens", [None, replace(GRID_CAMERA, distortion=(-0.2, 0.05, 0.0, 0.0))])
@pytest.mark.parametrize("count", [4, 5])
def test_derivatives(lens: Camera | None, count: int, bend_m: tuple[float, ...]) -> None:
    camera = replace(GRID_CAMERA, distortion=(*GRID_CAMERA.distortion, 0.02)[:count])
    model, dots = replace(MODEL, camera=camera, bend_m=np.array(bend_m)), replace(DOTS, lens=lens)
    _, jacobian = predicted_shapes(model, dots)
    size = count + 6 + len(bend_m)
    for i in range(size + 6):
        # Steps that move the contours by some thousandths of a pixel.
        step = 1e-3 if i < 4 else 1e-6
        change = np.zeros(size + 6)
        change[i] = step
        shapes = [
            predicted_shapes(model.moved(sign * change[:size], np.tile(sign * change[size:], (3, 1))), dots)[0]
            for sign in (1, -1)
        ]
        numeric = (shapes[0] - shapes[1]) / (2 * step)
        scale = np.abs(numeric).max()
        # To first order in the contours' distances from their ellipses, 1e-3 of the radius.
        np.testing.assert_allclose(jacobian[..., i] / scale, numeric / scale, atol=2e-3)


def test_rotations_are_exact_near_zero() -> None:
    vectors = np.array([[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [0.3, -0.4, 1.2]])
    found = rotations(vectors)
    np.testing.assert_allclose(found @ found.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (3, 3, 3)), atol=1e-15)
    assert found[1, 2, 1] == pytest.approx(1e-9, rel=1e-12)
    assert np.trace(found[2]) == pytest.approx(1 + 2 * np.cos(1.3))


def test_a_dot_behind_the_camera_has_no_image() -> None:
    away = VIEWS.copy()
    away[0, 2, 3] = -0.4
    shape, _ = predicted_shapes(replace(MODEL, poses=away), DOTS)
    assert np.isnan(shape[DOTS.view == 0]).all()
    assert np.isfinite(shape[DOTS.view > 0]).all()
