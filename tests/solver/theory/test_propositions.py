"""Propositions 1 to 3: the errata's percentages, over fresh random configurations."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, vanishing_line
from roundel.scenes.geometry.pose import FACING, angle_deg, camera_from_marker_of, minimal_rotation, normal_of
from roundel.solver.pose.circle_pose import poses_from_conic, poses_from_ellipse
from roundel.solver.theory.conic_pencil import conic_pencil
from roundel.solver.theory.propositions import (
    PlaneView,
    approaches_vanishing_line,
    criterion,
    depth_product,
    minor_axis_offset_px,
    outside_thales_disc,
    plane_pencil,
    plane_view,
    separates,
    separating_lines,
    sufficient_conditions,
)

K = np.array([[1280.0, 0.0, 639.5], [0.0, 1280.0, 359.5], [0.0, 0.0, 1.0]])
K_PHONE = np.array([[1016.0, 0.0, 639.5], [0.0, 1016.0, 359.5], [0.0, 0.0, 1.0]])


def poses_of(normal, centre):
    pose = np.zeros((len(normal), 4, 4))
    pose[:, :3, :3] = minimal_rotation([0.0, 0.0, -1.0], normal) @ FACING
    pose[:, :3, 3] = centre
    pose[:, 3, 3] = 1.0
    return pose


def random_poses(count, seed, k=K_PHONE, distance_D=(5, 50), tilt=(10, 70), spread_px=None, radius=0.5):
    """Camera poses over the errata's distribution; circles whose printed face is seen, wholly in front."""
    generator = np.random.default_rng(seed)
    normal = normal_of(generator.uniform(*tilt, count), generator.uniform(-180, 180, count))
    if spread_px is None:
        pixel = generator.uniform([0, 0], [1280, 720], (count, 2))
    else:
        pixel = k[:2, 2] + generator.normal(0, spread_px, (count, 2))
    sight = np.linalg.solve(k, np.column_stack([pixel, np.ones(count)]).T).T
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    centre = sight * 2 * radius * generator.uniform(*distance_D, (count, 1))
    seen = np.sum(-normal * sight, axis=1) > 0.02
    seen &= centre[:, 2] > radius * np.hypot(normal[:, 0], normal[:, 1])
    return poses_of(normal[seen], centre[seen])


def depths(pose, points):
    return np.einsum("nj,nkj->nk", pose[:, 2, :2], points) + pose[:, 2, 3, None]


def close_up(count=20_000, seed=5):
    """Large circles near the camera, where the propositions are put to the test: half on one side, half on two."""
    return random_poses(count, seed, distance_D=(0.7, 5), tilt=(1, 85))


def test_proposition_1():
    pose = close_up()
    plane = plane_pencil(pose, 0.5)
    ones = np.ones((len(pose), 1))
    x1, x3 = (np.concatenate([plane.limiting_point_m[:, i], ones], axis=1) for i in (0, 1))
    assert separates(plane.radical_axis, x1, x3).all()
    # Limiting points: inverse to each other in both circles; x1 inside the circle, hence in front.
    assert np.all(np.linalg.norm(plane.limiting_point_m[:, 0], axis=1) < 0.5)
    assert np.all(depths(pose, plane.limiting_point_m)[:, 0] > 0)
    product = np.sum(plane.limiting_point_m[:, 0] * plane.limiting_point_m[:, 1], axis=1)
    # m3 may be a thousand times R, and the product of both points has its rounding.
    size = np.linalg.norm(plane.limiting_point_m[:, 1], axis=1)
    assert np.abs(product - 0.25).max() < 1e-12 * max(size.max(), 1.0)
    m1, m3 = plane.limiting_m.T
    assert np.allclose(m1 * m3, -(plane.height_m**2), rtol=1e-12)
    x_o = (plane.ell_m**2 - 0.25 - plane.height_m**2) / (2 * plane.ell_m)
    for m in (m1, m3):
        assert np.all(np.abs(m * m - 2 * x_o * m - plane.height_m**2) < 1e-12 * (m * m + 1))


