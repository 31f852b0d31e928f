"""Huang 2015: the calibration matrix from common self-polar triangles in three views or more."""

import numpy as np
import pytest
from helpers_circles import circle_scene
from helpers_views import printed, view_of

from roundel.scenes.geometry.conic import conic_of_circle
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.methods.plugin import MethodFailure
from roundel.solver.related.huang2015 import calibration_of_views, find, self_polar_triangles

CONCENTRIC = np.zeros((2, 2))


def views(generator, k, count, **keys):
    """Conics (count, 2, 3, 3) of two concentric circles from a camera with skew and pixels of any shape."""
    ratio = generator.uniform(0.3, 0.8)
    scenes = [
        circle_scene(generator, CONCENTRIC, np.array([0.5, 0.5 * ratio]), focal_px=k[0, 0], tilt_deg=(20, 65))
        for _ in range(count)
    ]
    return np.array([conic_of_circle(scene.poses, scene.radii_m, k) for scene in scenes])


def any_camera(generator):
    f = generator.uniform(700, 2000)
    x, y = generator.uniform(600, 680), generator.uniform(440, 520)
    return np.array([[f, generator.uniform(-30, 30), x], [0.0, f * generator.uniform(0.8, 1.2), y], [0.0, 0.0, 1.0]])


def test_triangles_are_self_polar_for_both_and_right_angled():
    generator = np.random.default_rng(1)
    for _ in range(500):
        scene = circle_scene(generator, CONCENTRIC, np.array([0.5, generator.uniform(0.1, 0.45)]))
        triangles = self_polar_triangles(*scene.conics)
        centre = triangles.centre / np.linalg.norm(triangles.centre)
        for p, q in triangles.pairs:
            p, q = p / np.linalg.norm(p), q / np.linalg.norm(q)
            for conic in scene.conics:
                for one, other in ((centre, p), (centre, q), (p, q)):
                    assert abs(one @ conic @ other) < 1e-10
            directions = np.linalg.solve(scene.K, np.stack([p, q], axis=1)).T
            assert abs(angle_deg(*directions) - 90.0) < 1e-7
            assert abs(p @ triangles.line) < 1e-9


def test_500_sets_of_three_to_six_views():
    generator = np.random.default_rng(2)
    worst = 0.0
    for _ in range(500):
        k = any_camera(generator)
        conics = views(generator, k, int(generator.integers(3, 7)))
        worst = max(worst, float(np.abs(calibration_of_views(conics[:, 0], conics[:, 1]) - k).max() / k[0, 0]))
    # Three views are six equations for five numbers: of 125 such sets some are nearly critical and lose digits.
    assert worst < 1e-6


def test_too_few_views_are_refused():
    generator = np.random.default_rng(3)
    conics = views(generator, any_camera(generator), 2)
    with pytest.raises(ValueError, match=r"needs 3 views .* there are 2"):
        calibration_of_views(conics[:, 0], conics[:, 1])


def test_a_pure_translation_is_critical():
    scene = circle_scene(np.random.default_rng(4), CONCENTRIC, np.array([0.5, 0.3]))
    conics = []
    for step in np.linspace(0.0, 1.0, 4):
        poses = scene.poses.copy()
        poses[:, :3, 3] += step * np.array([1.0, 0.4, 2.0])
        conics.append(conic_of_circle(poses, scene.radii_m, scene.K))
    conics = np.array(conics)
    with pytest.raises(ValueError, match="do not determine the camera"):
        calibration_of_views(conics[:, 0], conics[:, 1])


def test_circles_that_are_not_concentric_are_refused():
    generator = np.random.default_rng(5)
    conics = views(generator, any_camera(generator), 3)
    beside = circle_scene(generator, np.array([[0.0, 0.0], [0.1, 0.0]]), np.array([0.5, 0.2]))
    conics[1] = beside.conics
    with pytest.raises(ValueError, match="not concentric"):
        calibration_of_views(conics[:, 0], conics[:, 1])


def rings(seed, count):
    generator = np.random.default_rng(seed)
    scenes = [
        circle_scene(
            generator,
            CONCENTRIC,
            np.array([0.04, 0.02]),
            tilt_deg=(25, 50),
            distance=(5, 8),
            focal_px=700.0,
            principal_point=(319.5, 239.5),
            off_axis_deg=5.0,
        )
        for _ in range(count)
    ]
    markers = printed("ring", [0.08], inner_diameter_m=0.04)
    return scenes, [
        view_of(scene, markers, levels=[40, 200], focal_factor=1.2, seed=i) for i, scene in enumerate(scenes)
    ]


def test_it_measures_one_focal_length_of_all_views():
    scenes, (first, *others) = rings(6, 4)
    own = view_of(scenes[0], first.markers, levels=[40, 200], focal_factor=1.2, companions=lambda: others)
    (found,) = find(own)
    assert abs(found.focal_px - 700.0) < 4.0 * found.focal_sigma_px < 4.0 * 20.0


def test_a_view_without_companions_is_refused():
    _, (first, *_) = rings(7, 1)
    with pytest.raises(MethodFailure, match="there are 1"):
        find(first)
