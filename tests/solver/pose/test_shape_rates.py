"""The image of a circle in closed form, and the poses of a contour that the lens model has no place for."""

import numpy as np
import pytest

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.row_time import RowTime
from roundel.scenes.geometry.information import shape_of_pose
from roundel.scenes.geometry.pose import camera_from_marker_of
from roundel.solver.pose.centre_rows import MovingEllipse, poses_at_centre_rows
from roundel.solver.pose.shape_rates import image_shape

K = np.array([[1180.0, 0.3, 320.0], [0.0, 1175.0, 240.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("tilt_deg", [0.0, 25.0, 70.0])
@pytest.mark.parametrize("distance", [5.0, 40.0])
def test_the_image_of_a_circle(tilt_deg, distance):
    radius_m, centre = 0.04, np.array([0.3, -0.2, distance]) * 0.08
    tilt = np.radians(tilt_deg)
    normal = np.array([0.6 * np.sin(tilt), 0.8 * np.sin(tilt), -np.cos(tilt)])
    shape = image_shape(normal, centre / radius_m, K)
    # The dual conic loses (distance from the origin over size)^2 of 1e-16.
    assert np.allclose(shape, shape_of_pose(camera_from_marker_of(normal, centre), radius_m, K), atol=1e-8)


def test_a_moving_contour_outside_the_lens_model():
    camera = Camera(640, 480, np.array([[400.0, 0, 320], [0, 400, 240], [0, 0, 1]]), (-0.3, 0, 0, 0))
    ellipse = np.array([1500.0, 240.0, 30.0, 25.0, 10.0])
    rates_cov = np.concatenate([np.zeros((5, 5)), np.eye(5)], axis=1)
    moving = MovingEllipse(ellipse, np.ones(5), np.eye(5) * 1e-4, rates_cov, 240.0)
    with pytest.raises(ValueError, match="outside the field of the camera's lens model"):
        poses_at_centre_rows(moving, camera, RowTime(0.02, 0.1, 8.0), 0.04, 0.0, 0.0)
