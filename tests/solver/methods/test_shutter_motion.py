"""Poses from images of a moving camera, with rows read one after another: errors against the reported covariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.motion import exp_twist
from roundel.scenes.camera.row_time import RowTime
from roundel.scenes.geometry.information import shape_of_pose
from roundel.scenes.geometry.pose import camera_from_marker_of, minimal_rotation
from roundel.solver.fit.edges import EdgePoints, edge_points
from roundel.solver.fit.ellipse import ellipse_of_shape
from roundel.solver.fit.pixel_covariance import PixelFit
from roundel.solver.fit.pixel_fit import fit_pixels
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.fit_poses import poses_of_fits
from roundel.solver.methods.shutter_motion import motions_of

CAMERA = Camera(480, 480, np.array([[1180.0, 0, 239.5], [0, 1180.0, 239.5], [0, 0, 1]]))
RADIUS_M, EXPOSURE_S = 0.04, 0.001
SUBROWS, INSTANTS = 16, 5
GUESS = np.array([0.4, -0.3, 0.3, 0.2, 0.0])


def row_by_row(shapes, along_x):
    """Share of ink of the pixels of an image: exact along the rows, of which each has its own ellipses (480, n, 5)."""
    if along_x:
        return row_by_row(shapes[..., [1, 0, 4, 3, 2]], False).T
    x, y, s11, s12, s22 = np.moveaxis(shapes, -1, 0)[..., None]
    m11, m12, m22 = s11**2 + s12**2, s12 * (s11 + s22), s12**2 + s22**2
    # The chord at a height h from the centre: x + h m12 / m22 +- sqrt(det M (m22 - h^2)) / m22.
    rows = np.arange(480)[:, None, None] + (np.arange(SUBROWS) + 0.5) / SUBROWS - 0.5
    h = rows - y
    middle, half = x + h * m12 / m22, np.sqrt((m11 * m22 - m12**2) * np.maximum(m22 - h * h, 0.0)) / m22
    left = np.arange(480) - 0.5
    inked = np.zeros((480, 480))
    for i in np.flatnonzero(np.any(half > 0, axis=(1, 2))):
        a, b = (middle[i] - half[i]).ravel()[:, None], (middle[i] + half[i]).ravel()[:, None]
        inked[i] = np.mean(np.clip(np.minimum(b, left + 1) - np.maximum(a, left), 0.0, 1.0), axis=0)
    return inked


def seen(pose, twist, row_time, rng):
    """The image of a circle, with shot noise, at the pose (4, 4) at mid-exposure of its centre's row."""
    along = 0 if row_time.along_x else 1
    centre = CAMERA.K @ pose[:3, 3]
    row_s = row_time.row_s(CAMERA.width_px, CAMERA.height_px)
    start_s = (np.arange(480) - centre[along] / centre[2]) * row_s
    times = start_s[:, None] + EXPOSURE_S * ((np.arange(INSTANTS) + 0.5) / INSTANTS - 0.5)
    # Over its few rows the circle's ellipse is a quadratic of the time.
    knots = np.array([-1.0, 0.0, 1.0]) * max(80 * row_s, EXPOSURE_S)
    at = [shape_of_pose(exp_twist(twist, -t) @ pose, RADIUS_M, CAMERA.K) for t in knots]
    shapes = np.stack([np.polyval(np.polyfit(knots, of, 2), times) for of in np.transpose(at)], axis=-1)
    light = 200.0 - 180.0 * row_by_row(shapes, row_time.along_x)
    return (light + rng.normal(size=light.shape) * np.sqrt(0.1 + light / 40)).astype(np.float32), at[1]


def chi_square(normal, centre, cov, pose):
    axes = minimal_rotation([0.0, 0.0, 1.0], normal)[:, :2].T
    basis = np.zeros((5, 6))
    basis[:3, :3], basis[3:, 3:] = np.eye(3), axes
    error = basis @ np.concatenate([centre - pose[:3, 3], normal - pose[:3, 2]])
    return float(error @ np.linalg.solve(basis @ cov @ basis.T, error))


@pytest.mark.parametrize(
    ("readout_s", "along_x"), [(0.0, False), (0.033, False), (0.033, True)], ids=["global", "rows", "columns"]
)
def test_the_covariance_holds_the_errors_of_a_hand_held_camera(readout_s, along_x):
    row_time = RowTime(readout_s, 0.1, 8.66, along_x)
    camera = UncertainCamera(CAMERA, row_time=row_time)
    rng = np.random.default_rng(3)
    squares = []
    for tilt, azimuth, distance, u, v in rng.uniform([10, -180, 0.8, -80, -80], [50, 180, 1.6, 80, 80], size=(60, 5)):
        turn = np.radians([tilt, azimuth])
        normal = [np.sin(turn[0]) * np.cos(turn[1]), np.sin(turn[0]) * np.sin(turn[1]), -np.cos(turn[0])]
        pose = camera_from_marker_of(normal, distance * np.array([u / 1180, v / 1180, 1.0]))
        image, shape = seen(pose, rng.normal(size=6) * row_time.twist_sigma, row_time, rng)
        edges = edge_points(image, ellipse_of_shape(shape) + GUESS)
        assert isinstance(edges, EdgePoints)
        (motion,) = motions_of(camera, edges.ellipse[None], RADIUS_M)
        fit = fit_pixels(image, edges, CAMERA, motion=motion)
        assert isinstance(fit, PixelFit)
        (posed,) = poses_of_fits([fit], camera, RADIUS_M)
        assert isinstance(posed, tuple)
        poses, cov = posed
        assert cov is not None
        near = int(np.argmax(poses.normal @ pose[:3, 2]))
        squares.append(chi_square(poses.normal[near], poses.centre_m[near], cov[near], pose))
    # Chi-square of five degrees of freedom: mean 5, sqrt(10 / 60) = 0.41 for 60 of them.
    assert np.mean(squares) == pytest.approx(5.0, abs=3 * 0.41), np.sort(squares)
    assert np.max(squares) < 37.1  # five sigma
    # 95 % of 60 with a standard deviation of 2.8 %: the region of a curved distribution holds a little less.
    assert np.mean(np.array(squares) < chi2.ppf(0.95, 5)) > 0.87
