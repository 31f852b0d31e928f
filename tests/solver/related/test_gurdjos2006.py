"""Gurdjos 2006: circular points of parallel circles from their pencils."""

import numpy as np
import pytest
from helpers_circles import circle_scene, noisy_ellipses, scattered
from helpers_views import printed, view_of

from roundel.scenes.geometry.conic import conic_of_circle
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.methods.plugin import MethodFailure
from roundel.solver.related.gurdjos2006 import circular_points_of_circles, find, measured_focal
from roundel.solver.views.dual_circular_points import normal_from_line

PAIR = np.array([[0.0, 0.0], [1.5, 0.0]]), np.array([0.02, 0.02])


def errors(points, scene):
    return np.array(
        [
            abs(points.focal_px(scene.K[:2, 2]) / scene.K[0, 0] - 1.0),
            np.radians(angle_deg(normal_from_line(points.line, scene.K), scene.normal)),
        ]
    )


@pytest.mark.parametrize("count", [2, 4])
def test_500_scenes(count):
    generator = np.random.default_rng(count)
    worst = np.zeros(2)
    for _ in range(500):
        scene = circle_scene(generator, *scattered(generator, count))
        (points,) = circular_points_of_circles(scene.conics)
        worst = np.maximum(worst, errors(points, scene))
    assert worst.max() < 1e-6  # 1e-11 is usual


def test_circles_of_parallel_planes():
    """A circle further away on a parallel plane is a larger one of this plane: the algebra is the same."""
    generator = np.random.default_rng(5)
    for _ in range(100):
        scene = circle_scene(generator, *scattered(generator, 2))
        poses = scene.poses.copy()
        poses[1, :3, 3] += 0.5 * scene.normal
        (points,) = circular_points_of_circles(conic_of_circle(poses, scene.radii_m, scene.K))
        assert errors(points, scene).max() < 1e-6


def test_concentric_circles_have_a_member_of_rank_one():
    generator = np.random.default_rng(6)
    for _ in range(100):
        scene = circle_scene(generator, np.zeros((2, 2)), np.array([0.5, generator.uniform(0.2, 0.8)]))
        (points,) = circular_points_of_circles(scene.conics)
        # A double eigenvalue has half of the digits.
        assert errors(points, scene).max() < 1e-5


def test_circles_that_meet_have_one_real_member():
    generator = np.random.default_rng(7)
    for _ in range(100):
        scene = circle_scene(generator, np.array([[0.0, 0.0], [0.6, 0.2]]), np.array([0.5, 0.45]))
        (points,) = circular_points_of_circles(scene.conics)
        assert errors(points, scene).max() < 1e-6


def test_a_circle_inside_another_stays_ambiguous_until_there_is_a_third():
    generator = np.random.default_rng(8)
    offsets, radii = np.array([[0.0, 0.0], [0.15, 0.1], [1.4, 0.0]]), np.array([0.5, 0.25, 0.4])
    both = 0
    for _ in range(50):
        scene = circle_scene(generator, offsets, radii)
        solutions = circular_points_of_circles(scene.conics[:2])
        both += len(solutions) == 2
        # Where the other line has no focal length, it is refused by that.
        right = [np.radians(angle_deg(normal_from_line(s.line, scene.K), scene.normal)) for s in solutions]
        assert min(right) < 1e-6
        (points,) = circular_points_of_circles(scene.conics)
        assert errors(points, scene).max() < 1e-6
    assert both > 25


def test_one_circle_is_refused():
    scene = circle_scene(np.random.default_rng(9), np.zeros((1, 2)), np.array([0.5]))
    with pytest.raises(ValueError, match="two parallel circles or more are needed"):
        circular_points_of_circles(scene.conics)


def test_circles_that_are_not_parallel_are_refused():
    """Of two, the focal length is wrong but nothing tells; the lines of three pairs disagree."""
    generator = np.random.default_rng(10)
    for _ in range(20):
        flat = circle_scene(generator, *scattered(generator, 3), focal_px=1000.0, principal_point=(640, 480))
        bent = flat.poses.copy()
        bent[2, :3, :3] = bent[2, :3, :3] @ np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
        with pytest.raises(ValueError, match="not parallel"):
            circular_points_of_circles(conic_of_circle(bent, flat.radii_m, flat.K))


def test_a_plane_parallel_to_the_image_is_refused():
    scene = circle_scene(np.random.default_rng(11), *PAIR, tilt_deg=(0, 0))
    (points,) = circular_points_of_circles(scene.conics)
    with pytest.raises(ValueError, match="parallel to the image"):
        points.focal_px(scene.K[:2, 2])


def discs(seed, offsets=PAIR[0], radii=PAIR[1], **keys):
    given = {"tilt_deg": (40, 40), "distance": (10, 10), "focal_px": 700.0, "principal_point": (319.5, 239.5)}
    return circle_scene(np.random.default_rng(seed), offsets, radii, off_axis_deg=5.0, **{**given, **keys})


def test_it_measures_the_focal_length_of_an_image():
    scene = discs(12)
    found = find(view_of(scene, printed("disc", [0.04, 0.04]), focal_factor=1.2))
    assert len(found) == 2
    for one in found:
        assert abs(one.focal_px - 700.0) < 4.0 * one.focal_sigma_px < 4.0 * 35.0


def test_six_dots_measure_it_better():
    turn = np.arange(6) * np.pi / 3
    ring = 2.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    scene = discs(13, ring - ring[0], np.full(6, 0.015), distance=(16, 16))
    found = find(view_of(scene, printed("disc", [0.03] * 6, dots=6, ring_diameter_m=0.12), focal_factor=1.2))
    assert len(found) == 6
    assert abs(found[0].focal_px - 700.0) < 4.0 * found[0].focal_sigma_px < 4.0 * 20.0


def test_of_many_circles_the_far_ones_are_used():
    generator = np.random.default_rng(15)
    turn = np.arange(20) * np.pi / 10
    ring = 5.6 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    scene = circle_scene(generator, ring - ring[0], np.full(20, 0.5), distance=(25, 25), tilt_deg=(40, 40))
    measured = measured_focal(*noisy_ellipses(generator, scene, 0.1), scene.K)
    assert abs(np.log(measured.focal_px / scene.K[0, 0])) < 4 * measured.sigma < 0.04


def test_one_printed_circle_is_refused():
    with pytest.raises(MethodFailure, match="one circle is printed"):
        find(view_of(discs(14), printed("disc", [0.04])))
