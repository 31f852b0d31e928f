"""The Fisher information of pixels: against sums over pixels, and against that of contours."""

from __future__ import annotations

import math

import numpy as np
import pytest

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_perimeter_px
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE, curved_distance, step_response
from roundel.scenes.geometry.information import (
    contour_information,
    pose_bound,
    pose_information_of_shape,
    shape_information_of_pixels,
)
from roundel.solver.kernels.contour_pixels import (
    CURVATURE,
    CURVATURE_SS,
    DISTANCE,
    HALF_DIFFERENCE,
    HALF_SUM,
    contour_pixels,
    sector_centres,
)
from roundel.solver.kernels.contour_scene import place_at

ELLIPSE = np.array([60.3, 59.8, 24.0, 17.0, 35.0])


@pytest.mark.parametrize("blur_px", [0.5, 2.0])
def test_it_is_the_sum_over_pixels(blur_px):
    reach = 8.0 + 5.0 * math.sqrt(blur_px**2 + PIXEL_VARIANCE)
    table, _ = contour_pixels(np.zeros((120, 120), np.float32), ELLIPSE, -reach, reach, 64)
    jacobian = np.empty((len(table), 5))
    place_at(table, ELLIPSE, jacobian)
    curved = (table[:, i] for i in (DISTANCE, CURVATURE, CURVATURE_SS))
    z, drift = curved_distance(*curved, blur_px**2 + PIXEL_VARIANCE)
    t, slope, bend = step_response(z, table[:, HALF_SUM], table[:, HALF_DIFFERENCE], blur_px**2)
    rows = jacobian * (170.0 * slope)[:, None]
    design = np.column_stack([rows, 170.0 * (bend / 2 + slope * drift), 1 - t, t])
    full = design.T @ (design / (1.5**2 * (1 - t) + 2.5**2 * t)[:, None])
    summed = full[:5, :5] - full[:5, 5:] @ np.linalg.solve(full[5:, 5:], full[5:, :5])
    integral = shape_information_of_pixels(ELLIPSE, 30.0, 200.0, blur_px, (1.5, 2.5))
    # The integral averages over the phases of the pixels; the centre's pixels, which know levels only, differ a little.
    ratio = np.sqrt(np.diag(np.linalg.inv(summed)) / np.diag(np.linalg.inv(integral)))
    assert np.allclose(ratio, 1.0, atol=0.02)


def test_scales():
    one = shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 1.0, 2.0)
    assert np.allclose(shape_information_of_pixels(ELLIPSE, 200.0, 30.0, 1.0, 2.0), one)
    assert np.allclose(shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 1.0, 4.0), one / 4)
    assert np.allclose(shape_information_of_pixels(ELLIPSE, 15.0, 100.0, 1.0, 2.0), one / 4)
    blurred = shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 2.0, 2.0)
    # Of a wide blur the information falls as 1 / b.
    assert np.trace(blurred) / np.trace(one) == pytest.approx(math.sqrt((1 + 1 / 12) / (4 + 1 / 12)), rel=0.1)
    wide = shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 1.0, 2.0, reach_px=16.0)
    assert np.allclose(np.diag(np.linalg.inv(wide)), np.diag(np.linalg.inv(one)), rtol=0.1)


def test_the_pose_follows_from_the_shape():
    pose = np.eye(4)
    tilt = math.radians(35.0)
    pose[:3, :3] = [[1, 0, 0], [0, -math.cos(tilt), math.sin(tilt)], [0, -math.sin(tilt), -math.cos(tilt)]]
    pose[:3, 3] = 0.1, -0.05, 1.2
    k = np.array([[900.0, 0, 320], [0, 910.0, 240], [0, 0, 1]])
    ellipse = ellipse_of_conic(conic_of_circle(pose, 0.04, k))
    # Points all around with a sigma of 0.3 px: the information of the shape is a sum over the contour.
    _, normals, u = sector_centres(ellipse, 2000)
    rows = np.stack(
        [*-normals.T, -normals[:, 0] * u[:, 0], -np.sum(normals * u[:, ::-1], axis=1), -normals[:, 1] * u[:, 1]], axis=1
    )
    shape = rows.T @ rows / 0.3**2 * (100 / 2000)
    contour = contour_information(pose, 0.04, k, 0.3, 100)
    assert np.allclose(pose_information_of_shape(shape, pose, 0.04, k), contour, rtol=1e-3, atol=1e-5 * contour.max())
    pixels = shape_information_of_pixels(ellipse, 30.0, 200.0, 0.5, 2.0)
    bound = pose_bound(pose_information_of_shape(pixels, pose, 0.04, k))
    # As edge points would, one a px, of the sigma that pixels give to a straight edge: noise / contrast times the root
    # of 2 sqrt(pi) b; levels and blur cost up to 1.5.
    sigma = 2.0 / 170.0 * math.sqrt(2 * math.sqrt(math.pi) * math.sqrt(0.25 + 1 / 12))
    points = pose_bound(contour_information(pose, 0.04, k, sigma, float(ellipse_perimeter_px(ellipse))))
    assert 1.0 <= bound.normal_deg / points.normal_deg < 1.2
    assert 1.0 <= bound.position_m / points.position_m < 1.6


@pytest.mark.parametrize(
    "wrong", [{"outside_dn": 30.0}, {"noise_dn": 0.0}, {"blur_px": -1.0}, {"noise_dn": (1.0, -1.0)}, {"reach_px": 0.0}]
)
def test_what_has_no_information(wrong):
    asked = {"inside_dn": 30.0, "outside_dn": 200.0, "blur_px": 1.0, "noise_dn": 2.0} | wrong
    with pytest.raises(ValueError, match=r"dn|blur_px"):
        shape_information_of_pixels(ELLIPSE, **asked)
