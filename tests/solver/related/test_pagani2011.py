from typing import Any

import numpy as np
import pytest
from helpers_markers import sheet
from helpers_prints import drawn, plane_homography, small_view, view_of

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import angle_deg
from roundel.scenes.markers.ink_pattern import reflectance_at
from roundel.scenes.markers.ring_codes import ring_code_radii
from roundel.solver.methods.plugin import Found, MethodFailure
from roundel.solver.related.pagani2011 import choose_pose, decides, expected_prints, find, polar_grid
from roundel.solver.views.circles_of_view import CircleImage
from roundel.solver.views.disc_coverage import coverage_of
from roundel.solver.views.marker_pixels import light_image

ROWS, COLUMNS = np.mgrid[:96, :96]
PLACES = np.stack([COLUMNS.ravel(), ROWS.ravel()], axis=1).astype(np.float64)


def crowns(radii: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([[0.0, 0.0, r] for r in radii]), np.where(np.arange(len(radii)) % 2 == 0, 1.0, -1.0)


class _Fit:
    blur_px = 0.6


def exact_circle(pose: np.ndarray, K: np.ndarray) -> CircleImage:
    conic = conic_of_circle(pose, 1.0, K)
    nothing: Any = None
    fit: Any = _Fit()
    return CircleImage(ellipse_of_conic(conic), np.zeros((5, 5)), conic, 1.0, nothing, fit)


@pytest.mark.parametrize("scenes", [82, pytest.param(500, marks=pytest.mark.slow)])  # each of the 41 prints twice
def test_exact_ellipses_and_prints_give_the_exact_pose_or_both_at_low_tilt(scenes: int) -> None:
    rng = np.random.default_rng(1)
    both, wrong, worst = 0, 0, 0.0
    for n in range(scenes):
        pose, K = small_view(rng, semi_px=(24.0, 34.0), tilt_deg=(0.0, 65.0))
        discs, weights = crowns(ring_code_radii(n % 41))
        covered = coverage_of(PLACES, plane_homography(pose, K), discs, 0.36).covered @ weights
        view = view_of(200.0 - 190.0 * covered.reshape(96, 96), K, "ring_code")
        found = choose_pose(light_image(view), exact_circle(pose, K), view, expected_prints(view))
        assert isinstance(found, Found), (n, found)
        assert found.identity == n % 41
        errors = [float(angle_deg(normal, pose[:3, 2])) for normal, _ in found.poses]
        if len(found.poses) == 2:
            both += 1
            assert found.chosen is None
        wrong += len(found.poses) == 1 and errors[0] > 1e-6
        worst = max(worst, min(errors) if len(found.poses) == 2 or errors[0] < 1e-6 else 0.0)
    # The pose itself is that of the ellipse, in closed form.
    assert worst < 1e-6
    assert wrong == 0
    assert both < 0.4 * scenes


@pytest.mark.parametrize("kind", ["ring", "rings", "coded_rings", "disc_with_tick", "ring_code"])
def test_the_expected_print_is_the_printed_one(kind: str) -> None:
    made = sheet(kind)
    (part,) = made.parts
    marker = {"kind": part.kind, "diameter_m": 0.08, "layout": part.layout}
    _, K = small_view(np.random.default_rng(2))
    view = view_of(np.zeros((96, 96)), K, kind)
    view.markers[:] = [marker]
    prints = expected_prints(view)
    expected = next(one for one in prints if one.identity in (None, part.layout.get("id")))
    radius, angle = polar_grid()
    x, y = 0.04 * np.outer(radius, np.cos(angle)), 0.04 * np.outer(radius, np.sin(angle))
    ink = (reflectance_at(made, x, y) < 0.4).astype(float)
    # Means over a ring of the grid against its middle: they differ where an edge is inside.
    assert np.mean(np.abs(ink - expected.ink)) < 0.1
    settled = (expected.ink == 0) | (expected.ink == 1)
    assert settled.mean() > 0.5
    np.testing.assert_array_equal(ink[settled], expected.ink[settled])


def test_at_low_tilt_it_says_that_it_cannot_tell() -> None:
    pose, K = small_view(np.random.default_rng(3), tilt_deg=(0.0, 0.2))
    levels = drawn((96, 96), plane_homography(pose, K), *crowns((1.0, 0.7, 0.4)))
    (found,) = find(view_of(levels, K, "rings", {"diameters_m": [2.0, 1.4, 0.8]}))
    assert len(found.poses) == 2
    assert found.chosen is None


def test_at_high_tilt_it_tells() -> None:
    pose, K = small_view(np.random.default_rng(4), semi_px=(28.0, 30.0), tilt_deg=(40.0, 50.0))
    levels = drawn((96, 96), plane_homography(pose, K), *crowns((1.0, 0.7, 0.4)))
    (found,) = find(view_of(levels, K, "rings", {"diameters_m": [2.0, 1.4, 0.8]}))
    ((normal, centre),) = found.poses
    assert angle_deg(normal, pose[:3, 2]) < 0.5
    assert np.linalg.norm(centre - pose[:3, 3]) / pose[2, 3] < 2e-3


@pytest.mark.parametrize("kind", ["disc", "dot_ring", "chessboard"])
def test_a_marker_without_a_print_inside_is_refused(kind: str) -> None:
    pose, K = small_view(np.random.default_rng(5))
    levels = drawn((96, 96), plane_homography(pose, K), *crowns((1.0,)))
    with pytest.raises(MethodFailure, match=f"the printed marker is {kind}, with no print inside its circle"):
        find(view_of(levels, K, kind))


def test_another_print_than_the_expected_one_is_refused() -> None:
    pose, K = small_view(np.random.default_rng(6))
    levels = drawn((96, 96), plane_homography(pose, K), *crowns((1.0, 0.7, 0.4)))
    with pytest.raises(
        MethodFailure, match="no known print is read: the print inside a circle is not the expected one"
    ):
        find(view_of(levels, K, "rings", {"diameters_m": [2.0, 0.8, 0.4]}))


def test_an_empty_image_has_nothing() -> None:
    _, K = small_view(np.random.default_rng(7))
    assert find(view_of(np.full((96, 96), 180.0), K, "rings", {"diameters_m": [2.0, 0.8, 0.4]})) == []


@pytest.mark.parametrize(("better", "worse"), [(0.827, 0.624), (0.8561, 0.7647), (0.8561, 0.6197)])
def test_correlations_with_which_a_wrong_identity_was_read_do_not_decide(better: float, worse: float) -> None:
    assert not decides(better, worse)
    assert decides(0.95, 0.75)