def test_proposition_2():
    pose = close_up()
    pencil = conic_pencil(conic_of_circle(pose, 0.5, K_PHONE), K_PHONE)
    # Exactly one of both lines separates, always, and it is the second.
    assert np.array_equal(separating_lines(pencil), np.tile([False, True], (len(pose), 1)))
    same = np.prod(depths(pose, plane_pencil(pose, 0.5).limiting_point_m), axis=1) > 0
    assert 0.2 < same.mean() < 0.8  # both cases are there
    truth = np.linalg.solve(K_PHONE.T, pose[:, :3, 2].T).T
    separated = separates(truth, pencil.base_point[:, 0], pencil.base_point[:, 2])
    assert np.array_equal(separated, ~same)


def test_proposition_3_and_its_print():
    pose = close_up()
    view, plane = plane_view(pose, 0.5), plane_pencil(pose, 0.5)
    both = depths(pose, plane.limiting_point_m)
    same = np.prod(both, axis=1) > 0
    e = criterion(view)
    clear = np.abs(e) > 1e-12
    assert clear.mean() > 0.999
    assert np.array_equal((e >= 0)[clear], same[clear])  # corrected: 100 %
    assert not np.any(((e <= 0) == same)[clear])  # as printed: 0 %
    assert np.array_equal((depth_product(pose, 0.5) > 0)[clear], same[clear])
    # depth1 depth3 = sin^2(theta) / ell^2 E, lengths in units of the camera's distance to q.
    reach = plane.height_m / view.sin_theta
    ell = np.hypot(view.x_c, view.y_c + view.cos_theta)
    assert np.allclose(ell, plane.ell_m / reach, rtol=1e-9)
    left = np.prod(both, axis=1) / reach**2
    # x3 can be far: the product's rounding is that of its larger factor.
    scale = np.abs(both).max(axis=1) / reach
    assert np.all(np.abs(left - view.sin_theta**2 / ell**2 * e) < 1e-11 * (1 + scale**2))
    assert np.allclose(
        depth_product(pose, 0.5), left * reach**2 * plane.ell_m**2, rtol=1e-6, atol=1e-9 * reach.max() ** 4
    )


fractions = st.fractions(-3, 3, max_denominator=40)


@given(fractions, fractions, fractions, st.fractions(0, 1, max_denominator=40).filter(lambda t: t > 0))
def test_the_identity_of_proposition_3_is_exact(x, y, radius, t):
    """In rational numbers, c and s from the half angle: no tolerance."""
    c, s = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
    e = (1 + c * y) * (x * x + y * y + c * y) - c * radius**2 * (y + c)
    assert e == c * (y * y - radius**2) * (y + c) + c * y * (1 + x * x) + x * x + y * y
    ell2 = x * x + (y + c) ** 2
    # Depth of F = (0, -c) is s^2; a step along F -> centre changes it by c (y + c) / ell; m1 + m3 = 2 x_o and
    # m1 m3 = -s^2.
    at_foot, rise, twice = s * s, c * (y + c), ell2 - radius**2 - s * s
    assert ell2 * at_foot**2 + twice * rise * at_foot - (rise * s) ** 2 == s * s * e
    assert isinstance(e, Fraction)
    view = PlaneView(*(np.array(float(v)) for v in (c, s, x, y, radius)))
    assert float(criterion(view)) == pytest.approx(float(e), abs=1e-12)  # terms up to 100, ten roundings


def test_the_printed_principal_line_passes_through_the_foot():
    # d = [0, 1, cos theta] is Y = -cos theta, the line through F, which always separates x1 and x3.
    pose = close_up(2000)
    plane = plane_pencil(pose, 0.5)
    view = plane_view(pose, 0.5)
    # Depth in the paper's units is 1 + cos(theta) Y, so that depth gives Y.
    reach = plane.height_m / view.sin_theta
    y = (depths(pose, plane.limiting_point_m) / reach[:, None] - 1.0) / view.cos_theta[:, None]
    assert np.all(np.prod(y + view.cos_theta[:, None], axis=1) < 0)


