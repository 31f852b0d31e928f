"""A camera turned by quarter turns images the turned world at the turned pixels."""

import numpy as np
import pytest

from roundel.scenes.camera.model import Camera, project
from roundel.scenes.camera.quarter_turns import TURNS, can_turn, turned_camera

CAMERA = Camera(
    640, 480, np.array([[700.0, 0, 322], [0, 707, 236], [0, 0, 1]]), (-0.2, 0.05, 1.1e-3, -6e-4, 0.01)
)  # fmt: skip
POINTS = np.random.default_rng(3).uniform([-0.2, -0.15, 0.6], [0.2, 0.15, 1.0], (40, 3))


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_what_a_viewer_shows(orientation: int) -> None:
    camera, _ = turned_camera(CAMERA, None, TURNS[orientation])
    x, y = project(CAMERA, POINTS).T
    # EXIF: 6 is shown turned clockwise, 8 anticlockwise; the world turns with the image.
    width, height = CAMERA.width_px, CAMERA.height_px
    shown = {1: (x, y), 6: (height - 1 - y, x), 3: (width - 1 - x, height - 1 - y), 8: (y, width - 1 - x)}[orientation]
    right, down, away = POINTS.T
    world = {1: (right, down), 6: (-down, right), 3: (-right, -down), 8: (down, -right)}[orientation]
    assert (camera.width_px, camera.height_px) == ((480, 640) if orientation in (6, 8) else (640, 480))
    np.testing.assert_allclose(project(camera, np.stack([*world, away], axis=-1)), np.stack(shown, axis=-1), atol=1e-9)


def test_the_covariance_turns_with_the_parameters() -> None:
    root = np.random.default_rng(0).normal(size=(9, 9))
    covariance = root @ root.T
    camera, turned = turned_camera(CAMERA, covariance, 1)
    assert turned is not None
    # fy became fx, cy became cx backwards, p2 became p1.
    assert turned[0, 0] == pytest.approx(covariance[1, 1])
    assert turned[0, 2] == pytest.approx(-covariance[1, 3])
    assert turned[6, 6] == pytest.approx(covariance[7, 7])
    back, whole = turned_camera(camera, turned, 3)
    np.testing.assert_allclose(whole, covariance, rtol=1e-12)
    np.testing.assert_allclose(back.K, CAMERA.K, rtol=1e-12)
    assert back.distortion == pytest.approx(CAMERA.distortion)


def test_lenses_that_cannot_be_turned() -> None:
    assert can_turn(CAMERA)
    assert not can_turn(Camera(640, 480, CAMERA.K, (0.1,) * 12))
    assert not can_turn(Camera(640, 480, CAMERA.K + np.array([[0, 2.0, 0], [0, 0, 0], [0, 0, 0]])))
