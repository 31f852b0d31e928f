"""Light that changes within a few px: planes of the levels, sectors beside an occluder, and what is left out."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_images import coverage

from roundel.solver.fit.edges import EdgePoints, edge_points
from roundel.solver.fit.ellipse import shape_of_ellipse
from roundel.solver.fit.local_light import near_gaps
from roundel.solver.fit.pixel_fit import PixelFit, fit_pixels

ELLIPSE = np.array([62.3, 57.8, 40.0, 33.0, 20.0])
HEIGHT, WIDTH = 116, 125
GUESS = np.array([0.4, -0.3, 0.3, 0.2, 1.0])


def marker(ink_dn=13.0, paper_dn=200.0, blur_px=0.4):
    return paper_dn + (ink_dn - paper_dn) * coverage(ELLIPSE, WIDTH, HEIGHT, blur_px)


def exposed(image, seed):
    """Rounded, with shot and read noise: a sigma of 1 dn at 13 and 3 dn at 200."""
    noise = np.random.default_rng(seed).normal(size=image.shape) * np.sqrt(0.5 + image / 22.0)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def beside_occluder(edge_x, height_px=5.0):
    """A marker partly under something dark, a half plane at this height, which hides a part of the sky beside it."""
    beyond = edge_x - np.arange(WIDTH)
    sky = np.where(beyond > 0, (1.0 + beyond / np.hypot(beyond, height_px)) / 2.0, 0.0)
    return np.where(beyond > 0, marker() * sky, 16.0)


def in_shadow(normal_x, share, offset_px):
    """A marker of which a half plane gets this share of the light; the shadow's edge is sharp."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    across = (x - ELLIPSE[0]) * normal_x + (y - ELLIPSE[1]) * np.sqrt(1 - normal_x**2) - offset_px
    return marker() * (1.0 + (share - 1.0) * np.clip(across + 0.5, 0.0, 1.0))


def fits(image, seeds):
    for seed in range(seeds):
        copy = exposed(image, seed)
        edges = edge_points(copy, ELLIPSE + GUESS, polish=False)
        assert isinstance(edges, EdgePoints)
        fit = fit_pixels(copy, edges)
        assert isinstance(fit, PixelFit), fit
        yield fit, edges


def chi_squares(image, seeds=24):
    error = [(shape_of_ellipse(f.ellipse) - shape_of_ellipse(ELLIPSE), f.shape_cov) for f, _ in fits(image, seeds)]
    return np.array([e @ np.linalg.solve(cov, e) for e, cov in error])


@pytest.mark.parametrize("edge_x", [95.0, 85.0])
def test_sectors_beside_an_occluder_have_their_own_light(edge_x):
    image = beside_occluder(edge_x)
    chi = chi_squares(image)
    # Five degrees of freedom: 95 % below 11.07. With the levels of the whole contour it is 25 on average.
    assert np.mean(chi < 11.07) > 0.8
    assert chi.max() < 30.0


def test_sectors_at_the_end_of_a_gap_are_regained():
    for fit, edges in fits(beside_occluder(85.0), 4):
        found = np.count_nonzero(edges.trusted) / len(edges.trusted)
        used = fit.n / (2 * np.pi * np.sqrt((ELLIPSE[2] ** 2 + ELLIPSE[3] ** 2) / 2))
        assert used > found + 0.02
        assert fit.rejected_fraction == 0.0


@pytest.mark.parametrize(("normal_x", "share", "offset_px"), [(1.0, 0.4, 0.0), (0.6, 0.25, -10.0), (0.0, 0.6, 8.0)])
def test_the_edge_of_a_shadow_displaces_nothing(normal_x, share, offset_px):
    chi = chi_squares(in_shadow(normal_x, share, offset_px))
    # One shadow, 24 times: where its edge crosses the contour a bias of 0.005 px is left, 0.8 sigma.
    assert np.mean(chi < 11.07) > 0.6
    assert chi.max() < 50.0


def test_even_light_has_no_planes():
    chi = chi_squares(marker())
    assert np.mean(chi) == pytest.approx(5.0, abs=4 * np.sqrt(10 / 24))
    for fit, edges in fits(marker(), 12):
        assert fit.rejected_fraction == 0.0
        assert edges.coverage == 1.0
        assert fit.n == pytest.approx(2 * np.pi * np.sqrt((40.0**2 + 33.0**2) / 2), rel=0.01)


def test_gaps_grow_around_the_end_of_the_contour():
    trusted = np.ones(50, bool)
    assert near_gaps(trusted) is trusted
    trusted[:30] = False
    wide = near_gaps(trusted)
    assert np.flatnonzero(~wide).tolist() == list(range(6, 24))
