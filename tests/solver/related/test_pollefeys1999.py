"""Pollefeys 1999: calibration from the absolute dual quadric, and what planes of dots show of it."""

import numpy as np
import pytest
from helpers_circles import circle_scene
from helpers_views import printed, view_of
from scipy.spatial.transform import Rotation

from roundel.scenes.geometry.conic import conic_of_circle
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.methods.plugin import MethodFailure
from roundel.solver.related.pollefeys1999 import (
    calibrations,
    dual_quadric,
    find,
    focal_of_homographies,
    metric_upgrade,
)

CENTRE = np.array([639.5, 479.5])


def reconstruction(generator, count, motion="free"):
    """Projections (n, 3, 4) in a random projective frame, of random scales, with their focal lengths and rotations."""
    focal = generator.uniform(700, 2000, count)
    if motion == "translation":
        turns = np.zeros((count, 3))
    elif motion == "roll":
        turns = generator.uniform(-2, 2, (count, 1)) * [0.0, 0.0, 1.0]
    else:
        turns = generator.uniform(-0.6, 0.6, (count, 3))
    rotations = Rotation.from_rotvec(turns).as_matrix()
    frame = generator.normal(size=(4, 4))
    out = []
    for f, rotation in zip(focal, rotations, strict=True):
        k = np.array([[f, 0.0, CENTRE[0]], [0.0, f, CENTRE[1]], [0.0, 0.0, 1.0]])
        camera = k @ np.column_stack([rotation, generator.uniform([-1, -1, 3], [1, 1, 5])])
        out.append(camera @ frame * generator.uniform(0.1, 3.0) * generator.choice([-1.0, 1.0]))
    return np.array(out), focal, rotations


def test_500_projective_reconstructions_of_varying_focal_length():
    generator = np.random.default_rng(1)
    worst = 0.0
    for _ in range(500):
        projections, focal, _ = reconstruction(generator, int(generator.integers(3, 8)))
        found = calibrations(projections, CENTRE)
        worst = max(worst, float(np.abs(found[:, 0, 0] / focal - 1.0).max()))
        assert np.array_equal(found[:, :2, 2], np.broadcast_to(CENTRE, (len(focal), 2)))
    assert worst < 1e-6  # 1e-9 in a badly conditioned projective frame, 1e-14 usually


def test_the_upgrade_makes_rotations_of_the_cameras():
    generator = np.random.default_rng(2)
    projections, _, rotations = reconstruction(generator, 5)
    upgrade = metric_upgrade(dual_quadric(projections, CENTRE))
    cameras = np.linalg.inv(calibrations(projections, CENTRE)) @ projections @ upgrade
    found = cameras[:, :, :3] / np.cbrt(np.linalg.det(cameras[:, :, :3]))[:, None, None]
    # Up to one rotation for all: relative rotations are those of the truth.
    for i in range(1, 5):
        assert np.allclose(found[i] @ found[0].T, rotations[i] @ rotations[0].T, atol=1e-8)


@pytest.mark.parametrize("motion", ["translation", "roll"])
def test_critical_motions_are_refused(motion):
    generator = np.random.default_rng(3)
    for _ in range(30):
        with pytest.raises(ValueError, match="the motion is critical"):
            calibrations(reconstruction(generator, 6, motion)[0], CENTRE)


def test_two_views_are_refused():
    with pytest.raises(ValueError, match=r"needs 3 views .* there are 2"):
        calibrations(reconstruction(np.random.default_rng(4), 2)[0], CENTRE)


def test_views_of_other_principal_points_are_refused():
    projections, _, _ = reconstruction(np.random.default_rng(5), 6)
    shift = np.array([[1.0, 0.0, 900.0], [0.0, 0.3, 0.0], [0.0, 0.0, 1.0]])
    with pytest.raises(ValueError, match="no camera with square pixels"):
        calibrations(np.array([shift @ p if i % 2 else p for i, p in enumerate(projections)]), CENTRE)


def planes(generator, count, **keys):
    scenes = [
        circle_scene(generator, np.zeros((1, 2)), np.array([0.5]), focal_px=1100.0, principal_point=(640, 480), **keys)
        for _ in range(count)
    ]
    k = np.array(scenes[0].K)
    return k, np.array([k @ scene.poses[0][:3, [0, 1, 3]] * generator.uniform(0.1, 3) for scene in scenes])


def test_500_sets_of_planes():
    generator = np.random.default_rng(6)
    worst = 0.0
    for _ in range(500):
        k, homographies = planes(generator, int(generator.integers(3, 7)))
        assumed = k.copy()
        assumed[:2, :2] *= generator.uniform(0.3, 3.0)
        worst = max(worst, abs(focal_of_homographies(homographies, assumed) / 1100.0 - 1.0))
    assert worst < 1e-6  # 1e-13 is usual


def test_planes_parallel_to_the_image_are_refused():
    k, homographies = planes(np.random.default_rng(7), 3, tilt_deg=(0, 0))
    with pytest.raises(ValueError, match="parallel to the image in all views"):
        focal_of_homographies(homographies, k)
    with pytest.raises(ValueError, match="there are 2"):
        focal_of_homographies(homographies[:2], k)


def dots(generator):
    turn = np.arange(6) * np.pi / 3
    ring = 1.5 * np.stack([np.cos(turn), np.sin(turn)], axis=1)  # diameters of a dot
    return circle_scene(
        generator,
        ring - ring[0],
        np.full(6, 0.01),
        tilt_deg=(25, 50),
        distance=(20, 26),
        focal_px=700.0,
        principal_point=(319.5, 239.5),
        off_axis_deg=5.0,
    )


RING = printed("disc", [0.02] * 6, dots=6, ring_diameter_m=0.06, turn_deg=0.0)


def test_it_measures_one_focal_length_of_all_views_of_a_ring_of_dots():
    generator = np.random.default_rng(8)
    scenes = [dots(generator) for _ in range(4)]
    others = [view_of(scene, RING, focal_factor=1.2, seed=i + 1) for i, scene in enumerate(scenes[1:])]
    found = find(view_of(scenes[0], RING, focal_factor=1.2, focal_sigma=0.115, companions=lambda: others))
    assert len(found) == 6
    assert abs(found[0].focal_px - 700.0) < 4.0 * found[0].focal_sigma_px < 4.0 * 20.0
    normal, _ = found[0].poses[0]
    assert angle_deg(normal, scenes[0].normal) < 2.0
    # Each dot at its own place.
    true = scenes[0].poses[:, :3, 3]
    for one in found:
        apart = np.linalg.norm(true - one.poses[0][1], axis=1).min()
        assert apart < 0.05 * np.linalg.norm(true[0])


def test_a_view_alone_and_a_print_without_dots_are_refused():
    scene = dots(np.random.default_rng(9))
    with pytest.raises(MethodFailure, match="there are 1"):
        find(view_of(scene, RING))
    with pytest.raises(MethodFailure, match="reads dot_ring, dots at known places; none is printed"):
        find(view_of(scene, printed("disc", [0.02])))
    with pytest.raises(MethodFailure, match="6 of 8 dots of the ring are found"):
        find(view_of(scene, printed("disc", [0.02] * 8, dots=8, ring_diameter_m=0.06)))


def test_circles_that_are_no_ring_of_dots_are_refused():
    scene = dots(np.random.default_rng(10))
    scene.poses[2, :3, 3] += 0.005 * scene.poses[2, :3, 0]
    scene.conics[2] = conic_of_circle(scene.poses[2], 0.01, scene.K)
    with pytest.raises(MethodFailure, match="are not the dots of the ring"):
        find(view_of(scene, RING))