def test_the_exact_criterion_names_the_pose():
    """E > 0 <=> the true pose is candidate 0; also where the optical axis misses the plane."""
    pose = close_up()
    clear = np.abs(depth_product(pose, 0.5)) > 1e-9
    pose = pose[clear]
    same = depth_product(pose, 0.5) > 0
    poses = poses_from_conic(conic_of_circle(pose, 0.5, K_PHONE), K_PHONE, 0.5)
    nearest = np.argmin(angle_deg(poses.normal, pose[:, None, :3, 2]), axis=1)
    assert np.array_equal(nearest == 0, same)


def test_no_image_can_tell():
    """Candidate 0 has E > 0 and candidate 1 has E < 0, whatever the truth is."""
    pose = close_up(5000)
    poses = poses_from_conic(conic_of_circle(pose, 0.5, K_PHONE), K_PHONE, 0.5)
    signs = [depth_product(poses_of(poses.normal[:, i], poses.centre_m[:, i]), 0.5) for i in (0, 1)]
    clear = np.minimum(np.abs(signs[0]), np.abs(signs[1])) > 1e-9
    assert clear.mean() > 0.99
    assert np.all(signs[0][clear] > 0)
    assert np.all(signs[1][clear] < 0)


def test_sufficient_conditions():
    views = [plane_view(close_up(), 0.5), plane_view(random_poses(20_000, 6), 0.5)]
    # The plane's own frame, uniformly: circles in front of the camera.
    generator = np.random.default_rng(7)
    theta = np.radians(generator.uniform(1, 89, 40_000))
    x, y, radius = (
        generator.uniform(-2, 2, 40_000),
        generator.uniform(-3, 3, 40_000),
        generator.uniform(0.01, 2, 40_000),
    )
    front = 1 + np.cos(theta) * (y - radius) > 0
    views.append(PlaneView(*(v[front] for v in (np.cos(theta), np.sin(theta), x, y, radius))))
    for view in views:
        one, two = sufficient_conditions(view)
        e = criterion(view)
        both = one & two
        assert both.sum() > 1000
        assert np.all(e[both] > 0)  # 100 %
        # For yc < -c, (i) alone is enough.
        assert np.all(e[view.y_c < -view.cos_theta] > 0)
        # For yc > 0 and xc = 0, (ii) can be weakened to R^2 < yc^2 + yc / c.
    on_axis = PlaneView(views[2].cos_theta, views[2].sin_theta, 0 * views[2].x_c, views[2].y_c, views[2].radius)
    ahead = on_axis.y_c > 0
    weak = on_axis.radius**2 < on_axis.y_c**2 + on_axis.y_c / on_axis.cos_theta
    assert np.array_equal((criterion(on_axis) > 0)[ahead], weak[ahead])
    # Neither is sufficient alone.
    one, two = sufficient_conditions(views[2])
    assert np.any(criterion(views[2])[one] < 0)
    assert np.any(criterion(views[2])[two] < 0)


def test_image_form():
    pose = close_up()
    pose = pose[np.abs(depth_product(pose, 0.5)) > 1e-6]
    ellipse = ellipse_of_conic(conic_of_circle(pose, 0.5, K_PHONE))
    line = np.stack([vanishing_line(p, K_PHONE) for p in pose])
    approaches = approaches_vanishing_line(ellipse, -2 * line, K_PHONE[:2, 2])
    assert np.array_equal(approaches, depth_product(pose, 0.5) > 0)


def test_small_marker_limit():
    pose = random_poses(20_000, 8)
    same = depth_product(pose, 0.5) > 0
    met = -pose[:, 2, 2] > 0.01
    thales = outside_thales_disc(plane_view(pose[met], 0.5))
    # Errata: 99.9 % for r in [5, 50] D.
    assert np.mean(thales == same[met]) > 0.998
    # The same in the image: n_z > (n . s) s_z with the errata's n = -normal.
    sight = pose[:, :3, 3] / np.linalg.norm(pose[:, :3, 3], axis=1, keepdims=True)
    away = -pose[:, :3, 2]
    assert np.array_equal((away[:, 2] > np.sum(away * sight, axis=1) * sight[:, 2])[met], thales)
    # In the limit itself the two are one.
    tiny = plane_view(pose[met], 1e-6)
    assert np.mean((criterion(tiny) > 0) == outside_thales_disc(tiny)) > 0.9999


