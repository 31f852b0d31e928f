"""The bound: the errata's published figures, its rank, and its agreement with derivatives of the ellipse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_points
from roundel.scenes.geometry.information import contour_information, pose_bound
from roundel.scenes.geometry.pose import camera_from_marker_of, normal_of

K = np.array([[1280.0, 0.0, 639.5], [0.0, 1280.0, 359.5], [0.0, 0.0, 1.0]])
RADIUS = 0.5  # a metre is a diameter


def pose(tilt_deg, azimuth_deg, centre):
    return camera_from_marker_of(normal_of(tilt_deg, azimuth_deg), centre)


@pytest.mark.parametrize(
    ("tilt", "azimuth", "centre", "normal_deg", "with_focal_deg"),
    [
        # Errata, section 6: sigma 1 px, 200 points; its figures have three digits.
        (30.0, 0.0, (0.0, 0.0, 15.0), 0.709, 0.709),
        (30.0, 270.0, (6.0, 3.0, 20.0), 1.04, 2.32),
    ],
)
def test_published_bounds(tilt, azimuth, centre, normal_deg, with_focal_deg):
    m = pose(tilt, azimuth, centre)
    known = pose_bound(contour_information(m, RADIUS, K, 1.0, 200))
    assumed = pose_bound(contour_information(m, RADIUS, K, 1.0, 200, focal_sigma=0.115))
    assert known.normal_deg == pytest.approx(normal_deg, abs=0.005)
    assert assumed.normal_deg == pytest.approx(with_focal_deg, abs=0.005)


@pytest.mark.parametrize(("tilt", "excess"), [(15.0, 0.02), (30.0, 0.07), (45.0, 0.17)])
def test_approximations_on_the_axis(tilt, excess):
    # Errata, section 6: the formula of the normal is too large by these, to the percent.
    r, f, count = 20.0, 1280.0, 200
    bound = pose_bound(contour_information(pose(tilt, 40.0, (0, 0, r)), RADIUS, K, 1.0, count))
    approximate = math.degrees(4 * r / (f * RADIUS * math.sin(math.radians(tilt)) * math.sqrt(count)))
    assert approximate / bound.normal_deg - 1 == pytest.approx(excess, abs=0.006)
    if tilt == 15.0:  # depth and shift are approximated for small tilts
        assert math.sqrt(bound.cov[4, 4]) == pytest.approx(math.sqrt(3 / count) * r**2 / (f * RADIUS), rel=0.03)
        assert math.sqrt(bound.cov[2, 2]) == pytest.approx(math.sqrt(2 / count) * r / f, rel=0.03)


def test_a_focal_prior_on_the_axis_costs_position_only():
    m = pose(30.0, 70.0, (0, 0, 20.0))
    known, assumed = (pose_bound(contour_information(m, RADIUS, K, 1.0, 200, focal_sigma=s)) for s in (None, 0.115))
    assert assumed.normal_deg == pytest.approx(known.normal_deg, rel=1e-6)
    assert assumed.position_m == pytest.approx(math.hypot(0.115 * 20.0, known.position_m), rel=1e-3)
    # The contour says nothing of f: its posterior is its prior.
    assert math.sqrt(assumed.cov[5, 5]) == pytest.approx(0.115, rel=1e-6)


@given(
    st.floats(10.0, 60.0), st.floats(-180.0, 180.0), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(5.0, 50.0)
)
def test_without_a_prior_the_focal_length_is_unknowable(tilt, azimuth, x, y, distance):
    f = contour_information(
        pose(tilt, azimuth, np.array([x, y, 1.0]) * distance), RADIUS, K, 1.0, 100, focal_sigma=np.inf
    )
    scale = np.sqrt(np.diag(f))
    values = np.linalg.eigvalsh(f / scale[:, None] / scale)
    assert abs(values[0]) < 1e-12  # rank 5 of 6, to rounding
    assert pose_bound(f).normal_deg == math.inf


@given(
    st.floats(5.0, 60.0),
    st.floats(-180.0, 180.0),
    st.floats(-0.4, 0.4),
    st.floats(-0.4, 0.4),
    st.floats(3.0, 50.0),
    st.sampled_from(["contour", "circle"]),
)
def test_it_is_how_far_the_contour_moves(tilt, azimuth, x, y, distance, spacing):
    """By differences: points of the moved circle, by their distance along the normal of the contour."""
    m = pose(tilt, azimuth, np.array([x, y, 1.0]) * distance)
    k = np.array([[1200.0, 7.0, 600.0], [0.0, 1300.0, 400.0], [0.0, 0.0, 1.0]])
    count = 400
    t = np.arange(count) * (2 * np.pi / count)
    arm = RADIUS * (np.cos(t)[:, None] * m[:3, 0] + np.sin(t)[:, None] * m[:3, 1])

    def image(points, matrix=k):
        projected = points @ matrix.T
        return projected[:, :2] / projected[:, 2:]

    tiny = 1e-6
    # Moving each point of the circle moves the contour's point along its normal as much as any other of its points.
    along = np.roll(image(m[:3, 3] + arm), -1, 0) - np.roll(image(m[:3, 3] + arm), 1, 0)
    speed = np.linalg.norm(along, axis=1)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / speed[:, None]
    columns = []
    for axis in (m[:3, 0], m[:3, 1]):
        turn = np.cross(axis, arm) * tiny
        columns.append(image(m[:3, 3] + arm + turn) - image(m[:3, 3] + arm - turn))
    columns += [image(m[:3, 3] + arm + tiny * e) - image(m[:3, 3] + arm - tiny * e) for e in np.eye(3)]
    stretched = [k @ np.diag([1 + s * tiny, 1 + s * tiny, 1.0]) for s in (1, -1)]
    columns.append(image(m[:3, 3] + arm, stretched[0]) - image(m[:3, 3] + arm, stretched[1]))
    j = np.stack([np.sum(normal * c, axis=1) for c in columns], axis=1) / (2 * tiny)
    share = speed / speed.sum() if spacing == "contour" else np.full(count, 1 / count)
    expected = j.T @ (j * share[:, None]) * 150 / 0.3**2
    expected[5, 5] += 0.1**-2
    got = contour_information(m, RADIUS, k, 0.3, 150, spacing=spacing, focal_sigma=0.1)
    scale = np.sqrt(np.diag(expected))
    # The normal by a chord of 1/200 of the circle: 1e-4; the derivative by steps of 1e-6: less.
    assert np.allclose(got / scale[:, None] / scale, expected / scale[:, None] / scale, rtol=0, atol=1e-3)


def test_phase_of_the_points_does_not_matter():
    # Twelve points already have the information of their density, wherever the first of them lies.
    m = pose(40.0, 30.0, (1.0, 0.5, 10.0))
    ellipse = ellipse_of_conic(conic_of_circle(m, RADIUS, K))
    assert ellipse_points(ellipse, 12).shape == (12, 2)
    one = contour_information(m, RADIUS, K, 1.0, 12)
    assert np.allclose(contour_information(m, RADIUS, K, 0.5, 48) / 16, one, rtol=1e-12)


def test_a_circle_on_its_own_axis_has_no_bound():
    bound = pose_bound(contour_information(pose(0.0, 0.0, (0, 0, 10.0)), RADIUS, K, 1.0, 200))
    assert bound.normal_deg == bound.position_m == math.inf
    assert np.all(np.isinf(bound.cov))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"radius_m": -1.0}, "radius_m"),
        ({"sigma_px": 0.0}, "sigma_px"),
        ({"count": math.nan}, "count"),
        ({"focal_sigma": 0.0}, "focal_sigma"),
        ({"radius_m": 30.0}, "in front of the camera"),
        ({"camera_from_marker": pose(90.0, 0.0, (0, 0, 10.0))}, "edge-on"),
    ],
)
def test_bad_input(change, says):
    arguments = {
        "camera_from_marker": pose(40.0, 0.0, (0, 0, 10.0)),
        "radius_m": RADIUS,
        "K": K,
        "sigma_px": 1.0,
        "count": 100,
    }
    with pytest.raises(ValueError, match=says):
        contour_information(**(arguments | change))
