"""Kim 2005: centre, vanishing line and focal length of two concentric circles."""

import numpy as np
import pytest
from helpers_circles import circle_scene
from helpers_views import printed, view_of

from roundel.scenes.geometry.conic import conic_of_circle
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.methods.plugin import MethodFailure
from roundel.solver.related.kim2005 import concentric_pair, find, focal_of_concentric
from roundel.solver.views.dual_circular_points import normal_from_line

CONCENTRIC = np.zeros((2, 2))
IMAGE = {"focal_px": 700.0, "principal_point": (319.5, 239.5), "off_axis_deg": 5.0}


def test_500_scenes():
    generator = np.random.default_rng(1)
    worst = np.zeros(4)
    for _ in range(500):
        ratio = generator.uniform(0.2, 0.9)
        scene = circle_scene(generator, CONCENTRIC, np.array([0.5, 0.5 * ratio]))
        pair = concentric_pair(*scene.conics)
        focal = focal_of_concentric(*scene.conics, scene.K[:2, 2])
        errors = (
            abs(focal / scene.K[0, 0] - 1.0),
            abs(pair.ratio * ratio - 1.0),
            np.abs(pair.centre_px - scene.centre_px[0]).max() / scene.K[0, 0],
            np.radians(angle_deg(normal_from_line(pair.line, scene.K), scene.normal)),
        )
        worst = np.maximum(worst, errors)
    assert worst.max() < 1e-6  # 1e-10 is usual


@pytest.mark.parametrize(("ratio", "accuracy"), [(0.99, 1e-6), (0.999, 1e-5)])
def test_near_equal_radii_lose_digits_as_their_eigenvalues_meet(ratio, accuracy):
    generator = np.random.default_rng(2)
    for _ in range(50):
        scene = circle_scene(generator, CONCENTRIC, np.array([0.5, 0.5 * ratio]))
        assert focal_of_concentric(*scene.conics, scene.K[:2, 2]) == pytest.approx(scene.K[0, 0], rel=accuracy)


def test_it_holds_for_any_camera():
    generator = np.random.default_rng(3)
    scene = circle_scene(generator, CONCENTRIC, np.array([0.5, 0.3]))
    k = scene.K.copy()
    k[0, 1], k[1, 1] = 40.0, 1.3 * k[0, 0]
    pair = concentric_pair(*conic_of_circle(scene.poses, scene.radii_m, k))
    image = k @ scene.poses[0, :3, 3]
    assert np.allclose(pair.centre_px, image[:2] / image[2], rtol=1e-10)
    assert angle_deg(normal_from_line(pair.line, k), scene.normal) < 1e-8


def test_swapped_radii_are_refused():
    scene = circle_scene(np.random.default_rng(4), CONCENTRIC, np.array([0.5, 0.3]))
    with pytest.raises(ValueError, match="are the radii swapped"):
        concentric_pair(*scene.conics[::-1])


@pytest.mark.parametrize("offset", [0.02, 0.1, 0.2])
def test_circles_that_are_not_concentric_are_refused(offset):
    generator = np.random.default_rng(5)
    for _ in range(20):
        turn = generator.uniform(0, 2 * np.pi)
        beside = np.array([[0.0, 0.0], [offset * np.cos(turn), offset * np.sin(turn)]])
        scene = circle_scene(generator, beside, np.array([0.5, 0.2]))
        with pytest.raises(ValueError, match="not concentric"):
            concentric_pair(*scene.conics)


def test_circles_beside_each_other_are_refused():
    scene = circle_scene(np.random.default_rng(6), np.array([[0.0, 0.0], [1.5, 0.0]]), np.array([0.5, 0.4]))
    with pytest.raises(ValueError, match=r"not concentric|swapped"):
        concentric_pair(*scene.conics)


def test_a_plane_parallel_to_the_image_is_refused():
    scene = circle_scene(np.random.default_rng(7), CONCENTRIC, np.array([0.5, 0.3]), tilt_deg=(0, 0))
    with pytest.raises(ValueError, match="parallel to the image"):
        focal_of_concentric(*scene.conics, scene.K[:2, 2])


def ring(seed, inner=0.5, **keys):
    given = {"tilt_deg": (40, 40), "distance": (5, 5), **IMAGE}
    return circle_scene(np.random.default_rng(seed), CONCENTRIC, np.array([0.04, 0.04 * inner]), **{**given, **keys})


def test_it_measures_the_focal_length_of_a_ring():
    scene = ring(8)
    (found,) = find(view_of(scene, printed("ring", [0.08], inner_diameter_m=0.04), levels=[40, 200], focal_factor=1.2))
    assert abs(found.focal_px - 700.0) < 4.0 * found.focal_sigma_px < 4.0 * 35.0


def test_an_uncertain_camera_is_fused_with_it():
    scene = ring(9)
    markers = printed("ring", [0.08], inner_diameter_m=0.04)
    (found,) = find(view_of(scene, markers, levels=[40, 200], focal_factor=0.8, focal_sigma=0.115))
    assert abs(found.camera.K[0, 0] - 700.0) < 50.0
    (normal, centre), *rest = found.poses
    assert not rest
    assert angle_deg(normal, scene.normal) < 2.0
    assert np.linalg.norm(centre - scene.poses[0, :3, 3]) < 0.08 * np.linalg.norm(scene.poses[0, :3, 3])


def test_a_disc_has_no_second_circle():
    scene = circle_scene(np.random.default_rng(10), np.zeros((1, 2)), np.array([0.04]), distance=(5, 5), **IMAGE)
    with pytest.raises(MethodFailure, match="needs two concentric circles"):
        find(view_of(scene, printed("ring", [0.08], inner_diameter_m=0.04)))
    with pytest.raises(MethodFailure, match="the printed marker is disc"):
        find(view_of(scene, printed("disc", [0.08])))


def test_another_ratio_than_the_print_has_is_refused():
    scene = ring(11, inner=0.7)
    (found,) = find(view_of(scene, printed("ring", [0.08], inner_diameter_m=0.04), levels=[40, 200]))
    assert "which the print does not have" in found.failure
