"""Chen 2004: focal length and plane of coplanar circles."""

import numpy as np
import pytest
from helpers_circles import circle_scene, scattered
from helpers_views import printed, view_of

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.methods.plugin import MethodFailure
from roundel.solver.pose.coplanar_circles import CoplanarFit
from roundel.solver.related.chen2004 import find, measured_plane, planes_of_circles

PAIR = np.array([[0.0, 0.0], [1.5, 0.0]]), np.array([0.02, 0.02])


def test_500_scenes_of_two_circles():
    generator = np.random.default_rng(1)
    worst = np.zeros(3)
    for _ in range(500):
        scene = circle_scene(generator, *scattered(generator, 2))
        (plane,) = planes_of_circles(scene.conics, scene.K[:2, 2])
        errors = (
            abs(plane.focal_px / scene.K[0, 0] - 1.0),
            np.radians(angle_deg(plane.normal, scene.normal)),
            np.abs(plane.centre_image_px - scene.centre_px).max() / scene.K[0, 0],
        )
        worst = np.maximum(worst, errors)
    assert worst.max() < 1e-6  # 1e-10 is usual


def test_more_circles():
    generator = np.random.default_rng(2)
    for _ in range(20):
        scene = circle_scene(generator, *scattered(generator, 5, gap=0.1))
        (plane,) = planes_of_circles(scene.conics, scene.K[:2, 2])
        assert plane.focal_px == pytest.approx(scene.K[0, 0], rel=1e-6)


def test_a_circle_inside_another_gives_all_solutions():
    generator = np.random.default_rng(3)
    scene = circle_scene(generator, np.array([[0.0, 0.0], [0.15, 0.0]]), np.array([0.5, 0.2]))
    planes = planes_of_circles(scene.conics, scene.K[:2, 2])
    assert min(abs(plane.focal_px / scene.K[0, 0] - 1.0) for plane in planes) < 1e-6


def test_the_fit_starts_from_no_focal_length_and_keeps_the_shape_of_the_pixels():
    generator = np.random.default_rng(4)
    scene = circle_scene(generator, *scattered(generator, 2))
    k = scene.K.copy()
    k[0, 1], k[1, 1] = 12.0, 1.1 * k[0, 0]
    ellipses = ellipse_of_conic(conic_of_circle(scene.poses, scene.radii_m, k))
    assumed = k.copy()
    assumed[:2, :2] *= 3.0
    fit = measured_plane(ellipses, np.array([np.eye(5) * 1e-6] * 2), assumed)
    assert isinstance(fit, CoplanarFit)
    assert fit.focal_px == pytest.approx(k[0, 0], rel=1e-6)
    assert angle_deg(fit.normal, scene.normal) < 1e-5


def test_one_circle_is_refused():
    scene = circle_scene(np.random.default_rng(5), np.zeros((1, 2)), np.array([0.5]))
    with pytest.raises(ValueError, match="two coplanar circles or more are needed"):
        planes_of_circles(scene.conics, scene.K[:2, 2])


def test_circles_of_different_planes_are_refused():
    generator = np.random.default_rng(6)
    refused = 0
    for _ in range(20):
        scenes = [
            circle_scene(generator, *PAIR, tilt_deg=(tilt, tilt + 10), focal_px=1000.0, principal_point=(640, 480))
            for tilt in (15, 45)
        ]
        with pytest.raises(ValueError, match=r"different planes|every focal length"):
            planes_of_circles([scenes[0].conics[0], scenes[1].conics[1]], (640, 480))
        refused += 1
    assert refused == 20


def test_both_parallel_to_the_image_is_refused():
    scene = circle_scene(np.random.default_rng(7), *PAIR, tilt_deg=(0, 0))
    with pytest.raises(ValueError, match="every focal length explains them"):
        planes_of_circles(scene.conics, scene.K[:2, 2])


def two_discs(seed, **keys):
    generator = np.random.default_rng(seed)
    given = {"tilt_deg": (40, 40), "distance": (10, 10), "focal_px": 700.0, "principal_point": (319.5, 239.5)}
    return circle_scene(generator, *PAIR, off_axis_deg=5.0, **{**given, **keys})


def test_it_measures_the_focal_length_of_an_image():
    scene = two_discs(8)
    found = find(view_of(scene, printed("disc", [0.04, 0.04]), focal_factor=1.2))
    assert len(found) == 2
    for one in found:
        assert abs(one.focal_px - 700.0) < 4.0 * one.focal_sigma_px < 4.0 * 35.0
        assert one.camera is None  # the camera that was given is exact


def test_an_uncertain_camera_is_fused_with_it():
    scene = two_discs(9)
    found = find(view_of(scene, printed("disc", [0.04, 0.04]), focal_factor=1.2, focal_sigma=0.115))
    for one in found:
        assert abs(one.camera.K[0, 0] - 700.0) < abs(1.2 * 700.0 - 700.0) / 3
        assert angle_deg(one.poses[0][0], scene.normal) < 2.0


def test_fewer_circles_than_two_are_refused():
    scene = two_discs(10)
    with pytest.raises(MethodFailure, match="one circle is printed"):
        find(view_of(scene, printed("disc", [0.04])))


def test_a_print_of_other_things_is_refused():
    with pytest.raises(MethodFailure, match="the printed marker is tags"):
        find(view_of(two_discs(10), [{"marker_id": 0, "kind": "tags", "diameter_m": None, "layout": {}}]))


def test_discs_at_different_depths_are_refused():
    """The second disc is nearer by a fifth, on a parallel sheet, and looks like a larger disc of the same sheet."""
    scene = two_discs(11)
    scene.poses[1, :3, 3] *= 0.8
    scene.conics[1] = conic_of_circle(scene.poses[1], 0.02, scene.K)
    with pytest.raises(MethodFailure, match="not in one plane with these diameters"):
        find(view_of(scene, printed("disc", [0.04, 0.04])))


def test_discs_parallel_to_the_image_have_no_focal_length():
    scene = two_discs(12, tilt_deg=(0, 0))
    for one in find(view_of(scene, printed("disc", [0.04, 0.04]))):
        assert one.focal_px is None
