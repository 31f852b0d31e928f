"""Contours displaced along their normal, and how far an unknown curve displaces them."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_images import coverage

from roundel.scenes.camera.model import Camera
from roundel.scenes.camera.response_curve import SRGB
from roundel.solver.fit.ellipse import fit_ellipse
from roundel.solver.methods.roundel_fits import detect_circles, fit_detection
from roundel.solver.photometry.curve_displacement import displaced, edge_displacement_px
from roundel.solver.photometry.photometry import Photometry

ELLIPSE = np.array([150.3, 110.2, 30.0, 22.0, 20.0])


def test_a_displaced_ellipse_has_longer_axes_and_a_wider_covariance():
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = np.stack([40 + 20 * np.cos(angle), 50 + 20 * np.sin(angle)], axis=1)
    random = np.random.default_rng(0)
    fit = fit_ellipse(circle + random.normal(0, 0.01, circle.shape))
    moved = displaced(fit, 0.2, 0.1)
    # Of a circle every point moves by the same distance.
    assert np.allclose(moved.ellipse[2:4] - fit.ellipse[2:4], 0.2, atol=1e-3)
    assert np.allclose(moved.ellipse[:2], fit.ellipse[:2], atol=1e-6)
    grown = moved.shape_cov - fit.shape_cov
    assert grown[2, 2] == pytest.approx(0.1**2, rel=1e-3)
    assert np.linalg.matrix_rank(grown, tol=1e-9) == 1


@pytest.mark.parametrize("blur_px", [0.5, 1.0, 2.0])
@pytest.mark.parametrize(("dark", "bright"), [(0.02, 0.6), (0.1, 0.9)])
def test_the_displacement_is_that_of_encoded_images(blur_px, dark, bright):
    light = bright + (dark - bright) * coverage(ELLIPSE, 320, 240, blur_px, subpixels=8)
    levels = (255 * SRGB.level(light)).astype(np.float32)
    seen = detect_circles(levels, 255.0, Photometry())
    (detection,) = seen.detections
    fit = fit_detection(seen, detection, Camera(320, 240, np.diag([300.0, 300.0, 1.0])), "ml")
    measured = float(np.mean(fit.ellipse[2:4] - ELLIPSE[2:4]))
    expected = edge_displacement_px(*(float(v) for v in SRGB.level([dark, bright])), blur_px)
    # A fit of the whole step sees another middle than its half level: rendered frames measured 0.87 to 1.05 of it.
    assert measured == pytest.approx(expected, rel=0.2)


def test_equal_levels_displace_nothing():
    assert edge_displacement_px(0.4, 0.4, 1.0) == 0.0
    assert edge_displacement_px(0.2, 0.9, 1.0) < 0 < edge_displacement_px(0.9, 0.2, 1.0)
