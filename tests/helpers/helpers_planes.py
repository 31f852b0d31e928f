"""Random views of a plane with exact points, for its pose and the focal length."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of, transform_points

Array = NDArray[np.float64]

SIDE_M = 0.08
SQUARE = np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]]) * SIDE_M / 2


def pinhole(focal_px: float) -> Camera:
    return Camera(640, 480, np.array([[focal_px, 0, 319.5], [0, focal_px, 239.5], [0, 0, 1.0]]))


@dataclass(frozen=True)
class PlaneView:
    """A true camera and pose, and the exact image (N, 2) of the points."""

    camera: Camera
    camera_from_marker: Array
    pixels: Array


def plane_views(
    count: int, seed: int, points_m: Array = SQUARE, tilt_deg: tuple[float, float] = (5, 65)
) -> Iterator[PlaneView]:
    """Views with focal lengths of 400 to 1200 px, distances of 3 to 12 sides, and any azimuth and roll."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        camera, distance = pinhole(rng.uniform(400, 1200)), SIDE_M * rng.uniform(3, 12)
        centre = np.array([*(rng.uniform(-0.25, 0.25, 2) * distance), distance])
        roll = rng.uniform(0, 2 * np.pi)
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]]
        pose = camera_from_marker_of(normal_of(rng.uniform(*tilt_deg), rng.uniform(-180, 180)), centre) @ turn
        yield PlaneView(camera, pose, project(camera, transform_points(pose, points_m)))