@pytest.mark.parametrize(
    ("spread", "same", "sufficient"),
    [(None, 0.69, 0.50), (0.15 * 1280, 0.63, 0.47), (0.05 * 1280, 0.54, 0.39), (0.01 * 1280, 0.49, 0.14)],
)
def test_frequencies_of_random_views(spread, same, sufficient):
    """Errata, section 3, "Frequency in random AR poses": what a blind choice would be worth."""
    pose = random_poses(20_000, 9, spread_px=spread)
    assert np.mean(depth_product(pose, 0.5) > 0) == pytest.approx(same, abs=0.02)
    met = pose[-pose[:, 2, 2] > 0.01]
    one, two = sufficient_conditions(plane_view(met, 0.5))
    # Published to two digits, over some thousand poses each: 0.005 and three standard errors of 0.005.
    assert np.mean(one & two) * len(met) / len(pose) == pytest.approx(sufficient, abs=0.02)


OFFSET_PX = {(15, 15): 0.36, (15, 30): 0.62, (15, 45): 0.71, (50, 15): 0.03, (50, 30): 0.06, (50, 45): 0.06}
AIMED = {(15, 15): 0.61, (15, 30): 0.73, (15, 45): 0.74, (50, 15): 0.53, (50, 30): 0.53, (50, 45): 0.53}


@pytest.mark.parametrize(("distance", "tilt"), OFFSET_PX)
def test_the_papers_own_set_up(distance, tilt):
    """Aimed at the circle's centre: E = -cos^2 R^2 < 0, a margin that a pixel of aiming error turns into a coin."""
    pose = camera_from_marker_of(normal_of(tilt, 90.0), [0.0, 0.0, float(distance)])
    view = plane_view(pose, 0.5)
    assert float(criterion(view)) == pytest.approx(-((np.sin(np.radians(tilt)) * 0.5 / distance) ** 2), rel=1e-9)
    one, two = sufficient_conditions(PlaneView(view.cos_theta, view.sin_theta, view.x_c, 0.0 * view.y_c, view.radius))
    assert not one
    assert not two
    ellipse = ellipse_of_conic(conic_of_circle(pose, 0.5, K))
    offset = minor_axis_offset_px(ellipse, K[:2, 2])
    assert float(offset) == pytest.approx(OFFSET_PX[distance, tilt], abs=0.0051)  # published to two digits
    # Aiming errors of 1 px in x and y: how often is candidate 1, the separating line's, the true one?
    aimed = np.tile(ellipse, (4000, 1))
    aimed[:, :2] += np.random.default_rng(distance + tilt).normal(size=(4000, 2))
    poses = poses_from_ellipse(aimed, K, 0.5)
    right = np.argmin(angle_deg(poses.normal, pose[:3, 2]), axis=1) == 1
    # The errata's runs were of some hundred trials: two digits, three standard errors of 0.02.
    assert np.mean(right) == pytest.approx(AIMED[distance, tilt], abs=0.06)


def test_on_the_axis_nothing_separates():
    pose = camera_from_marker_of([0.0, 0.0, -1.0], [0.0, 0.0, 3.0])
    assert not separating_lines(conic_pencil(conic_of_circle(pose, 0.5, K), K)).any()
    with pytest.raises(ValueError, match="axis of the circle"):
        plane_pencil(pose, 0.5)
    assert float(depth_product(pose, 0.5)) == 0.0
    assert float(criterion(plane_view(pose, 0.5))) == 0.0


def test_no_q_no_frame():
    pose = camera_from_marker_of(normal_of(95.0, 0.0), [-5.0, 0.0, 3.0])
    with pytest.raises(ValueError, match="optical axis"):
        plane_view(pose, 0.1)
    assert float(depth_product(pose, 0.1)) < 0
