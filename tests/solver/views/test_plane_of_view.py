"""Circles of a view to poses in one plane."""

import numpy as np
import pytest
from helpers_circles import circle_scene
from helpers_views import printed, view_of

from roundel.scenes.camera.focal_fusion import fused_focal_px
from roundel.scenes.geometry.pose import angle_deg
from roundel.solver.methods.plugin import MethodFailure
from roundel.solver.pose.coplanar_circles import CoplanarFit
from roundel.solver.pose.focal_uncertainty import MeasuredFocal
from roundel.solver.views.plane_of_view import (
    LARGEST_SIGMA,
    camera_of,
    focal_of_fit,
    founds_in_plane,
    printed_circles,
    refuse_misfit,
)

GIVEN = {"focal_px": 700.0, "principal_point": (319.5, 239.5), "off_axis_deg": 5.0, "distance": (10, 10)}
OFFSETS = np.array([[0.0, 0.0], [1.5, 0.0]])


def scene_of(seed, radii, **keys):
    return circle_scene(
        np.random.default_rng(seed), OFFSETS, np.array(radii), **{"tilt_deg": (40, 40), **GIVEN, **keys}
    )


@pytest.mark.parametrize("seed", range(4))
def test_discs_of_two_sizes_get_their_own_diameters_whatever_their_order(seed):
    # The smaller disc may be nearer, and then look larger.
    scene = scene_of(seed, [0.02, 0.019], tilt_deg=(60, 60))
    for order in (1, -1):
        view = view_of(scene, printed("disc", [0.04, 0.038][::order]))
        circles, diameters = printed_circles(view, 2)
        for found in founds_in_plane(view, circles, diameters, None):
            (normal, centre), *_ = found.poses
            assert angle_deg(normal, scene.normal) < 1.0
            apart = np.linalg.norm(scene.poses[:, :3, 3] - centre, axis=1).min()
            assert apart < 0.005 * np.linalg.norm(centre)


def test_a_missing_disc_of_another_size_is_refused():
    scene = scene_of(1, [0.02, 0.015])
    with pytest.raises(MethodFailure, match="only 2 of 3 printed circles are found"):
        printed_circles(view_of(scene, printed("disc", [0.04, 0.03, 0.05])), 2)
    # Of equal ones any two will do.
    circles, diameters = printed_circles(view_of(scene, printed("disc", [0.04] * 3)), 2)
    assert len(circles) == len(diameters) == 2


def test_more_circles_than_are_printed_are_left_out():
    scene = circle_scene(
        np.random.default_rng(2), np.array([[0.0, 0.0], [1.5, 0.0], [0.0, 1.2]]), np.array([0.02, 0.02, 0.01]), **GIVEN
    )
    circles, _ = printed_circles(view_of(scene, printed("disc", [0.04, 0.04])), 2)
    assert len(circles) == 2
    assert min(circle.ellipse[2] for circle in circles) > 30.0


def test_a_view_without_marker_rows_takes_the_diameter_given():
    circles, diameters = printed_circles(view_of(scene_of(3, [0.02, 0.02]), []), 2)
    assert len(circles) == 2
    assert np.array_equal(diameters, [0.04, 0.04])


def fit(**keys):
    return CoplanarFit(
        **{
            "focal_px": 700.0,
            "focal_sigma": 0.1,
            "normal": np.array([0.0, 0.0, -1.0]),
            "centre": np.zeros((2, 3)),
            "radius": np.ones(2),
            "chi2": 1.0,
            "freedom": 1,
            **keys,
        }
    )


def test_a_focal_length_is_stated_up_to_its_largest_sigma():
    assert focal_of_fit(fit()) == MeasuredFocal(700.0, 0.1)
    assert focal_of_fit(fit(focal_sigma=1.01 * LARGEST_SIGMA)) is None
    assert focal_of_fit(fit(focal_sigma=float("inf"))) is None


def test_a_misfit_of_one_in_a_million_is_refused():
    refuse_misfit(fit(chi2=23.9), "the circles are not in one plane")
    with pytest.raises(MethodFailure, match=r"not in one plane: the best fit leaves 5\.\d sigma"):
        refuse_misfit(fit(chi2=26.0), "the circles are not in one plane")


def test_an_exact_camera_stays_and_an_uncertain_one_is_fused():
    scene = scene_of(4, [0.02, 0.02])
    exact = view_of(scene, [], focal_factor=1.2)
    measured = MeasuredFocal(700.0, 0.05)
    assert camera_of(exact, measured) is exact.camera
    uncertain = view_of(scene, [], focal_factor=1.2, focal_sigma=0.115)
    assert camera_of(uncertain, None) is uncertain.camera
    camera = camera_of(uncertain, measured)
    assert camera.K[0, 0] == pytest.approx(fused_focal_px(840.0, 0.115, 700.0, 35.0)[0])
    assert np.array_equal(camera.K[:, 2], uncertain.camera.K[:, 2])
