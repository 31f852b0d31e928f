"""The Fisher information of pixels: against sums over pixels, and against that of contours."""

from __future__ import annotations

import math

import numpy as np
import pytest

from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic, ellipse_perimeter_px
from roundel.scenes.geometry.edge_spread_function import (
    PIXEL_VARIANCE,
    curved_distance,
    ellipse_curvature,
    step_response,
)
from roundel.scenes.geometry.information import (
    contour_information,
    pose_bound,
    pose_information_of_shape,
)
from roundel.scenes.geometry.pixel_information import (
    EdgeConditions,
    censored_information,
    shape_information_of_pixels,
)
from roundel.solver.fit.ellipse_distance import foot_points
from roundel.solver.kernels.contour_pixels import sector_centres

ELLIPSE = np.array([60.3, 59.8, 24.0, 17.0, 35.0])


def summed(blur_px, conditions=EdgeConditions(), noise=(1.5, 2.5), levels=(30.0, 200.0)):  # noqa: B008
    """The same information as a sum over the pixels of an image, every row of its design written out."""
    height = levels[1] - levels[0]
    widest = math.sqrt(blur_px**2 + (conditions.ink_sigma * ELLIPSE[2]) ** 2 + PIXEL_VARIANCE)
    reach = 8.0 + 5.0 * widest
    y, x = np.mgrid[:140, :140]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
    distance, normal, u = foot_points(ELLIPSE, pixels)
    near = np.abs(distance) < reach
    pixels, distance, normal, u = pixels[near], distance[near], normal[near], u[near]
    foot = pixels - distance[:, None] * normal
    support = np.sum((foot - ELLIPSE[:2]) * normal, axis=1)
    variance = blur_px**2 + (conditions.ink_sigma * support) ** 2
    angle = math.radians(ELLIPSE[4])
    cos_t, sin_t = u @ [math.cos(angle), math.sin(angle)], u @ [-math.sin(angle), math.cos(angle)]
    curvatures = ellipse_curvature(ELLIPSE[2], ELLIPSE[3], cos_t, sin_t)
    z, drift = curved_distance(distance, *curvatures, variance + PIXEL_VARIANCE)
    across = np.abs(normal)
    t, slope, bend = step_response(z, across.sum(axis=1) / 2, (across[:, 0] - across[:, 1]) / 2, variance)
    wider = height * (bend / 2 + slope * drift)
    rows = jacobian(normal, u) * (height * slope)[:, None]
    columns = [rows, -wider[:, None], 1 - t[:, None], t[:, None]]
    if conditions.smeared:
        smear = height * (bend - slope * curvatures[0]) / 2
        columns.append(smear[:, None] * np.stack([normal[:, 0] ** 2 - normal[:, 1] ** 2, 2 * normal.prod(axis=1)], -1))
    if conditions.ink_sigma > 0:
        columns.append(-(wider * support**2)[:, None])
    known = sum(c.shape[1] for c in columns)
    if conditions.drift is not None:
        columns.append(rows @ conditions.drift * ((pixels - conditions.reference_px) @ conditions.readout)[:, None])
    design = np.concatenate(columns, axis=1)
    spread = noise[0] ** 2 * (1 - t) + noise[1] ** 2 * t
    weight = censored_information(levels[0] + height * t, np.sqrt(spread), conditions.saturation_dn) / spread
    if conditions.visible is not None:
        apart = np.linalg.norm(foot[:, None] - conditions.visible[0], axis=2)
        weight = weight * conditions.visible[1][np.argmin(apart, axis=1)]
    prior = np.zeros(design.shape[1])
    prior[known:] = 1.0
    full = design.T @ (design * weight[:, None]) + np.diag(prior)
    return full[:5, :5] - full[:5, 5:] @ np.linalg.solve(full[5:, 5:], full[5:, :5])


def jacobian(normal, u):
    """Distance of each pixel from the contour by the shape: minus the outward motion of the contour."""
    mixed = normal[:, 0] * u[:, 1] + normal[:, 1] * u[:, 0]
    return -np.column_stack([normal, normal[:, 0] * u[:, 0], mixed, normal[:, 1] * u[:, 1]])


def matrix_of(ellipse):
    """The symmetric S of the contour (x, y) + S u, |u| = 1."""
    c, s = math.cos(math.radians(ellipse[4])), math.sin(math.radians(ellipse[4]))
    turn = np.array([[c, -s], [s, c]])
    return turn @ np.diag(ellipse[2:4]) @ turn.T


def sigmas(information):
    return np.sqrt(np.diag(np.linalg.inv(information)))


def outline(count=256):
    t = np.arange(count) * (2 * np.pi / count)
    return ELLIPSE[:2] + np.stack([np.cos(t), np.sin(t)], axis=1) @ matrix_of(ELLIPSE)


SEEN = outline()[:, 0] < ELLIPSE[0] + 6.0
# Shape rates of a shutter that reads 2,000 rows a second: some tenths of a pixel across the ellipse.
RATES = np.array([[0.01, 0.0], [0.0, 0.02], [0.003, -0.004], [0.0, 0.002], [0.005, 0.001]])
CONDITIONS = {
    "nothing": EdgeConditions(),
    "nearly clipped": EdgeConditions(saturation_dn=198.0),
    "clipped": EdgeConditions(saturation_dn=150.0),
    "soft ink": EdgeConditions(ink_sigma=0.05),
    "partly hidden": EdgeConditions(visible=(outline(), SEEN)),
    "smeared": EdgeConditions(smeared=True),
    "rolling shutter": EdgeConditions(
        smeared=True, drift=RATES, readout=np.array([0.0, 1.0]), reference_px=ELLIPSE[:2]
    ),
}


