"""The kernels of a contour against plain NumPy: pixels of its band, quantiles, directions, ellipse of its points."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.geometry.conic import ellipse_points
from roundel.solver.fit.ellipse import fit_ellipse, shape_of_ellipse
from roundel.solver.fit.ellipse_distance import foot_points
from roundel.solver.kernels.contour_band import LEVEL, OFFSET, contour_band, edge_pixels
from roundel.solver.kernels.contour_pixels import DISTANCE, VALUE, X, Y, contour_pixels, contour_profile, turn_of
from roundel.solver.kernels.ellipse_distances import settled_shape
from roundel.solver.kernels.order_statistics import median, quantile, select

ELLIPSES = [np.array([31.3, 24.8, 18.0, 17.0, 20.0]), np.array([29.6, 26.1, 20.0, 6.0, 75.0])]
CUT = np.array([4.0, 30.0, 15.0, 12.0, 10.0])  # by the left border
IMAGE = np.random.default_rng(3).uniform(0, 255, (52, 64)).astype(np.float32)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60), st.floats(0, 1))
def test_quantiles(values, share):
    array = np.array(values)
    assert quantile(array.copy(), share) == pytest.approx(float(np.quantile(array, share)), rel=1e-12, abs=1e-9)
    assert median(array.copy()) == pytest.approx(float(np.median(array)), rel=1e-12, abs=1e-9)
    k = int(share * (len(array) - 1))
    assert select(array.copy(), k) == np.sort(array)[k]


def test_directions():
    angles = np.linspace(0, 2 * np.pi, 1001)[:-1]
    found = np.array([turn_of(math.cos(t), math.sin(t)) for t in angles])
    apart = np.abs(found - angles / (2 * np.pi))
    assert np.minimum(apart, 1 - apart).max() < 2e-6  # the source says 1e-5 rad


@pytest.mark.parametrize("ellipse", [*ELLIPSES, CUT])
def test_pixels_of_a_band(ellipse):
    y, x = np.mgrid[: IMAGE.shape[0], : IMAGE.shape[1]]
    distance = foot_points(ellipse, np.stack([x.ravel(), y.ravel()], axis=1).astype(float))[0].reshape(IMAGE.shape)
    table, starts = contour_pixels(IMAGE, ellipse, -3.0, 4.0, 20)
    wanted = (distance >= -3.0) & (distance <= 4.0)
    assert len(table) == starts[-1] == np.count_nonzero(wanted)
    at = table[:, Y].astype(int), table[:, X].astype(int)
    assert np.allclose(table[:, DISTANCE], distance[at], atol=1e-9)
    assert np.array_equal(table[:, VALUE], IMAGE[at])
    # The edge's pixels of a wider band are the same, sector by sector.
    trusted = np.ones(20, bool)
    band, found = contour_band(IMAGE, ellipse, -5.0, 9.0, 4.0, trusted)
    ends = np.repeat([[-5.0], [9.0]], 12, axis=1)
    again, begins, _ = edge_pixels(band, found, -3.0, 4.0, ends, 20)
    assert np.array_equal(begins, starts)
    assert np.allclose(again, table, rtol=1e-12, atol=1e-12)
    assert np.all(np.isin(band[:, LEVEL], IMAGE))
    far = band[np.abs(band[:, OFFSET]) > 5.0]
    assert len(far)


def test_the_profile_is_exact_for_a_circle():
    circle = np.array([31.3, 24.8, 14.0, 14.0, 0.0])
    y, x = np.mgrid[: IMAGE.shape[0], : IMAGE.shape[1]]
    distance = np.hypot(x - circle[0], y - circle[1]) - circle[2]
    number, total = contour_profile(IMAGE, circle, -6.0, 6.0, 0.5)
    inside = (distance >= -6.0) & (distance <= 6.0)
    k = ((distance[inside] + 6.0) / 0.5).astype(int)
    assert np.array_equal(number, np.bincount(k, minlength=len(number)))
    assert np.allclose(total, np.bincount(k, IMAGE[inside], minlength=len(total)))


@given(st.integers(0, 50), st.floats(0.2, 1.0))
def test_the_ellipse_of_points_is_that_of_the_full_fit(seed, aspect):
    rng = np.random.default_rng(seed)
    ellipse = np.array([120.0, 80.0, 30.0, 30.0 * aspect, 40.0])
    points = ellipse_points(ellipse, 60) + rng.normal(scale=0.05, size=(60, 2))
    theta, rows, inverse = shape_of_ellipse(ellipse), np.empty((6, 60)), np.empty((5, 5))
    assert settled_shape(theta, points, np.ones(60), rows, inverse)
    full = fit_ellipse(points)
    assert np.allclose(theta, shape_of_ellipse(full.ellipse), atol=1e-6)  # both end at steps below 1e-6 px
    assert np.allclose(np.abs(rows[5]), np.abs(full.residual_px), atol=1e-6)
