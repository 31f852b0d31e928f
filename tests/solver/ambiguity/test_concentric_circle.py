"""Cues on the print: circles about the centre, known patterns, and their evidence about the pose."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_images import picture
from scipy.ndimage import gaussian_filter

from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.scenes.markers.marker import Bar, Disc
from roundel.solver.ambiguity.concentric_circle import ConcentricCircle, fit_centre
from roundel.solver.ambiguity.disambiguation import choose
from roundel.solver.ambiguity.observation import Observation
from roundel.solver.ambiguity.pattern_cue import orientation_tick, pattern_of, pattern_of_shapes
from roundel.solver.ambiguity.viewing_cone import concentric_image, viewing_cone
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.pose.circle_pose import poses_from_ellipse

K = np.array([[600.0, 0.0, 79.5], [0.0, 600.0, 79.5], [0.0, 0.0, 1.0]])
CAMERA = Camera(160, 160, K)


def posed(tilt=45.0, azimuth=30.0, distance=6.0, roll=20.0):
    return camera_from_marker_of(normal_of(tilt, azimuth), np.array([0.1, -0.05, distance]), roll)


def ellipse_of(pose, radius=0.5):
    return ellipse_of_conic(conic_of_circle(pose, radius, K))


def sighting_of(pose, image, sigma_px=0.01, focal_sigma=0.0):
    ellipse = ellipse_of(pose)
    normal = poses_from_ellipse(ellipse, K, 0.5).normal
    uncertain = UncertainCamera(CAMERA, focal_sigma, 0.0)
    return Observation(normal, None, ellipse, sigma_px**2 * np.eye(5), uncertain, image, 0.7)


def truth_of(observation, pose):
    return int(np.argmin(angle_deg(observation.normal, pose[:3, 2])))


def ring_image(pose, ratio, noise_dn=1.0, blur_px=0.7, **changes):
    layers = [(ellipse_of(pose), 40), (ellipse_of(pose, 0.5 * ratio), 200)]
    return picture(layers, 160, 160, blur_px=blur_px, noise_dn=noise_dn, **changes)


def drawn(reflectance, pose, noise_dn=1.0, seed=0):
    """A disc of ink with `reflectance` (0 ink, 1 paper) of coordinates in radii, 5 by 5 points a pixel, blurred."""
    at = (np.arange(5 * 160) + 0.5) / 5 - 0.5
    u, v = np.meshgrid(at, at)
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], axis=-1)
    n, c = pose[:3, 2], pose[:3, 3]
    points = rays * (n @ c / (rays @ n))[..., None] - c
    x, y = points @ pose[:3, 0] / 0.5, points @ pose[:3, 1] / 0.5
    level = 200 - 160.0 * (np.hypot(x, y) < 1) + 160.0 * reflectance(x, y) * (np.hypot(x, y) < 1)
    soft = gaussian_filter(level, 0.7 * 5).reshape(160, 5, 160, 5).mean(axis=(1, 3))
    return np.clip(np.rint(soft + np.random.default_rng(seed).normal(0, noise_dn, soft.shape)), 0, 255).astype(np.uint8)


def patches(x, y):
    return ((np.abs(x - 0.4) < 0.2) & (np.abs(y) < 0.2)) | (np.hypot(x + 0.3, y - 0.3) < 0.2)


@pytest.mark.parametrize("ratio", [0.05, 0.5, 0.9])
def test_concentric_circles_follow_from_cone_and_normal(ratio):
    pose = posed()
    observation = sighting_of(pose, None)
    cone, i = viewing_cone(observation), truth_of(sighting_of(pose, None), pose)
    centre, spread = concentric_image(cone.cone[0], cone.normal[0, i], K, ratio)
    exact = ellipse_of(pose, 0.5 * ratio)
    np.testing.assert_allclose(centre, exact[:2], atol=1e-8)  # rounding, times the cone's condition of some 1e4
    assert np.sqrt(np.linalg.det(spread)) == pytest.approx(exact[2] * exact[3], rel=1e-6)


@pytest.mark.parametrize("azimuth", [30.0, 100.0, -150.0, -60.0])
@pytest.mark.parametrize("ratio", [0.12, 0.6])
def test_a_dot_or_a_ring_tells_the_pose(azimuth, ratio):
    pose = posed(azimuth=azimuth)
    observation = sighting_of(pose, ring_image(pose, ratio))
    choice = choose(observation, ConcentricCircle(ratio))
    truth = truth_of(observation, pose)
    assert choice.chosen == truth
    assert choice.probability[truth] > 0.99
    assert "sigma from both predictions" in choice.basis


def test_centre_of_a_dot():
    # Placed anywhere between pixels, with a blur that is taken too small or too large, a slope of the light and a start
    # 1 px off: within 0.01 px, or four of its own sigmas.
    generator = np.random.default_rng(0)
    slope = 1 + 0.003 * (np.arange(160) - 80)
    for blur_taken in (0.4, 0.7, 1.1):
        for a, b in ((2.5, 1.8), (6.0, 4.0), (15.0, 9.0)):
            dot = np.array([*generator.uniform(70, 80, 2), a, b, generator.uniform(0, 180)])
            image = picture([(dot, 40)], 160, 160, blur_px=0.7, noise_dn=0.0)
            image = image * slope + generator.normal(0, 1.0, image.shape)
            start = dot + np.array([0.7, -0.7, 0.1 * a, 0.1 * b, 0.0])
            fit = fit_centre(image, CAMERA, start, np.inf, 4.0, blur_taken)
            sigma = np.sqrt(np.trace(fit.cov))
            assert np.hypot(*(fit.centre_px - dot[:2])) < max(0.01, 4 * sigma)
            assert sigma < 0.04  # contrast 160, noise 1: 0.5 s / h for the smallest, times a wrong blur


def test_its_sigma_is_what_it_scatters():
    dot = np.array([75.3, 82.8, 5.0, 3.5, 25.0])
    clean = picture([(dot, 40)], 160, 160, blur_px=0.7).astype(float)
    generator = np.random.default_rng(1)
    fits = [fit_centre(clean + generator.normal(0, 4, clean.shape), CAMERA, dot, np.inf, 4.4, 0.7) for _ in range(150)]
    miss = np.array([fit.centre_px for fit in fits]) - dot[:2]
    z2 = [m @ np.linalg.solve(f.cov, m) for m, f in zip(miss, fits, strict=True)]
    assert np.mean(z2) == pytest.approx(2.0, abs=0.55)  # chi squared of 2: 0.16 a sigma, and the model's own error


def test_a_small_signal_is_not_called_sure():
    # 45 D away in strong noise: the predictions lie 0.05 px apart.
    pose = posed(distance=45.0, tilt=30.0)
    outcome = []
    for seed in range(8):
        observation = sighting_of(pose, ring_image(pose, 0.4, noise_dn=12.0, seed=seed), sigma_px=0.1)
        outcome.append(choose(observation, ConcentricCircle(0.4)).probability[truth_of(observation, pose)])
    assert max(outcome) < 0.9
    assert min(outcome) > 0.1


def test_an_unsure_focal_length_makes_it_less_sure():
    pose = posed(tilt=25.0, distance=7.0)
    image = ring_image(pose, 0.3, noise_dn=2.0)
    odds = []
    for focal_sigma in (0.0, 0.5):
        observation = sighting_of(pose, image, 0.03, focal_sigma)
        p = choose(observation, ConcentricCircle(0.3)).probability[truth_of(observation, pose)]
        odds.append(p / (1 - p))
    assert 1 < odds[1] < odds[0]


def test_a_circle_elsewhere_fits_neither():
    pose = posed()
    inner = ellipse_of(pose, 0.1) + np.array([2.0, 2.0, 0, 0, 0])
    image = picture([(ellipse_of(pose), 40), (inner, 200)], 160, 160, blur_px=0.7, noise_dn=1.0)
    choice = choose(sighting_of(pose, image), ConcentricCircle(0.2))
    assert "fits neither" in choice.basis
    assert max(choice.probability) < 0.6


def test_what_is_not_there_says_nothing():
    pose = posed()
    plain = picture([(ellipse_of(pose), 40)], 160, 160, blur_px=0.7, noise_dn=1.0)
    for mark in (ConcentricCircle(0.3), orientation_tick(), pattern_of(patches)):
        choice = choose(sighting_of(pose, plain), mark)
        assert choice.probability == (0.5, 0.5)
        assert choice.chosen is None
        assert "not" in choice.basis
        assert choose(sighting_of(pose, plain).normal, mark).probability == (0.5, 0.5)  # no image
    beyond = Observation(**{**vars(sighting_of(pose, plain)), "image": plain[:70, :70]})
    assert choose(beyond, ConcentricCircle(0.3)).chosen is None
    assert choose(sighting_of(pose, plain), ConcentricCircle(0.95)).chosen is None
    assert isinstance(fit_centre(np.zeros((20, 20)), CAMERA, np.array([10, 10, 3, 2, 0.0]), 9, 3, 0.5), FailedFit)


@pytest.mark.parametrize("azimuth", [0.0, 80.0, 170.0, -70.0])
def test_a_pattern_tells_the_pose(azimuth):
    pose = posed(azimuth=azimuth, roll=azimuth / 2)
    observation = sighting_of(pose, drawn(patches, pose, noise_dn=2.0))
    choice = choose(observation, pattern_of(patches))
    truth = truth_of(observation, pose)
    assert choice.chosen == truth
    assert choice.probability[truth] > 0.99


def test_a_pattern_of_shapes_is_the_same_as_its_function():
    shapes = [Disc(0, 0, 0.5, 0.0), Bar(0.2, 0.0, 0.2, 0.2, 0.0, 1.0), Disc(-0.15, 0.15, 0.1, 1.0)]
    made = pattern_of_shapes(shapes, 0.5, 0.0).texture
    expected = pattern_of(patches).texture
    # A cell whose edge is the shape's own may fall to either side.
    assert np.mean(np.abs(made - expected) > 0.01) < 0.01


def test_a_tick_alone_is_weak_and_says_so():
    pose = posed(tilt=50.0)
    image = drawn(lambda x, y: (x > 0.5) & (x < 0.9) & (np.abs(y) < 0.06), pose, noise_dn=1.0)
    observation = sighting_of(pose, image)
    choice = choose(observation, orientation_tick())
    assert choice.probability[truth_of(observation, pose)] > 0.3
    assert "orientation tick" in choice.basis
