"""`locate(..., knowledge="coplanar")` on drawn circles."""

import numpy as np
import pytest
from helpers_images import picture

import roundel
from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera

K = np.array([[500.0, 0, 319.5], [0, 500.0, 239.5], [0, 0, 1]])
PLACES_M = ((-0.09, -0.05), (0.08, -0.06), (0.0, 0.03), (-0.08, 0.09), (0.1, 0.08))


def drawn(normals):
    """An image of five circles of 50 mm at 0.7 m, each with its normal: in one plane if the normals are the same."""
    layers = []
    for normal, place in zip(normals, PLACES_M, strict=True):
        across = camera_from_marker_of(normals[0], np.array([0, 0, 0.7]))[:3, :2]
        centre = np.array([0, 0, 0.7]) + across @ np.array(place)
        conic = conic_of_circle(camera_from_marker_of(normal, centre), 0.025, K)
        layers.append((ellipse_of_conic(conic), 40.0))
    return picture(layers, 640, 480, noise_dn=1.0, seed=1, subpixels=16)


def camera(factor):
    k = K.copy()
    k[0, 0] = k[1, 1] = factor * 500.0
    return UncertainCamera(Camera(640, 480, k), 0.115)


def test_the_circles_of_a_board_are_told_apart_and_give_the_focal_length():
    normal = normal_of(35.0, 20.0)
    image = drawn([normal] * 5)
    alone = roundel.locate(image, 0.05, camera(1.1), curve="linear")
    together = roundel.locate(image, 0.05, camera(1.1), curve="linear", knowledge="coplanar")
    assert [e.chosen for e in alone] == [None] * 5
    assert len(together) == 5
    for e in together:
        assert angle_deg(e.normal[e.chosen], normal) < 0.3
        assert max(e.probability) > 0.99
        assert e.choice_basis == "5 circles in one plane"
        assert e.focal_px == pytest.approx(500.0, abs=4 * e.focal_sigma_px)
        assert e.camera.K[0, 0] == pytest.approx(500.0, rel=0.02)
        # The candidate that is not meant keeps its place in the order of the conventions.
        assert e.normal[0, 2] <= e.normal[1, 2]
    single = min(angle_deg(n, normal) for e in alone for n in e.normal)
    assert angle_deg(together[0].normal[together[0].chosen], normal) < max(single, 0.3)


def test_a_circle_that_is_turned_out_of_the_plane_says_so():
    board, other = normal_of(35.0, 20.0), normal_of(20.0, 160.0)
    found = roundel.locate(drawn([board] * 4 + [other]), 0.05, camera(1.0).camera, curve="linear", knowledge="coplanar")
    stray = [e for e in found if any("not in the plane" in caveat for caveat in e.caveats)]
    assert len(stray) == 1
    assert min(angle_deg(n, other) for n in stray[0].normal) < 1.0
    assert stray[0].chosen is None
    assert all(angle_deg(e.normal[e.chosen], board) < 0.5 for e in found if e.chosen is not None)


def test_circles_of_no_common_plane_are_solved_alone():
    normals = [normal_of(tilt, turn) for tilt, turn in ((10, 0), (25, 70), (40, 140), (50, -150), (60, -60))]
    found = roundel.locate(drawn(normals), 0.05, camera(1.0).camera, curve="linear", knowledge="coplanar")
    assert len(found) == 5
    assert sum(e.chosen is None for e in found) >= 3
    assert all(e.caveats for e in found if e.chosen is None)
