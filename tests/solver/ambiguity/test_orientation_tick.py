"""The orientation tick as a cue: exact prediction, weights by shot noise, and probabilities that hold."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.ambiguity.disambiguation import choose
from roundel.solver.ambiguity.observation import Observation
from roundel.solver.ambiguity.pattern_cue import orientation_tick
from roundel.solver.ambiguity.pattern_prediction import region_inside
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.kernels.texture_lookup import reflectance_at
from roundel.solver.pose.circle_pose import poses_from_ellipse

SIZE, FINE = 44, 16  # FINE by FINE points a pixel: errors of the edges stay below 0.3 % of the contrast
K = np.array([[600.0, 0.0, 21.5], [0.0, 600.0, 21.5], [0.0, 0.0, 1.0]])
BLUR_PX, INK, PAPER = 0.4, 10.0, 200.0
NOISE_DN = 0.7, 2.4  # of the ink and of the paper


def observed(pose: np.ndarray, seed: int, contour_noise_dn: float = NOISE_DN[0]) -> Observation:
    """A disc with a tick as a camera with shot noise sees it, with the exact ellipse."""
    at = (np.arange(FINE * SIZE) + 0.5) / FINE - 0.5
    u, v = np.meshgrid(at, at)
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], axis=-1)
    n, c = pose[:3, 2], pose[:3, 3]
    points = rays * (n @ c / (rays @ n))[..., None] - c
    x, y = points @ pose[:3, 0] / 0.5, points @ pose[:3, 1] / 0.5
    paper = (np.hypot(x, y) > 1) | ((x > 0.5) & (x < 0.9) & (np.abs(y) < 0.06))
    share = gaussian_filter(paper * 1.0, BLUR_PX * FINE).reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))
    sigma = np.sqrt(NOISE_DN[0] ** 2 + (NOISE_DN[1] ** 2 - NOISE_DN[0] ** 2) * share)
    image = INK + (PAPER - INK) * share + sigma * np.random.default_rng(seed).standard_normal(share.shape)
    ellipse = ellipse_of_conic(conic_of_circle(pose, 0.5, K))
    return Observation(
        poses_from_ellipse(ellipse, K, 0.5).normal,
        None,
        ellipse,
        0.003**2 * np.eye(5),
        UncertainCamera(Camera(SIZE, SIZE, K), 0.0, 0.0),
        np.rint(image).astype(np.float32),
        BLUR_PX,
        (contour_noise_dn, NOISE_DN[1]),
        PAPER - INK,
    )


def test_the_kernel_is_bilinear() -> None:
    generator = np.random.default_rng(0)
    texture, flat = generator.uniform(size=(16, 16)), generator.uniform(-0.9, 0.9, (200, 2))
    turn = 0.7
    x = np.cos(turn) * flat[:, 0] + np.sin(turn) * flat[:, 1]
    y = -np.sin(turn) * flat[:, 0] + np.cos(turn) * flat[:, 1]
    cells = np.stack([(1 - y) * 8 - 0.5, (1 + x) * 8 - 0.5])
    inside = np.all((cells > 0) & (cells < 15), axis=0)
    expected = map_coordinates(texture, cells, order=1)
    homography = np.array([[0.01, 0.0, -0.3], [0.002, 0.012, 0.1], [0.0, 0.001, 1.0]])
    points = np.concatenate([flat, np.ones((200, 1))], axis=1) @ np.linalg.inv(homography).T
    found = reflectance_at(texture, homography, points[:, :2] / points[:, 2:], turn)
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-12)
    assert inside.sum() > 100


@pytest.mark.parametrize("contour_noise_dn", [0.7, 3.4])
def test_pixels_of_paper_weigh_by_their_shot_noise(contour_noise_dn: float) -> None:
    # The fit of the contour takes the tick for noise of the ink: 3.4 instead of 0.7 on a rendered frame. With that,
    # pixels of the tick had the weight of ink, and their noise decided for the wrong pose with certainty.
    pose = camera_from_marker_of(normal_of(30.0, 40.0), np.array([0.0, 0.0, 22.0]), 25.0)
    region = region_inside(observed(pose, 1, contour_noise_dn))
    assert region is not None
    light = region.value > 100
    assert light.sum() > 3
    share = (region.value[light] - INK) / (PAPER - INK)
    sigma = np.sqrt(NOISE_DN[0] ** 2 + (NOISE_DN[1] ** 2 - NOISE_DN[0] ** 2) * share)
    # Rounding to whole levels adds to the noise of the ink, and a hundred pixels tell it to 7 %.
    np.testing.assert_allclose(region.weight[light], NOISE_DN[0] / sigma, rtol=0.25)
    assert np.median(region.weight) == pytest.approx(1.0, abs=0.02)


def test_probabilities_of_a_tick_hold() -> None:
    # From clear to hardly visible: as many are right as is stated, to 2.5 standard deviations of chance.
    generator = np.random.default_rng(3)
    stated, right = [], []
    for seed in range(24):
        centre = np.array([0.0, 0.0, generator.uniform(22.0, 40.0)])
        pose = camera_from_marker_of(
            normal_of(generator.uniform(10, 60), generator.uniform(-180, 180)), centre, generator.uniform(-180, 180)
        )
        seen = observed(pose, seed, 2.5)
        choice = choose(seen, orientation_tick())
        true = int(np.argmin(angle_deg(seen.normal, pose[:3, 2])))
        stated.append(max(choice.probability))
        right.append(choice.probability[true] > 0.5)
    p = np.array(stated)
    assert abs(np.sum(right) - p.sum()) < 2.5 * max(np.sqrt(np.sum(p * (1 - p))), 0.5)
    assert np.mean(p > 0.95) > 0.2  # it does decide near ones
