"""Wu 2004: both normals of a circle, and the parallel ones of several."""

import numpy as np
import pytest
from helpers_circles import circle_scene, scattered
from helpers_views import printed, view_of

from roundel.scenes.geometry.conic import conic_of_circle
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.methods.plugin import MethodFailure
from roundel.solver.related.wu2004 import both_poses, find, most_parallel

IMAGE = {"principal_point": (319.5, 239.5), "off_axis_deg": 5.0}


def eigen_normals(conic, focal):
    """The two normals of the docstring's eigen form, of a conic with the principal point at the origin."""
    scale = np.diag([focal, focal, 1.0])
    cone = scale @ conic @ scale
    values, vectors = np.linalg.eigh(-cone if np.linalg.eigvalsh(cone)[1] < 0 else cone)
    l3, l2, l1 = values
    g, h = np.sqrt((l2 - l3) / (l1 - l3)), np.sqrt((l1 - l2) / (l1 - l3))
    # Columns of V: of l1, l2, l3.
    normals = np.array([vectors[:, 2] * h * s + vectors[:, 0] * g for s in (1.0, -1.0)])
    return normals


def test_the_eigen_form_of_the_paper_gives_the_same_normals():
    generator = np.random.default_rng(1)
    for _ in range(100):
        scene = circle_scene(generator, np.zeros((1, 2)), np.array([0.5]), principal_point=(0.0, 0.0))
        normals = both_poses(scene.conics[0], scene.K, 0.5).normal
        eigen = eigen_normals(scene.conics[0], scene.K[0, 0])
        # n and -n are one plane.
        apart = np.linalg.norm(np.cross(normals[:, None], eigen[None]), axis=-1)
        assert min(max(apart[0, 0], apart[1, 1]), max(apart[0, 1], apart[1, 0])) < 1e-7


def test_500_scenes_one_circle_gives_the_truth_among_two_and_two_choose_it():
    generator = np.random.default_rng(2)
    worst_normal = worst_centre = 0.0
    for _ in range(500):
        scene = circle_scene(generator, *scattered(generator, 2))
        poses = both_poses(scene.conics, scene.K, scene.radii_m)
        chosen = most_parallel(poses.normal).chosen
        for i in range(2):
            worst_normal = max(worst_normal, float(angle_deg(poses.normal[i, chosen[i]], scene.normal)))
            centre = scene.poses[i, :3, 3]
            error = np.linalg.norm(poses.centre_m[i, chosen[i]] - centre) / np.linalg.norm(centre)
            worst_centre = max(worst_centre, float(error))
    assert np.radians(worst_normal) < 1e-6
    assert worst_centre < 1e-6


def test_one_circle_cannot_choose():
    with pytest.raises(ValueError, match="one alone has two normals"):
        most_parallel(np.zeros((1, 2, 3)))


def test_circles_that_are_not_parallel_are_refused():
    generator = np.random.default_rng(3)
    one = circle_scene(generator, np.zeros((1, 2)), np.array([0.5]), tilt_deg=(10, 10), focal_px=1000.0)
    other = circle_scene(generator, np.zeros((1, 2)), np.array([0.5]), tilt_deg=(60, 60), focal_px=1000.0)
    normals = np.concatenate([both_poses(s.conics, s.K, 0.5).normal for s in (one, other)])
    with pytest.raises(ValueError, match="not parallel: their closest normals are"):
        most_parallel(normals)


def test_it_finds_discs_in_an_image_and_chooses_between_two():
    generator = np.random.default_rng(4)
    offsets, radii = np.array([[0.0, 0.0], [1.5, 0.0]]), np.array([0.02, 0.02])
    scene = circle_scene(generator, offsets, radii, tilt_deg=(40, 40), distance=(12, 12), focal_px=700.0, **IMAGE)
    found = find(view_of(scene, printed("disc", [0.04, 0.04])))
    assert len(found) == 2
    for one in found:
        assert angle_deg(one.poses[one.chosen][0], scene.normal) < 1.0
    # Alone, each has two normals.
    alone = circle_scene(generator, offsets[:1], radii[:1], focal_px=700.0, **IMAGE)
    (only,) = find(view_of(alone, printed("disc", [0.04])))
    assert only.chosen is None
    assert min(angle_deg(normal, alone.normal) for normal, _ in only.poses) < 1.0


def test_discs_of_different_planes_in_an_image_are_refused():
    generator = np.random.default_rng(7)
    scene = circle_scene(
        generator,
        np.array([[0.0, 0.0], [1.5, 0.0]]),
        np.array([0.02, 0.02]),
        tilt_deg=(0, 0),
        distance=(10, 10),
        focal_px=700.0,
        **IMAGE,
    )
    turned = scene.poses[1].copy()
    turned[:3, :3] = turned[:3, :3] @ np.array([[1, 0, 0], [0, 0.5, -0.866], [0, 0.866, 0.5]])
    scene.conics[1] = conic_of_circle(turned, 0.02, scene.K)
    with pytest.raises(MethodFailure, match="not parallel: their closest normals are"):
        find(view_of(scene, printed("disc", [0.04, 0.04])))


def test_a_print_without_circles_is_refused():
    scene = circle_scene(np.random.default_rng(5), np.zeros((1, 2)), np.array([0.02]))
    with pytest.raises(MethodFailure, match="the printed marker is chessboard"):
        find(view_of(scene, printed("chessboard", [0.04])))
