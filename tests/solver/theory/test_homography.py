"""Equation (1), corrected: the homography of a circle's plane from its image and its vanishing line."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from roundel.scenes.geometry.conic import (
    conic_of_circle,
    conic_of_ellipse,
    ellipse_of_conic,
    ellipse_points,
    vanishing_line,
)
from roundel.scenes.geometry.pose import angle_deg, camera_from_marker_of, normal_of
from roundel.solver.theory.conic_pencil import conic_pencil
from roundel.solver.theory.homography import canonical_homography, homography_from_conic, homography_from_ellipse

K = np.array([[1280.0, 0.0, 639.5], [0.0, 1280.0, 359.5], [0.0, 0.0, 1.0]])
UNIT = np.diag([1.0, 1.0, -1.0])


@st.composite
def canonical_conics(draw):
    """C'11, C'22, C'33 of any scale and sign, and a point inside."""
    a, b = draw(st.floats(0.1, 10)), draw(st.floats(0.1, 10))
    scale = draw(st.floats(1e-3, 1e3)) * draw(st.sampled_from([-1.0, 1.0]))
    reach, turn = draw(st.floats(0, 0.95)), draw(st.floats(0, 2 * np.pi))
    centre = reach * np.array([a * np.cos(turn), b * np.sin(turn)])
    return scale * np.array([a**-2, b**-2, -1.0]), centre


@given(canonical_conics())
def test_equation_1_in_its_own_frame(canonical):
    diagonal, centre = canonical
    m = canonical_homography(diagonal, centre)
    found = m.T @ np.diag(diagonal) @ m
    # The terms of the product are sums of three; the errata found 8e-16 of the result over its own cases. What
    # the terms are larger than the result costs digits: the sum of their magnitudes is the measure.
    terms = np.abs(m.T) @ np.diag(np.abs(diagonal)) @ np.abs(m)
    scale = -found[2, 2]
    assert np.abs(found - scale * UNIT).max() < 8e-16 * np.max(terms)
    assert np.allclose(m[:2, 2] / m[2, 2], centre, rtol=1e-15, atol=1e-300)
    assert m[2, 2] > 0 > np.linalg.det(m)


def test_residual_of_2000_cases():
    generator = np.random.default_rng(1)
    a, b = generator.uniform(0.5, 2.0, (2, 2000))
    turn, reach = generator.uniform(0, 2 * np.pi, 2000), 0.5 * np.sqrt(generator.uniform(0, 1, 2000))
    centre = reach[:, None] * np.stack([a * np.cos(turn), b * np.sin(turn)], axis=-1)
    diagonal = np.stack([a**-2, b**-2, -np.ones(2000)], axis=-1) * generator.choice([-3.0, 1.0, 0.2], (2000, 1))
    m = canonical_homography(diagonal, centre)
    found = np.swapaxes(m, -1, -2) @ (diagonal[:, :, None] * m)
    residual = found / -found[:, 2:, 2:] - UNIT
    # Ten roundings of 1.1e-16: the terms here are not larger than the result by more than 2.
    assert np.abs(residual).max() < 3e-15
    assert np.median(np.abs(residual).max(axis=(1, 2))) < 8e-16


def test_the_print_of_equation_1_is_wrong_for_any_scaling():
    c11, c22, u, v = 0.7, 1.9, 0.3, 0.2
    for c33 in (-1.0, 1.0, 0.5, -3.0):
        printed = np.array([[-1, c22 * u * v, -u], [0, 1 - c11 * u * u, -v], [-c11 * u, c22 * v, 1.0]])
        product = printed.T @ np.diag([c11, c22, c33]) @ printed
        assert np.abs(product - np.diag(np.diag(product))).max() > 0.1


@st.composite
def scenes(draw):
    f = draw(st.floats(300, 3000))
    k = np.array([[f, draw(st.floats(-50, 50)), draw(st.floats(0, 2000))], [0, f * draw(st.floats(0.6, 1.6)), 400.0]])
    k = np.vstack([k, [0, 0, 1.0]])
    normal = normal_of(draw(st.floats(0, 75)), draw(st.floats(-180, 180)))
    off, turn = np.radians(draw(st.floats(0, 35))), np.radians(draw(st.floats(-180, 180)))
    sight = np.array([np.sin(off) * np.cos(turn), np.sin(off) * np.sin(turn), np.cos(off)])
    radius = draw(st.floats(0.01, 1.0))
    centre = 2 * radius * draw(st.floats(2, 40)) * sight
    assume(-normal @ sight > 0.1)
    return normal, centre, radius, k


@given(scenes())
def test_it_is_k_r1_r2_t_but_for_a_turn_in_the_plane(scene):
    normal, centre, radius, k = scene
    pose = camera_from_marker_of(normal, centre)
    conic = conic_of_circle(pose, radius, k)
    h = homography_from_conic(conic, vanishing_line(pose, k), radius)
    expected = k @ pose[:3, [0, 1, 3]]
    turn = np.linalg.solve(h, expected)
    turn /= turn[2, 2]
    # What a conic in float64 pixels has lost of a small ellipse far from the origin: see `poses_from_conic`.
    e = ellipse_of_conic(conic)
    lost = 1e-11 + 1e-14 * (np.sum(e[:2] ** 2) + e[2] ** 2) / e[3] ** 2
    assert np.abs(turn[:2, :2] @ turn[:2, :2].T - np.eye(2)).max() < lost
    assert np.linalg.det(turn[:2, :2]) == pytest.approx(1.0, abs=lost)
    assert np.abs(turn[:2, 2]).max() < lost * radius
    assert np.abs(turn[2, :2]).max() * radius < lost
    # Z out of the print, toward the camera: H scaled to a positive third element has a negative determinant.
    assert h[2, 2] == 1.0
    assert np.linalg.det(h) < 0
    assert np.linalg.det(expected / expected[2, 2]) < 0


