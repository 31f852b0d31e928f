"""Identities of circle, centre, vanishing line, circular points and focal length, each on 500 random scenes."""

import numpy as np
import pytest
from helpers_circles import circle_scene

from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.views.dual_circular_points import (
    centre_from_line,
    circular_points,
    dual_circular_points,
    dual_conic,
    focal_from_dual,
    image_frame,
    inverse_focal_squared,
    line_from_centre,
    moved_conic,
    normal_from_line,
)

# The issue's own check found errors below 3e-13 on 500 scenes; a scene's conic has five products of four factors.
EXACT = 3e-12


@pytest.fixture(scope="module")
def scenes():
    generator = np.random.default_rng(20)
    return [circle_scene(generator, np.zeros((1, 2)), np.array([0.5])) for _ in range(500)]


def in_frame(scene):
    """Conic, centre and line of a scene with the principal point at the origin, in units of the focal length."""
    frame = image_frame(scene.K[:2, 2], scene.K[0, 0])
    line = scene.line @ np.linalg.inv(frame)
    return moved_conic(scene.conics[0], frame), frame @ np.append(scene.centre_px[0], 1.0), line / np.linalg.norm(line)


def apart(a, b):
    return np.linalg.norm(np.cross(a / np.linalg.norm(a), b / np.linalg.norm(b)))


def test_the_line_is_the_polar_of_the_centre_and_the_centre_its_pole(scenes):
    for scene in scenes:
        conic, centre, line = in_frame(scene)
        assert apart(line_from_centre(conic, centre), line) < EXACT
        assert apart(centre_from_line(conic, line), centre) < EXACT


def test_the_dual_of_the_circular_points_is_that_of_two_orthogonal_directions(scenes):
    for scene in scenes:
        conic, _, line = in_frame(scene)
        dual = dual_circular_points(conic, line)
        one, two = scene.poses[0, :3, 0], scene.poses[0, :3, 1]  # K^-1 H = [r1 r2 t] in this frame
        expected = np.outer(one, one) + np.outer(two, two)
        assert np.abs(dual - expected / np.linalg.norm(expected)).max() < EXACT


def test_circular_points_lie_on_the_circle_the_line_and_the_absolute_conic(scenes):
    for scene in scenes:
        conic, _, line = in_frame(scene)
        point = circular_points(dual_circular_points(conic, line))
        point = point / np.linalg.norm(point)
        assert abs(point @ conic @ point) < EXACT
        assert abs(point @ line) < EXACT
        assert abs(point @ point) < EXACT  # omega = I in units of f


def test_the_focal_length_follows_from_a_circular_point(scenes):
    for scene in scenes:
        frame = image_frame(scene.K[:2, 2], 1000.0)
        line = scene.line @ np.linalg.inv(frame)
        dual = dual_circular_points(moved_conic(scene.conics[0], frame), line)
        # f divides by I3^2, the square of the sine of the tilt: 25 at 12 degrees.
        assert 1000.0 * focal_from_dual(dual) == pytest.approx(scene.K[0, 0], rel=1e-10)
        assert inverse_focal_squared(circular_points(dual)) == pytest.approx((1000.0 / scene.K[0, 0]) ** 2, rel=1e-10)


def test_the_normal_follows_from_the_line(scenes):
    lines = np.array([scene.line for scene in scenes])
    normals = np.array([normal_from_line(line, scene.K) for line, scene in zip(lines, scenes, strict=True)])
    assert angle_deg(normals, np.array([scene.normal for scene in scenes])).max() < 1e-10


def test_many_at_once_are_as_one_by_one(scenes):
    conics = np.array([in_frame(scene)[0] for scene in scenes[:5]])
    lines = np.array([in_frame(scene)[2] for scene in scenes[:5]])
    together = dual_circular_points(conics, lines)
    assert np.array_equal(together[3], dual_circular_points(conics[3], lines[3]))
    assert np.array_equal(circular_points(together)[2], circular_points(together[2]))


def test_a_plane_parallel_to_the_image_has_no_focal_length():
    generator = np.random.default_rng(21)
    scene = circle_scene(generator, np.zeros((1, 2)), np.array([0.5]), tilt_deg=(0.0, 0.0))
    frame = image_frame(scene.K[:2, 2], 1000.0)
    dual = dual_circular_points(moved_conic(scene.conics[0], frame), np.array([0.0, 0.0, 1.0]))
    with pytest.raises(ValueError, match="parallel to the image"):
        focal_from_dual(dual)


def test_circular_points_of_no_camera_are_refused():
    # I = (1, 0.1 i, 0.5): I1^2 + I2^2 and I3^2 have one sign, and f^2 would be negative.
    one, two = np.array([1.0, 0.0, 0.5]), np.array([0.0, 0.1, 0.0])
    with pytest.raises(ValueError, match="no focal length fits"):
        focal_from_dual(np.outer(one, one) + np.outer(two, two))


def test_a_conic_that_is_a_pair_of_lines_is_refused():
    with pytest.raises(ValueError, match="pair of lines"):
        dual_conic(np.diag([1.0, -1.0, 0.0]))
    with pytest.raises(ValueError, match="3x3"):
        dual_conic(np.zeros((2, 3)))
