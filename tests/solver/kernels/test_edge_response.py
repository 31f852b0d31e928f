"""The compiled response of a pixel against the closed form of `scenes`, and its pieces against SciPy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from roundel.scenes.camera.srgb import linear_to_srgb
from roundel.scenes.geometry import edge_spread_function as reference
from roundel.solver.fit.ellipse_distance import foot_points
from roundel.solver.kernels.contour_pixels import curvatures, foot_point
from roundel.solver.kernels.curve_likelihood import SRGB_KIND, encode
from roundel.solver.kernels.edge_response import curved_distance, normal_cdf_and_density, step_response
from roundel.solver.kernels.small_matrices import add_products, inverse_of


def test_normal_distribution():
    x = np.linspace(-10, 10, 4001)
    cdf, density = np.array([normal_cdf_and_density(v) for v in x]).T
    assert np.abs(cdf - norm.cdf(x)).max() < 1e-9
    assert np.abs(density - norm.pdf(x)).max() < 1e-9


# The closed form to 1e-7; above a variance of 0.4 the series, whose next term is 2e-5 of the step there and falls
# with the fourth power of the variance.
@pytest.mark.parametrize(("variance", "tolerance"), [(0.01, 1e-7), (0.2, 1e-7), (0.39, 1e-7), (0.41, 3e-5), (1, 3e-6)])
@pytest.mark.parametrize("angle_deg", [0.0, 0.5, 20.0, 45.0, 89.9])
def test_step_response(variance, tolerance, angle_deg):
    nx, ny = abs(math.cos(math.radians(angle_deg))), abs(math.sin(math.radians(angle_deg)))
    z = np.linspace(-5, 5, 301)
    corners = (nx + ny) / 2, (nx - ny) / 2
    expected = reference.step_response(z, *(np.full_like(z, c) for c in corners), variance)
    found = np.array([step_response(at, *corners, variance) for at in z]).T
    assert np.abs(found[0] - expected[0]).max() < tolerance
    # Each derivative of a series loses a factor of the inverse sigma and of the polynomial's order.
    assert np.abs(found[1] - expected[1]).max() < 5 * tolerance
    assert np.abs(found[2] - expected[2]).max() < 20 * tolerance


@given(st.floats(-20, 20), st.floats(1e-3, 0.2), st.floats(-1e-3, 1e-3), st.floats(0.05, 4))
def test_curved_distance(distance, curvature, curvature_ss, variance):
    arrays = (np.array([v]) for v in (distance, curvature, curvature_ss))
    expected = reference.curved_distance(*arrays, variance)
    assert np.allclose(curved_distance(distance, curvature, curvature_ss, variance), np.ravel(expected), atol=1e-12)


@given(st.floats(2, 400), st.floats(0.05, 1), st.floats(-3, 3), st.floats(-3, 3))
def test_foot_point(a, aspect, x, y):
    b = a * aspect
    distance, normal, u = foot_points((0.0, 0.0, a, b, 0.0), np.array([[x * a, y * a]]))
    found = np.array(foot_point(a, b, x * a, y * a))
    assert abs(found[0] - distance[0]) < 1e-9 * a
    if abs(x) > 1e-6 and abs(y) > 1e-6 and abs(distance[0]) > -b:  # on an axis two feet may be equally near
        assert np.allclose(found[1:3], normal[0], atol=1e-6)
        assert np.allclose(found[3:], u[0], atol=1e-6)


def test_curvatures():
    t = np.linspace(0, 6, 50)
    expected = reference.ellipse_curvature(9.0, 5.0, np.cos(t), np.sin(t))
    found = np.array([curvatures(9.0, 5.0, math.cos(v), math.sin(v)) for v in t]).T
    assert np.allclose(found, expected, rtol=1e-12)


@given(st.integers(1, 12), st.integers(0, 100))
def test_inverse_and_products(size, seed):
    rng = np.random.default_rng(seed)
    design, weight = rng.normal(size=(size, 40)) * 10.0 ** rng.uniform(-3, 3, (size, 1)), rng.uniform(0, 2, 40)
    sums, inverse = np.zeros((size, size)), np.empty((size, size))
    add_products(design, weight, 25, sums)
    add_products(np.ascontiguousarray(design[:, 25:]), weight[25:], 15, sums)
    normal = np.tril(sums) + np.tril(sums, -1).T
    expected = (design * weight) @ design.T
    assert np.allclose(normal, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
    assert inverse_of(normal, inverse)
    scale = np.sqrt(np.diag(normal))
    assert np.allclose(inverse @ normal * scale[:, None] / scale, np.eye(size), atol=1e-7)


def test_a_singular_matrix_has_no_inverse():
    assert not inverse_of(np.ones((2, 2)), np.empty((2, 2)))
    assert not inverse_of(np.array([[1.0, 0.0], [0.0, np.nan]]), np.empty((2, 2)))


def test_srgb():
    light = np.linspace(0, 1, 101)
    assert np.allclose([encode(v, SRGB_KIND, 1.0)[0] for v in light], linear_to_srgb(light), atol=1e-12)