@given(scenes(), st.sampled_from([1.0, -1.0, 1e3]), st.sampled_from([1.0, -1.0, 1e-3]))
def test_circle_centre_and_horizon(scene, scale, line_scale):
    normal, centre, radius, k = scene
    pose = camera_from_marker_of(normal, centre)
    ellipse = ellipse_of_conic(conic_of_circle(pose, radius, k))
    line = vanishing_line(pose, k)
    h = homography_from_ellipse(ellipse, line_scale * line, radius)
    assert np.allclose(h, homography_from_conic(scale * conic_of_ellipse(ellipse), line, radius), rtol=1e-5, atol=1e-5)
    t = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    rim = h @ np.stack([radius * np.cos(t), radius * np.sin(t), np.ones(12)])
    assert np.all(rim[2] > 0)
    inside = (rim[:2] / rim[2]).T - ellipse[:2]
    angle = np.radians(ellipse[4])
    local = inside @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) / ellipse[2:4]
    # Digits that the pixel's coordinates have, seen from the minor axis.
    digits = 1e-13 * (1.0 + np.abs(ellipse[:2]).max() / ellipse[3])
    assert np.abs(np.sum(local**2, axis=1) - 1.0).max() < digits
    pole = np.linalg.solve(conic_of_ellipse(ellipse), line)
    pole = pole[:2] / pole[2]
    # The conic in pixels, again.
    assert np.abs(h[:2, 2] - pole).max() < 1e-6 * ellipse[2] + 1e-6
    # The line at infinity goes to the vanishing line, and no point of it to the rim.
    horizon = np.cross(h[:, 0], h[:, 1])
    horizon, line = k.T @ horizon, k.T @ line
    assert np.linalg.norm(np.cross(horizon, line)) < 1e-7 * np.linalg.norm(horizon) * np.linalg.norm(line)


def test_both_candidates_of_the_pencil_make_a_homography():
    generator = np.random.default_rng(2)
    for _ in range(50):
        ellipse = generator.uniform([100, 100, 20, 10, 0], [1100, 600, 60, 20, 180])
        conic = conic_of_ellipse(ellipse)
        pencil = conic_pencil(conic, K)
        h = homography_from_conic(conic, pencil.line, 0.05)
        assert h.shape == (2, 3, 3)
        # r1, r2 and r3 = r1 x r2 come back as columns of K^-1 H: the third is the candidate's normal.
        columns = np.linalg.inv(K) @ h
        normal = np.cross(columns[..., 0], columns[..., 1])
        assert angle_deg(normal, pencil.normal).max() < 1e-6
        assert np.allclose(
            np.linalg.norm(columns[..., 0], axis=-1), np.linalg.norm(columns[..., 1], axis=-1), rtol=1e-9
        )


def test_a_circle_seen_squarely_is_scaled_alone():
    h = homography_from_ellipse([10.0, 20.0, 5.0, 5.0, 0.0], [0.0, 0.0, 1.0], 2.5)
    assert np.allclose(h[:2, :2] @ h[:2, :2].T, 4.0 * np.eye(2), rtol=1e-15)
    assert np.allclose(h[:, 2], [10, 20, 1])
    assert np.allclose(h[2], [0, 0, 1])


@pytest.mark.parametrize(
    ("ellipse", "line", "radius", "says"),
    [
        ([0, 0, 2, 1, 0], [1.0, 0.0, -1.0], 1.0, "vanishing line meets"),
        ([0, 0, 2, 1, 0], [1.0, 0.0, 0.0], 1.0, "vanishing line meets"),
        ([0, 0, 2, 1, 0], [0.0, 0.0, 0.0], 1.0, "vanishing line meets"),
        ([0, 0, 2, 1, 0], [np.nan, 0.0, 1.0], 1.0, "three finite"),
        ([0, 0, 2, 1, 0], [0.0, 1.0], 1.0, "three finite"),
        ([0, 0, 2, -1, 0], [0.0, 0.0, 1.0], 1.0, "semi-axes"),
        ([0, 0, 2, 1], [0.0, 0.0, 1.0], 1.0, "five"),
        ([0, 0, 2, 1, 0], [0.0, 0.0, 1.0], -1.0, "radius"),
    ],
)
def test_bad_input_says_what_is_wrong(ellipse, line, radius, says):
    with pytest.raises(ValueError, match=says):
        homography_from_ellipse(ellipse, line, radius)


def test_a_conic_that_is_none():
    with pytest.raises(ValueError, match="not an ellipse"):
        homography_from_conic(np.diag([1.0, -1.0, -1.0]), [0, 0, 1.0])
    with pytest.raises(ValueError, match="finite"):
        homography_from_conic(np.full((3, 3), np.nan), [0, 0, 1.0])
    with pytest.raises(ValueError, match="real ellipse"):
        canonical_homography([1.0, 1.0, 1.0], [0.0, 0.0])


def test_points_of_the_ellipse_come_back_to_the_circle():
    ellipse = np.array([640.0, 200.0, 50.0, 20.0, 30.0])
    line = conic_pencil(conic_of_ellipse(ellipse), K).line[0]
    points = np.column_stack([ellipse_points(ellipse, 40), np.ones(40)])
    plane = np.linalg.solve(homography_from_ellipse(ellipse, line, 0.04), points.T)
    assert np.allclose(np.hypot(plane[0] / plane[2], plane[1] / plane[2]), 0.04, rtol=1e-11)
