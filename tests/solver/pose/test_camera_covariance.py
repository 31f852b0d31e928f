"""What an uncertain camera does to ellipse and pose: derivatives against a second fit, coverage over drawn cameras."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.stats import chi2

from roundel.scenes.camera.model import Camera, denormalise, distort_px, normalise, undistort_px
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of, transform_points
from roundel.solver.fit.ellipse import EllipseFit, ellipse_of_shape, shape_of_ellipse
from roundel.solver.intrinsics.specification import parse_intrinsics, uncertain_camera_for
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.fit_poses import poses_of_fits
from roundel.solver.pose.camera_covariance import shape_by_camera, shape_covariance_of_camera
from roundel.solver.pose.pose_covariance import poses_with_covariance
from roundel.validate.metrics.uncertainty import uncertainty_scores

K = np.array([[1180.0, 0, 646], [0, 1175, 352], [0, 0, 1]])
CAMERA = Camera(1280, 720, K, (-0.12, 0.06, 0.0008, -0.0005))
ANGLES = 2 * np.pi * np.arange(48) / 48
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES)])


def contour(shape):
    x, y, s11, s12, s22 = shape
    return (np.array([x, y]) + (np.array([[s11, s12], [s12, s22]]) @ CIRCLE).T).copy()


def refitted(points, start, weight):
    """Shape of the ellipse of least weighted distances, to first order, from points near it."""

    def distance(shape):
        x, y, s11, s12, s22 = shape
        matrix = np.array([[s11, s12], [s12, s22]])
        unit = np.linalg.solve(matrix, (points - [x, y]).T)
        length = np.linalg.norm(unit, axis=0)
        gradient = np.linalg.solve(matrix, unit / length)
        return weight * (length - 1) / np.linalg.norm(gradient, axis=0)

    return least_squares(distance, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x


def changed(camera, parameter, step):
    k, lens = camera.K.copy(), list(camera.distortion)
    if parameter < 4:
        k[[0, 1, 0, 1][parameter], [0, 1, 2, 2][parameter]] += step
    else:
        lens[parameter - 4] += step
    return replace(camera, K=k, distortion=tuple(lens))


@given(
    st.floats(150, 1130), st.floats(120, 600), st.floats(15, 90), st.floats(0.3, 0.99), st.floats(0, 180),
    st.integers(0, 7),
)  # fmt: skip
def test_derivatives_are_those_of_a_second_fit(x, y, a, ratio, angle, parameter):
    ellipse = np.array([x, y, a, ratio * a, angle])
    shape = shape_of_ellipse(ellipse)
    image = distort_px(CAMERA, contour(shape))
    along = np.hypot(
        -shape[2] * np.sin(ANGLES) + shape[3] * np.cos(ANGLES), -shape[3] * np.sin(ANGLES) + shape[4] * np.cos(ANGLES)
    )
    step = (0.1, 0.1, 0.1, 0.1, 1e-4, 1e-4, 1e-5, 1e-5)[parameter]
    ends = []
    for side in (step, -step):
        other = changed(CAMERA, parameter, side)
        ends.append(refitted(denormalise(CAMERA, normalise(other, undistort_px(other, image))), shape, np.sqrt(along)))
    numeric = (ends[0] - ends[1]) / (2 * step)
    analytic = shape_by_camera(ellipse, CAMERA, 4)[:, parameter]
    # Differences of a least-squares fit that stops at 1e-15 of its cost, and of second order in the step.
    np.testing.assert_allclose(numeric, analytic, rtol=1e-4, atol=1e-5 * np.abs(analytic).max())


def test_focal_length_and_principal_point_move_the_pose_as_in_closed_form():
    # The same errors by two ways: as errors of the ellipse, and as those of K in `poses_with_covariance`.
    camera = Camera(1280, 720, np.array([[1180.0, 0, 640], [0, 1180, 360], [0, 0, 1]]))
    ellipse = np.array([900.0, 500, 60, 42, 25])
    focal, principal = 0.01, 2.0
    covariance = np.diag([0, 0, principal**2, principal**2, 0, 0, 0, 0])
    covariance[:2, :2] = (1180 * focal) ** 2  # both focal lengths together
    noise = 1e-6 * np.eye(5)
    as_shape = noise + shape_covariance_of_camera(ellipse, camera, covariance)
    _, one = poses_with_covariance(ellipse, as_shape, camera.K, 0.04)
    _, other = poses_with_covariance(ellipse, noise, camera.K, 0.04, focal, principal)
    np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9 * np.abs(other).max())


def test_a_batch_is_each_of_its_ellipses():
    ellipses = np.array([[300.0, 200, 50, 40, 10], [900, 500, 60, 42, 25], [640, 360, 20, 19, 0]])
    together = shape_by_camera(ellipses, CAMERA, 5)
    assert together.shape == (3, 5, 9)
    np.testing.assert_allclose(together, [shape_by_camera(e, CAMERA, 5) for e in ellipses])


def drawn(best: UncertainCamera, rng):
    """A camera from the uncertainty of another."""
    k = best.camera.K.copy()
    k[:2, :2] *= 1 + best.focal_sigma * rng.standard_normal()
    k[:2, 2] += best.principal_sigma_px * rng.standard_normal(2)
    more = np.zeros(8)
    if best.covariance is not None:
        value, vector = np.linalg.eigh(best.covariance)
        more = vector @ (np.sqrt(np.maximum(value, 0)) * rng.standard_normal(8))
    k[[0, 1, 0, 1], [0, 1, 2, 2]] += more[:4]
    distortion = np.array(best.camera.distortion or (0.0,) * 4) + more[4:]
    return replace(best.camera, K=k, distortion=tuple(distortion.tolist()))


def fitted(ellipse, variance):
    """A fit whose shape has this variance in every element."""
    return EllipseFit(ellipse, np.full((5, 5), np.nan), 0.01, 48, variance * np.eye(5), np.empty(0))


def chi_squares(best, count, rng, noise_px=0.004):
    """Of poses estimated with `best`, of circles that cameras drawn from its uncertainty image."""
    out = []
    while len(out) < count:
        camera = drawn(best, rng)
        direction = np.array([*rng.uniform([-0.32, -0.18], [0.32, 0.18]), 1.0])
        pose = camera_from_marker_of(
            normal_of(rng.uniform(10, 55), rng.uniform(-180, 180)), direction * rng.uniform(0.7, 2.4)
        )
        points = transform_points(pose, np.stack([*(0.04 * CIRCLE), 0 * ANGLES], axis=-1))
        image = distort_px(camera, denormalise(camera, points[:, :2] / points[:, 2:]))
        seen = undistort_px(best.camera, image)
        if not np.isfinite(seen).all():
            continue
        start = shape_of_ellipse(np.array([*seen.mean(axis=0), *2 * [np.ptp(seen) / 4], 0.0]))
        shape = refitted(seen, start, np.ones(len(ANGLES))) + noise_px * rng.standard_normal(5)
        fit = fitted(ellipse_of_shape(shape), noise_px**2)
        ((poses, cov),) = poses_of_fits([fit], best, 0.04)
        both = [
            float(uncertainty_scores(pose[None], poses.normal[i][None], poses.centre_m[i][None], cov[i][None]).chi2[0])
            for i in range(2)
        ]
        out.append(min(both))
    return np.array(out)


@pytest.mark.parametrize("label", ["default", "default:2020s", "focal35:26+-1"])
def test_regions_of_an_assumed_camera_hold_over_its_own_prior(label):
    best = uncertain_camera_for(parse_intrinsics(label), None, 1280, 720)
    inside = np.mean(chi_squares(best, 300, np.random.default_rng(3)) < chi2.ppf(0.95, 5))
    # A focal length that is off by a quarter is beyond second order: 90 % rather than 95, of 300 within 3.5 %.
    assert 0.88 < inside < 0.99


def test_regions_of_a_calibrated_camera_hold_and_do_not_without_its_covariance():
    rng = np.random.default_rng(4)
    root = np.diag([0.4, 0.4, 0.6, 0.6, 2e-3, 8e-3, 2e-4, 2e-4]) @ (np.eye(8) + 0.3 * rng.standard_normal((8, 8)))
    best = UncertainCamera(CAMERA, covariance=root @ root.T)
    squares = chi_squares(best, 300, rng)
    # Three standard deviations of a share of 300, which is 1.3 %.
    assert 0.91 < np.mean(squares < chi2.ppf(0.95, 5)) < 0.99
    exact = best.as_exact()
    assert exact.is_exact
    assert not best.is_exact
    fit = fitted(np.array([900.0, 500, 60, 42, 25]), 1e-5)
    ((_, known),) = poses_of_fits([fit], exact, 0.04)
    ((_, unsure),) = poses_of_fits([fit], best, 0.04)
    assert np.trace(unsure[0]) > 10 * np.trace(known[0])


def test_the_covariance_of_the_projection_adds_up():
    covariance = np.zeros((8, 8))
    covariance[:2, :2] = 4.0  # fx and fy together by 2 px
    covariance[2, 2], covariance[3, 3], covariance[2, 3], covariance[3, 2] = 1.0, 2.0, 0.5, 0.5
    total = UncertainCamera(CAMERA, 0.01, 3.0, covariance=covariance).projection_covariance()
    to_log = 2.0 * 0.5 * (1 / 1180 + 1 / 1175)
    np.testing.assert_allclose(total, [[1e-4 + to_log**2, 0, 0], [0, 10, 0.5], [0, 0.5, 11]])
