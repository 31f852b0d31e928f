"""Bent paper: distances on it stay what they are, and its tangent planes are right."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from roundel.scenes.markers.surfaces import Curve, lifted, normals, strips, tangent_frame

curves = st.one_of(
    st.builds(Curve, st.just("cylinder"), st.floats(0.02, 10), st.floats(-360, 360)),
    # A wave's steepest slope is wave / (2 pi radius): at most 1.2 rad.
    st.builds(
        lambda wave, slope, axis: Curve("bent", wave / (2 * np.pi * slope), axis, wave),
        st.floats(0.05, 1), st.floats(0.01, 1.2), st.floats(-360, 360),
    ),
)  # fmt: skip
places = st.tuples(st.floats(-0.06, 0.06), st.floats(-0.06, 0.06))


@given(curve=curves, at=places)
def test_paper_is_bent_without_stretching(curve: Curve, at) -> None:
    x, y = at
    h = 1e-6
    # Central differences of float64 at 1e-6: 1e-9 of rounding, 1e-9 of the third derivative at a radius of 2 cm.
    dx = (lifted(curve, x + h, y) - lifted(curve, x - h, y)) / (2 * h)
    dy = (lifted(curve, x, y + h) - lifted(curve, x, y - h)) / (2 * h)
    first_form = [dx @ dx, dx @ dy, dy @ dy]
    np.testing.assert_allclose(first_form, [1.0, 0.0, 1.0], atol=1e-8)
    np.testing.assert_allclose(np.cross(dx, dy), normals(curve, x, y), atol=1e-8)
    pose = tangent_frame(curve, x, y)
    np.testing.assert_allclose(pose[:3, :2], np.stack([dx, dy], axis=-1), atol=1e-8)
    np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


@given(curve=curves)
def test_the_sheet_is_the_tangent_plane_at_its_origin(curve: Curve) -> None:
    np.testing.assert_allclose(tangent_frame(curve, 0.0, 0.0), np.eye(4), atol=1e-12)
    # Curvature 1 / radius there: the paper falls away by u^2 / (2 radius) to leading order.
    (ux, uy), _ = curve.axes()
    u = 1e-3 * min(curve.radius_m, curve.wave_m)
    assert lifted(curve, u * ux, u * uy)[2] == pytest.approx(-(u**2) / (2 * curve.radius_m), rel=1e-4)


@given(radius=st.floats(0.03, 5), x=st.floats(-0.06, 0.06), y=st.floats(-0.06, 0.06))
def test_a_cylinder_has_its_radius(radius: float, x: float, y: float) -> None:
    # Axis along Y: every point is `radius` from the line x = 0, z = -radius.
    p = lifted(Curve("cylinder", radius, 90.0), x, y)
    assert np.hypot(p[0], p[2] + radius) == pytest.approx(radius, rel=1e-12)
    assert p[1] == pytest.approx(y, abs=1e-15)


def test_a_wave_is_the_integral_of_its_slope() -> None:
    curve = Curve("bent", 0.1, 0.0, 0.12)
    for u in (-0.24, -0.05, 0.03, 0.12, 0.24):
        p, z = curve.profile_m(u)
        assert p == pytest.approx(quad(lambda s: np.cos(curve.slope_rad(s)), 0, u, epsabs=1e-14)[0], abs=1e-12)
        assert z == pytest.approx(-quad(lambda s: np.sin(curve.slope_rad(s)), 0, u, epsabs=1e-14)[0], abs=1e-12)


def test_flat_paper_is_flat() -> None:
    np.testing.assert_array_equal(lifted(None, [0.1, 0.2], [0.3, 0.4]), [[0.1, 0.3, 0.0], [0.2, 0.4, 0.0]])
    np.testing.assert_array_equal(normals(None, 0.1, 0.2), [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(tangent_frame(None, 0.1, 0.2)[:3, 3], [0.1, 0.2, 0.0])


@given(axis=st.floats(-360, 360))
def test_strips_cover_the_paper_once_and_face_the_reader(axis: float) -> None:
    paper, faces = strips(Curve("cylinder", 0.05, axis), (-0.04, -0.03), (0.05, 0.03))
    a, b, c = (paper[faces[:, i]] for i in range(3))
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert area.min() >= -1e-15
    assert area.sum() == pytest.approx(0.09 * 0.06, rel=1e-9)
    assert (paper >= [-0.04 - 1e-12, -0.03 - 1e-12]).all()
    assert (paper <= [0.05 + 1e-12, 0.03 + 1e-12]).all()
