"""Circles of one plane, solved together: exact data, stated covariances, circles of other planes."""

import math

import numpy as np
import pytest

from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of
from roundel.solver.ambiguity.coplanar import solve_together
from roundel.solver.ambiguity.disambiguation import choose
from roundel.solver.ambiguity.parse_prior import parse_knowledge
from roundel.solver.fit.ellipse import ellipse_of_shape, shape_of_ellipse
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.pose.pose_covariance import poses_with_covariance

FOCAL, RADIUS = 600.0, 0.02
K = np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]])


def normal_of(rng, tilt_deg):
    turn, tilt = rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(*tilt_deg))
    return np.array([math.sin(tilt) * math.cos(turn), math.sin(tilt) * math.sin(turn), -math.cos(tilt)])


def circles(rng, count, tilt_deg=(15, 60), sigma_px=0.0, reach_m=0.12):
    """Normal, centres, ellipses and covariances of circles of one plane."""
    normal = normal_of(rng, tilt_deg)
    across = np.linalg.svd(normal[None])[2][1:]
    centre = np.array([0, 0, 0.8]) + rng.uniform(-reach_m, reach_m, (count, 2)) @ across
    poses = np.stack([camera_from_marker_of(normal, c) for c in centre])
    shapes = shape_of_ellipse(ellipse_of_conic(conic_of_circle(poses, RADIUS, K)))
    cov = np.tile(np.diag([1, 1, 1, 0.5, 1]) * max(sigma_px, 0.01) ** 2, (count, 1, 1))
    if sigma_px:
        shapes = shapes + np.array([rng.multivariate_normal(np.zeros(5), c) for c in cov])
    return normal, centre, ellipse_of_shape(shapes), cov


def given_camera(focal_px, focal_sigma):
    k = K.copy()
    k[0, 0] = k[1, 1] = focal_px
    return UncertainCamera(Camera(640, 480, k), focal_sigma)


def solved(ellipses, cov, given):
    poses, alone = poses_with_covariance(ellipses, cov, given.camera.K, RADIUS, given.focal_sigma)
    return solve_together(ellipses, cov, poses.normal, poses.centre_m, alone, given, RADIUS)


@pytest.mark.parametrize("focal_sigma", [0.0, 0.115])
def test_exact_ellipses_give_the_exact_plane(focal_sigma):
    """To 1e-6 with a known focal length; with a prior, whose pull is of the size of the stated sigma, to that."""
    rng = np.random.default_rng(1)
    for _ in range(40):
        normal, centre, ellipses, cov = circles(rng, int(rng.integers(2, 8)))
        start = FOCAL if focal_sigma == 0 else FOCAL * 1.08
        found = solved(ellipses, cov * 1e-8, given_camera(start, focal_sigma))
        assert found
        assert found.members.all()
        assert angle_deg(found.normal, normal) < 1e-5
        assert np.abs(found.centre_m - centre).max() < 1e-6
        assert found.camera.K[0, 0] == pytest.approx(FOCAL, rel=1e-6)
        assert found.log_odds > 10


def test_stated_covariances_and_focal_sigmas_hold():
    rng = np.random.default_rng(2)
    distance, focal, errors = [], [], []
    for _ in range(250):
        normal, centre, ellipses, cov = circles(rng, int(rng.integers(2, 7)), sigma_px=0.02)
        start = FOCAL * math.exp(0.115 * rng.normal())
        found = solved(ellipses, cov, given_camera(start, 0.115))
        assert found
        error = np.concatenate([found.centre_m[0] - centre[found.members][0], found.normal - normal])
        distance.append(error @ np.linalg.pinv(found.cov[0], rcond=1e-9) @ error)
        focal.append(math.log(found.focal_px / FOCAL) * found.focal_px / found.focal_sigma_px)
        errors.append((math.log(found.camera.K[0, 0] / FOCAL), math.log(start / FOCAL)))
    # 95 % regions of five degrees of freedom and of one; 250 draws scatter by 1.4 %.
    assert 0.90 < np.mean(np.array(distance) < 11.07) < 0.985
    assert 0.90 < np.mean(np.abs(focal) < 1.96) < 0.985
    fused, prior = np.sqrt(np.mean(np.square(errors), axis=0))
    assert fused < 0.3 * prior


def test_a_circle_of_another_plane_is_left_out():
    rng = np.random.default_rng(3)
    normal, _, ellipses, cov = circles(rng, 6, tilt_deg=(30, 40), sigma_px=0.02)
    _, _, stray, stray_cov = circles(rng, 1, tilt_deg=(60, 65), sigma_px=0.02)
    found = solved(np.concatenate([ellipses, stray]), np.concatenate([cov, stray_cov]), given_camera(FOCAL, 0.0))
    assert found
    assert found.members.tolist() == [True] * 6 + [False]
    assert angle_deg(found.normal, normal) < 1.0


def test_circles_of_no_common_plane_are_refused():
    rng = np.random.default_rng(4)
    both = [circles(rng, 1, tilt_deg=tilt, sigma_px=0.02) for tilt in ((20, 21), (64, 65))]
    ellipses, cov = (np.concatenate([b[k] for b in both]) for k in (2, 3))
    found = solved(ellipses, cov, given_camera(FOCAL, 0.0))
    assert not found
    assert found.reason == "no two circles lie in one plane"


def test_a_frontal_plane_does_not_measure_the_focal_length():
    """The prior stays what it was."""
    rng = np.random.default_rng(5)
    worse = []
    for _ in range(60):
        _, _, ellipses, cov = circles(rng, 4, tilt_deg=(0, 2), sigma_px=0.03)
        start = FOCAL * math.exp(0.115 * rng.normal())
        found = solved(ellipses, cov, given_camera(start, 0.115))
        if found:
            worse.append((math.log(found.camera.K[0, 0] / FOCAL), math.log(start / FOCAL)))
    fused, prior = np.sqrt(np.mean(np.square(worse), axis=0))
    assert len(worse) > 40
    assert fused < 1.05 * prior


def test_one_circle_alone_learns_nothing():
    normals = np.array([[0.1, 0, -0.99], [-0.1, 0, -0.99]])
    choice = choose(normals, parse_knowledge("coplanar"))
    assert choice.chosen is None
    assert choice.probability == (0.5, 0.5)
