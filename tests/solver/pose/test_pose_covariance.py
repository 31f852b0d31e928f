"""Propagation of ellipse and camera errors to both poses: by differences, against the bound, and at small tilts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_points
from roundel.scenes.geometry.information import contour_information, pose_bound
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.fit.ellipse import ellipse_of_shape, shape_of_ellipse
from roundel.solver.fit.ellipse_distance import foot_points
from roundel.solver.pose.circle_pose import poses_from_ellipse
from roundel.solver.pose.pose_covariance import poses_with_covariance
from roundel.solver.theory.pose_region import normal_border, normal_region, position_region, quantile, squared_distances

K = np.array([[1280.0, 3.0, 639.5], [0.0, 1200.0, 359.5], [0.0, 0.0, 1.0]])
RADIUS = 0.3
POSES = (
    st.floats(15.0, 70.0),
    st.floats(-180.0, 180.0),
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.floats(3.0, 30.0),
)


def scene(tilt, azimuth, x, y, distance):
    normal, centre = normal_of(tilt, azimuth), distance * np.array([x, y, 1.0])
    sight = centre / np.linalg.norm(centre)
    assume(-normal @ sight > 0.2)
    assume(np.linalg.norm(np.cross(normal, sight)) > 0.15)  # clear of the double root, where derivatives grow
    m = camera_from_marker_of(normal, centre)
    return m, ellipse_of_conic(conic_of_circle(m, RADIUS, K))


def stacked(poses):
    return np.concatenate([poses.centre_m, poses.normal], axis=-1)


@given(*POSES, st.integers(0, 1000))
def test_derivatives_by_the_ellipse(tilt, azimuth, x, y, distance, seed):
    _, e = scene(tilt, azimuth, x, y, distance)
    factor = np.random.default_rng(seed).normal(size=(5, 5)) * 1e-3  # 1/1000 px: far from drowning
    cov = factor @ factor.T
    _, got = poses_with_covariance(e, cov, K, RADIUS)
    step = 1e-5 * e[3]
    varied = ellipse_of_shape(shape_of_ellipse(e) + step * np.concatenate([np.eye(5), -np.eye(5)]))
    both = stacked(poses_from_ellipse(varied, K, RADIUS))
    j = np.moveaxis((both[:5] - both[5:]) / (2 * step), 0, -1)
    expected = j @ cov @ np.swapaxes(j, 1, 2)
    for mine, theirs in zip(got, expected, strict=True):
        # Differences: curvature (1e-5 / 0.15^2)^2 and rounding 1e-16 / 1e-5 times the condition.
        assert np.allclose(mine, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())
        assert np.allclose(mine[:3, :3], theirs[:3, :3], rtol=0, atol=1e-5 * np.abs(theirs[:3, :3]).max())


@given(*POSES)
def test_derivatives_by_the_camera(tilt, azimuth, x, y, distance):
    _, e = scene(tilt, azimuth, x, y, distance)
    tiny = 1e-6
    stretched = [np.vstack([K[:2] * [1 + s * tiny, 1 + s * tiny, 1.0], K[2:]]) for s in (1, -1)]
    by_f = (
        stacked(poses_from_ellipse(e, stretched[0], RADIUS)) - stacked(poses_from_ellipse(e, stretched[1], RADIUS))
    ) / (2 * tiny)
    by_p = []
    for axis in (0, 1):
        shift = np.zeros((3, 3))
        shift[axis, 2] = 1e-3
        by_p.append(
            (stacked(poses_from_ellipse(e, K + shift, RADIUS)) - stacked(poses_from_ellipse(e, K - shift, RADIUS)))
            / 2e-3
        )
    _, got = poses_with_covariance(e, np.zeros((5, 5)), K, RADIUS, focal_sigma=1e-4, principal_sigma_px=0.01)
    expected = sum(np.einsum("ci,cj->cij", j, j) * s**2 for j, s in ((by_f, 1e-4), (by_p[0], 0.01), (by_p[1], 0.01)))
    for mine, theirs in zip(got, expected, strict=True):
        assert np.allclose(mine, theirs, rtol=0, atol=1e-4 * np.abs(theirs).max())


@given(*POSES)
def test_it_is_the_bound_when_the_ellipse_is_at_its_own(tilt, azimuth, x, y, distance):
    """Errata, section 6: the pose of the maximum-likelihood ellipse is the maximum-likelihood pose."""
    m, e = scene(tilt, azimuth, x, y, distance)
    sigma, count = 0.01, 200
    points = ellipse_points(e, 512)
    t = np.linspace(0, 2 * np.pi, 512, endpoint=False)
    speed = np.hypot(e[2] * np.sin(t), e[3] * np.cos(t))
    _, n, u = foot_points(e, points)
    rows = np.stack([n[:, 0], n[:, 1], n[:, 0] * u[:, 0], n[:, 0] * u[:, 1] + n[:, 1] * u[:, 0], n[:, 1] * u[:, 1]], 1)
    of_shape = rows.T @ (rows * (speed / speed.sum() * count / sigma**2)[:, None])
    poses, cov = poses_with_covariance(e, np.linalg.inv(of_shape), K, RADIUS)
    own = cov[int(np.argmin(angle_deg(poses.normal, m[:3, 2])))]
    bound = pose_bound(contour_information(m, RADIUS, K, sigma, count))
    to_vectors = np.zeros((6, 5))
    to_vectors[:3, 2:] = np.eye(3)
    to_vectors[3:, 0], to_vectors[3:, 1] = -m[:3, 1], m[:3, 0]
    expected = to_vectors @ bound.cov @ to_vectors.T
    # 1e-3: the share that keeps a drowned tilt finite (sigma_q^2 / offset^4 / 12) at 0.01 px.
    assert np.allclose(own, expected, rtol=0, atol=1e-3 * np.abs(expected).max())
    assert math.degrees(math.sqrt(np.trace(own[3:, 3:]))) == pytest.approx(bound.normal_deg, rel=1e-3)
    assert math.sqrt(np.trace(own[:3, :3])) == pytest.approx(bound.position_m, rel=1e-3)


def test_batch_is_the_loop():
    e = np.array([[700.0, 300.0, 40.0, 30.0, 20.0], [200.0, 500.0, 25.0, 24.9, 70.0]])
    cov = np.stack([np.eye(5) * 1e-2, np.eye(5) * 1e-3])
    poses, together = poses_with_covariance(e, cov, K, RADIUS, 0.01, 2.0)
    for i in range(2):
        alone, own = poses_with_covariance(e[i], cov[i], K, RADIUS, 0.01, 2.0)
        assert np.allclose(alone.normal, poses.normal[i], rtol=0, atol=1e-12)
        assert np.allclose(own, together[i], rtol=1e-9, atol=1e-12)


def test_unknown_radius():
    e = np.array([700.0, 300.0, 40.0, 30.0, 20.0])
    _, free = poses_with_covariance(e, np.eye(5) * 1e-2, K, 1.0)
    _, known = poses_with_covariance(e, np.eye(5) * 1e-2, K, 0.05)
    unit = np.diag([0.05] * 3 + [1.0] * 3)
    assert np.allclose(unit @ free @ unit, known, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("tilt", [0.0, 0.3, 2.0, 5.0, 20.0])
def test_a_drowned_tilt_has_the_covariance_of_its_errors(tilt):
    """Of the ellipses that may be behind the one seen, the tilts lie as far from its own as the covariance says."""
    m = camera_from_marker_of(normal_of(tilt, 30.0), [0.0, 0.0, 10.0])
    e = ellipse_of_conic(conic_of_circle(m, RADIUS, K))
    sigma = 0.2
    poses, cov = poses_with_covariance(e, np.eye(5) * sigma**2, K, RADIUS)
    behind = shape_of_ellipse(e) + np.random.default_rng(0).normal(0, sigma, (2000, 5))
    truths = poses_from_ellipse(ellipse_of_shape(behind), K, RADIUS).normal
    error = np.min(angle_deg(truths, poses.normal[0]), axis=1)
    told = math.degrees(math.sqrt(np.trace(cov[0, 3:, 3:])))
    # The rule for drowned tilts interpolates between its two ends.
    assert told / np.sqrt(np.mean(error**2)) == pytest.approx(1.0, abs=0.2)
    # No error along the normal itself.
    assert abs(poses.normal[0] @ cov[0, 3:, 3:] @ poses.normal[0]) < 1e-15


def test_without_a_covariance_there_is_none():
    poses, cov = poses_with_covariance([700.0, 300.0, 40.0, 30.0, 20.0], np.full((5, 5), np.nan), K, RADIUS)
    assert cov is None
    assert poses.normal.shape == (2, 3)
    for wrong in ({"focal_sigma": -0.1}, {"principal_sigma_px": math.nan}):
        with pytest.raises(ValueError, match="sigma"):
            poses_with_covariance([700.0, 300.0, 40.0, 30.0, 20.0], np.eye(5), K, RADIUS, **wrong)


def test_quantiles():
    # Tables of chi^2, and of F(2, 10): 4.103, F(3, 20): 3.098.
    assert quantile(2) == pytest.approx(5.991, abs=5e-4)
    assert quantile(3) == pytest.approx(7.815, abs=5e-4)
    assert quantile(2, 0.95, 10) == pytest.approx(2 * 4.103, abs=1e-3)
    assert quantile(3, 0.95, 20) == pytest.approx(3 * 3.098, abs=2e-3)
    with pytest.raises(ValueError, match="probability"):
        quantile(2, 1.0)


def test_the_borders_of_the_regions():
    poses, cov = poses_with_covariance([700.0, 300.0, 40.0, 30.0, 20.0], np.eye(5) * 1e-4, K, RADIUS)
    n, c = poses.normal[0], poses.centre_m[0]
    of_normal, of_centre = normal_region(n, cov[0], 0.9), position_region(c, cov[0], 0.9, degrees=30)
    assert of_normal.axes.shape == (2, 3)
    assert np.allclose(of_normal.axes @ n, 0.0, atol=1e-9)
    for axis, size in zip(of_normal.axes, np.radians(of_normal.semi_axes), strict=True):
        border = np.cos(size) * n + np.sin(size) * axis
        # First order: a region of 0.03 degrees at an offset of 41 bends by some 1e-3.
        assert squared_distances(n, c, cov[0], border, c)[0] == pytest.approx(quantile(2, 0.9), rel=1e-2)
    for axis, size in zip(of_centre.axes, of_centre.semi_axes, strict=True):
        distance = squared_distances(n, c, cov[0], n, c + size * axis)[1]
        assert distance == pytest.approx(quantile(3, 0.9, 30), rel=1e-6)
    assert np.all(np.diff(of_centre.semi_axes) <= 0)


@pytest.mark.parametrize(("b", "sigma"), [(30.0, 0.1), (39.5, 0.1), (39.999, 0.3), (40.0, 0.3)])
def test_the_border_of_the_normals(b, sigma):
    ellipse = [700.0, 300.0, 40.0, b, 20.0]
    k = np.array([[1280.0, 0.0, 700.0], [0.0, 1280.0, 300.0], [0.0, 0.0, 1.0]])
    poses, cov = poses_with_covariance(ellipse, np.eye(5) * sigma**2, k, RADIUS)
    for i in (0, 1):
        n, c = poses.normal[i], poses.centre_m[i]
        border = normal_border(n, c, cov[i], count=400)
        assert np.allclose(np.linalg.norm(border, axis=1), 1.0, rtol=1e-12)
        distance, _ = squared_distances(n, c, cov[i], border, c)
        assert np.allclose(distance, quantile(2), rtol=1e-6)
        # It closes, without jumps.
        step = angle_deg(border, np.roll(border, 1, 0))
        assert np.max(step) < 0.1 * np.sum(step)
        assert squared_distances(n, c, cov[i], n, c)[0] == pytest.approx(0.0, abs=1e-9)
        other = float(squared_distances(n, c, cov[i], poses.normal[1 - i], c)[0])
        assert (other < quantile(2)) == (b > 39.9)  # only there the candidates cannot be told apart
