"""Edge points of synthetic images: the pixel's area is exact there, so the errors are the solver's own."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_images import coverage, picture

from roundel.scenes.geometry.conic import ellipse_points
from roundel.solver.fit.edges import EdgePoints, edge_points
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.fit.ellipse_distance import foot_points


def found(ellipse, guess=(0.6, -0.5, 0.7, 0.4, 2.0), **options):
    side = int(2 * ellipse[2] + 50)
    image = picture([(ellipse, options.pop("ink_dn", 30.0))], side, side, **options)
    return edge_points(image, ellipse + np.array(guess))


def centred(a_px, b_px, angle_deg=20.0):
    middle = a_px + 25.0
    return np.array([middle + 0.31, middle - 0.17, a_px, b_px, angle_deg])


@pytest.mark.parametrize("blur_px", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("axes", [(14.4, 11.4), (32.1, 31.1), (43.0, 37.0), (25.0, 12.0), (90.0, 60.0)])
def test_clean_ellipses(axes, blur_px):
    ellipse = centred(*axes)
    edges = found(ellipse, blur_px=blur_px)
    assert isinstance(edges, EdgePoints)
    # 0.05 px is asked of axes. Rounding to 8 bits leaves 0.001 px, the second order of the curvature 0.003 px.
    assert np.abs(edges.ellipse[:4] - ellipse[:4]).max() < 0.005
    assert edges.blur_px == pytest.approx(max(blur_px, 0.05), abs=0.03)
    assert edges.coverage == 1.0
    assert edges.contrast_dn == pytest.approx(170.0, abs=1.0)
    # The points themselves, 2 px of contour each: 0.5 dn of rounding over 170 dn.
    assert np.abs(foot_points(ellipse, edges.points_px)[0]).max() < 0.03


@pytest.mark.parametrize("axes", [(4.0, 3.5), (6.0, 4.0), (8.0, 3.0)])
def test_small_ellipses(axes):
    ellipse = centred(*axes)
    for blur_px in (0.0, 0.6):
        edges = found(ellipse, blur_px=blur_px)
        assert isinstance(edges, EdgePoints)
        # The curvature of the tips is no longer small against the pixel: 0.01 px is left of it.
        assert np.abs(edges.ellipse[:4] - ellipse[:4]).max() < 0.015


def test_no_bias_under_noise():
    errors, deviations = [], []
    for seed in range(12):
        ellipse = centred(20.0 + 0.13 * seed, 15.0, 15.0 * seed)
        edges = found(ellipse, blur_px=0.7, noise_dn=4.0, seed=seed)
        assert isinstance(edges, EdgePoints)
        errors.append(edges.ellipse[:4] - ellipse[:4])
        deviations.append(foot_points(ellipse, edges.points_px)[0] / edges.sigma_px)
    # Sigma of an axis is 0.01 px here: four standard errors of twelve trials.
    assert np.abs(np.mean(errors, axis=0)).max() < 4 * 0.01 / np.sqrt(12)
    # The points' sigmas leave out the levels and the blur, which neighbours share: a fifth at most.
    assert np.sqrt(np.mean(np.concatenate(deviations) ** 2)) == pytest.approx(1.0, abs=0.2)


def test_polarity_and_depth_do_not_matter():
    ellipse = centred(30.0, 22.0)
    dark, light = found(ellipse), found(ellipse, paper_dn=30.0, ink_dn=200.0)
    assert dark.contrast_dn == pytest.approx(-light.contrast_dn, abs=1.0)
    # The rounding of grey levels is not symmetric.
    assert np.allclose(dark.ellipse, light.ellipse, atol=3e-3)
    image = picture([(ellipse, 30.0)], 110, 110)
    wide = edge_points(image.astype(np.uint16) * 257, ellipse, full_scale_dn=65535.0)
    narrow = edge_points(image, ellipse)
    assert isinstance(wide, EdgePoints)
    assert isinstance(narrow, EdgePoints)
    assert np.allclose(wide.ellipse, narrow.ellipse, atol=1e-6)  # the same numbers, scaled


def test_a_ring_keeps_its_edges_apart():
    outer, inner = centred(30.0, 24.0), centred(30.0, 24.0) * np.array([1, 1, 0.85, 0.85, 1])
    image = picture([(outer, 30.0), (inner, 200.0)], 110, 110, blur_px=0.6)
    for ellipse in (outer, inner):
        edges = edge_points(image, ellipse + np.array([0.4, 0.3, 0.5, -0.4, 1.0]))
        assert isinstance(edges, EdgePoints)
        assert np.abs(edges.ellipse[:4] - ellipse[:4]).max() < 0.01


def test_neighbours_and_shading_are_left_out():
    ellipse = centred(35.0, 28.0)
    image = picture([(ellipse, 30.0)], 120, 120, blur_px=0.6).astype(float)
    image[:, :30] = 90.0  # something over the left border of the contour
    image *= np.linspace(0.7, 1.2, 120)[None]
    edges = edge_points(np.rint(image), ellipse + 0.5)
    assert isinstance(edges, EdgePoints)
    assert 0.7 < edges.coverage < 0.95
    assert np.abs(edges.ellipse[:4] - ellipse[:4]).max() < 0.04  # the sectors that the border cuts


@pytest.mark.parametrize(("paper_dn", "worst_px"), [(255.0, 0.01), (300.0, 0.06)])
def test_saturated_paper(paper_dn, worst_px):
    # Clipped as if the paper were 255 dn, an edge toward 300 dn would move by 0.11 px.
    ellipse = centred(40.0, 27.0)
    edges = found(ellipse, paper_dn=paper_dn, ink_dn=20.0, blur_px=0.3, noise_dn=2.0)
    assert isinstance(edges, EdgePoints)
    assert np.abs(edges.ellipse[:4] - ellipse[:4]).max() < worst_px


def test_points_follow_the_contour():
    ellipse = centred(43.0, 37.0)
    edges = found(ellipse)
    assert isinstance(edges, EdgePoints)
    steps = np.linalg.norm(np.diff(edges.points_px, axis=0), axis=1)
    assert steps == pytest.approx(2.0, abs=0.1)
    assert np.all(np.isfinite(edges.sigma_px))


@pytest.mark.parametrize(
    ("image", "ellipse"),
    [
        (np.full((60, 60), 128, np.uint8), [30.0, 30.0, 15.0, 10.0, 0.0]),
        (np.full((60, 60), 128, np.uint8), [500.0, 500.0, 15.0, 10.0, 0.0]),
        (np.tile(np.arange(60, dtype=np.uint8) * 4, (60, 1)), [30.0, 30.0, 15.0, 10.0, 0.0]),
        (np.random.default_rng(0).integers(0, 255, (60, 60)).astype(np.uint8), [30.0, 30.0, 15.0, 10.0, 0.0]),
    ],
)
def test_where_there_is_no_edge(image, ellipse):
    answer = edge_points(image, np.array(ellipse))
    assert isinstance(answer, FailedFit)
    assert answer.reason


def test_helper_is_what_it_claims():
    ellipse = np.array([20.2, 19.7, 9.3, 6.1, 33.0])
    sharp, soft = coverage(ellipse, 41, 41), coverage(ellipse, 41, 41, blur_px=0.8)
    # 32 x 32 samples a pixel: the rounding of the area averages out around the contour.
    assert sharp.sum() == pytest.approx(np.pi * 9.3 * 6.1, rel=2e-4)
    assert soft.sum() == pytest.approx(sharp.sum(), rel=1e-3)
    y, x = np.mgrid[:41, :41]
    assert np.sum(sharp * x) / sharp.sum() == pytest.approx(20.2, abs=1e-3)
    assert np.sum(soft * y) / soft.sum() == pytest.approx(19.7, abs=2e-3)
    assert ellipse_points(ellipse, 8).shape == (8, 2)
