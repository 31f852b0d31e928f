"""Maximum likelihood of circles in one plane: exact on exact ellipses, and honest about its focal length."""

import numpy as np
import pytest
from helpers_circles import circle_scene, noisy_ellipses, scattered

from roundel.scenes.camera.focal_fusion import fused_focal_px
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.pose.coplanar_circles import CoplanarFit, fit_coplanar

PAIR = np.array([[0.0, 0.0], [1.5, 0.0]]), np.array([0.5, 0.5])
RING = np.zeros((2, 2)), np.array([0.5, 0.25])
PRIOR = 0.115
# As `roundel.solver.views.plane_of_view`: beyond it a focal length is not stated.
LARGEST_SIGMA = 0.25


def covariances(count):
    return np.array([np.eye(5) * 1e-6] * count)


def near(scene, generator, factor=1.1):
    """A start: the true camera with another focal length, and a normal some degrees beside the true one."""
    k = scene.K.copy()
    k[:2, :2] *= factor
    normal = scene.normal + generator.normal(0.0, 0.03, 3)
    return k, normal / np.linalg.norm(normal)


@pytest.mark.parametrize("concentric", [False, True])
def test_exact_ellipses_give_the_truth(concentric):
    generator = np.random.default_rng(1)
    for _ in range(100):
        layout = RING if concentric else scattered(generator, int(generator.integers(2, 5)))
        scene = circle_scene(generator, *layout)
        k = scene.K.copy()
        k[0, 1], k[1, 1] = generator.uniform(-20, 20), generator.uniform(0.8, 1.2) * k[0, 0]
        ellipses = ellipse_of_conic(conic_of_circle(scene.poses, scene.radii_m, k))
        start, normal = near(scene, generator)
        start[0, 1], start[1, 1] = 1.1 * k[0, 1], 1.1 * k[1, 1]
        fit = fit_coplanar(ellipses, covariances(len(ellipses)), start, normal, concentric=concentric)
        assert isinstance(fit, CoplanarFit)
        assert fit.focal_px == pytest.approx(k[0, 0], rel=1e-9)
        assert angle_deg(fit.normal, scene.normal) < 1e-7
        depth = scene.radii_m / fit.radius
        assert np.allclose(fit.centre * depth[:, None], scene.poses[:, :3, 3], rtol=1e-8)
        assert fit.freedom == 5 * len(ellipses) - (7 if concentric else 3 + 3 * len(ellipses))
        assert fit.chi2 < 1e-12


def test_known_ratios_of_radii_and_a_known_focal_length_take_unknowns_away():
    generator = np.random.default_rng(2)
    scene = circle_scene(generator, *scattered(generator, 3))
    ellipses = ellipse_of_conic(scene.conics)
    _, normal = near(scene, generator)
    free = fit_coplanar(ellipses, covariances(3), scene.K, normal)
    ratios = fit_coplanar(ellipses, covariances(3), scene.K, normal, relative_radii=scene.radii_m)
    known = fit_coplanar(ellipses, covariances(3), scene.K, normal, focal_known=True)
    assert (free.freedom, ratios.freedom, known.freedom) == (3, 5, 4)
    assert ratios.focal_sigma < free.focal_sigma
    assert known.focal_sigma == 0.0
    assert known.focal_px == pytest.approx(scene.K[0, 0], rel=1e-12)


def statement(generator, layout, distance, sigma_px, tilt_deg):
    """Error of log f with its standard deviation, or None; and the true focal length."""
    scene = circle_scene(generator, *layout, distance=distance, tilt_deg=tilt_deg)
    ellipses, covs = noisy_ellipses(generator, scene, sigma_px)
    fit = fit_coplanar(ellipses, covs, scene.K, scene.normal, concentric=layout is RING)
    if isinstance(fit, FailedFit) or not fit.focal_sigma <= LARGEST_SIGMA:
        return None, scene.K[0, 0]
    return fit, scene.K[0, 0]


CASES = {
    "two discs": (PAIR, (6.0, 25.0), 0.1, (12.0, 65.0)),
    "two discs from afar": (PAIR, (20.0, 60.0), 0.1, (12.0, 65.0)),
    "two discs almost parallel to the image": (PAIR, (8.0, 20.0), 0.05, (0.0, 12.0)),
    "a ring": (RING, (5.0, 15.0), 0.1, (12.0, 65.0)),
}


@pytest.mark.parametrize("case", CASES)
def test_95_percent_intervals_hold_and_the_prior_gains(case):
    generator = np.random.default_rng(3)
    held, alone, fused = [], [], []
    for _ in range(150):
        fit, focal = statement(generator, *CASES[case])
        prior = focal * np.exp(generator.normal(0.0, PRIOR))
        alone.append(np.log(prior / focal))
        if fit is None:
            fused.append(alone[-1])
            continue
        held.append(abs(np.log(fit.focal_px / focal)) < 1.96 * fit.focal_sigma)
        both, _ = fused_focal_px(prior, PRIOR, fit.focal_px, fit.focal_sigma * fit.focal_px)
        fused.append(np.log(both / focal))
    assert len(held) > 30
    # The interval's own error at this count: three standard deviations on either side of 90 and 98 %.
    error = 3 * np.sqrt(0.95 * 0.05 / len(held))
    assert 0.90 - error <= np.mean(held) <= 1.0
    assert np.median(np.abs(fused)) <= np.median(np.abs(alone))
    assert np.sqrt(np.mean(np.square(fused))) <= np.sqrt(np.mean(np.square(alone)))


def test_a_plane_parallel_to_the_image_does_not_determine_a_focal_length():
    generator = np.random.default_rng(4)
    for _ in range(10):
        scene = circle_scene(generator, *PAIR, tilt_deg=(0, 0))
        fit = fit_coplanar(ellipse_of_conic(scene.conics), covariances(2) * 1e4, scene.K, scene.normal)
        assert isinstance(fit, FailedFit) or fit.focal_sigma > LARGEST_SIGMA


def test_starts_that_are_no_plane_in_front_of_the_camera_fail_with_a_reason():
    scene = circle_scene(np.random.default_rng(5), *PAIR)
    ellipses = ellipse_of_conic(scene.conics)
    away = fit_coplanar(ellipses, covariances(2), scene.K, -scene.normal)
    assert isinstance(away, FailedFit)
    assert "faces the camera" in away.reason
    flat = fit_coplanar(ellipses, np.zeros((2, 5, 5)), scene.K, scene.normal)
    assert isinstance(flat, FailedFit)
    assert "covariance" in flat.reason
    edge_on = fit_coplanar(ellipses, covariances(2), scene.K, np.array([1.0, 0.0, -0.01]))
    assert isinstance(edge_on, FailedFit)