@pytest.mark.parametrize("blur_px", [0.5, 2.0])
@pytest.mark.parametrize("name", CONDITIONS)
def test_it_is_the_sum_over_pixels(name, blur_px):
    integral = shape_information_of_pixels(ELLIPSE, 30.0, 200.0, blur_px, (1.5, 2.5), conditions=CONDITIONS[name])
    # The integral averages over the phases of the pixels; the centre's pixels, which know levels only, differ a little.
    # Of clipped pixels only those in a tenth of the edge's width count, so their phases matter more.
    ratio = sigmas(summed(blur_px, CONDITIONS[name])) / sigmas(integral)
    assert np.allclose(ratio, 1.0, atol=0.08 if name == "clipped" else 0.02), ratio


def test_a_censored_gaussian_by_its_definition():
    # E[score^2] over the values below the limit, plus the mass at it.
    for z in (-3.0, -1.0, 0.0, 0.7, 4.0):
        y = np.linspace(-12.0, z, 200_001)
        density = np.exp(-0.5 * y * y) / math.sqrt(2 * math.pi)
        above = 0.5 * math.erfc(z / math.sqrt(2))
        at = math.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)
        expected = np.trapezoid(density * y * y, y) + at * at / above
        # The trapezium's error is that of its step of 1e-4, squared.
        assert censored_information(10.0 - 2.0 * z, 2.0, 10.0) == pytest.approx(expected, abs=1e-7)
    assert censored_information(10.0, 2.0, math.inf) == 1.0
    assert np.allclose(censored_information([-1e6, 1e6], 1.0, 0.0), [1.0, 0.0], rtol=0, atol=1e-100)


def test_what_clips_costs_the_size_first():
    plain = sigmas(shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, 2.0))
    far = shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, 2.0, conditions=EdgeConditions(saturation_dn=230.0))
    assert np.array_equal(sigmas(far), plain)
    cost = sigmas(
        shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, 2.0, conditions=EdgeConditions(saturation_dn=150.0))
    )
    cost = cost / plain
    # The unknown level of clipped paper moves the whole edge outward, and not sideways.
    assert np.all(cost[:2] < 1.2)
    assert np.all(cost[[2, 4]] > 4)


def test_ink_on_a_circle_has_the_effect_of_the_blur():
    circle = [60.0, 60.0, 20.0, 20.0, 0.0]
    soft = shape_information_of_pixels(circle, 30.0, 200.0, 0.5, 2.0, conditions=EdgeConditions(ink_sigma=0.03))
    blurred = shape_information_of_pixels(circle, 30.0, 200.0, math.hypot(0.5, 0.6), 2.0)
    # The reach grows with the blur of either; 1e-10 is what the pseudo-inverse cuts off.
    assert np.allclose(soft, blurred, rtol=1e-8, atol=1e-8 * blurred.max())


def test_an_arc_that_is_hidden_costs_more_than_its_share():
    whole = shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, 2.0)
    given = EdgeConditions(visible=(outline(), SEEN))
    part = shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, 2.0, conditions=given)
    assert np.all(sigmas(part) > 1.1 * sigmas(whole) / math.sqrt(SEEN.mean()))
    everything = EdgeConditions(visible=(outline(), np.ones(256, dtype=bool)))
    # The 96 angles of a contour with gaps instead of 32.
    assert np.allclose(
        shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, 2.0, conditions=everything), whole, rtol=1e-3, atol=1e-3
    )


def test_a_shutter_costs_more_the_less_is_known_of_the_motion():
    def at(scale):
        given = EdgeConditions(drift=RATES * scale, readout=np.array([0.0, 1.0]), reference_px=ELLIPSE[:2])
        return shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, 2.0, conditions=given)

    still = shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, 2.0)
    # A hundred-millionth of the prior costs its square.
    assert np.allclose(at(1e-8), still, rtol=1e-9, atol=1e-9 * still.max())
    traces = [np.trace(np.linalg.inv(at(scale))) for scale in (1e-8, 0.1, 1.0, 10.0, 1e4, 1e5)]
    assert np.all(np.diff(traces) > 0)
    # Without a prior the pixels themselves say how it moves, up to what looks like another pose.
    assert traces[5] < 1.001 * traces[4]


def test_a_smear_hides_what_rows_do_to_the_edge():
    # At a speed along x, rows that are read one after another shear the contour to another ellipse; the width of its
    # edge alone tells the speed, unless a smear may have widened it.
    shear = np.array([[0.1], [0.0], [0.0], [0.0], [0.0]])

    def at(smeared, drift):
        rows = {"drift": drift, "readout": np.array([0.0, 1.0]), "reference_px": ELLIPSE[:2]}
        given = EdgeConditions(smeared=smeared, **rows)
        return sigmas(shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, 2.0, conditions=given))

    assert np.all(at(True, 0.0 * shear) < 1.1 * at(False, 0.0 * shear))
    assert at(True, shear)[3] > 2.0 * at(False, shear)[3]


def test_the_variance_of_each_level():
    shot = EdgeConditions(variance_dn2=lambda level: 1.5**2 + (2.5**2 - 1.5**2) * (level - 30.0) / 170.0)
    assert np.allclose(
        shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, (1.5, 2.5), conditions=shot),
        shape_information_of_pixels(ELLIPSE, 30.0, 200.0, 0.5, (1.5, 2.5)),
        rtol=1e-12,
    )


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
