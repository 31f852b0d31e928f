"""The slope of the light beside a contour: smooth light against edges."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_images import picture

from roundel.solver.detect.detect import detect
from roundel.solver.detect.light_slope import slope_beside

Y, X = np.mgrid[:240, :320]
R = np.hypot(X - 160.3, Y - 119.6)
SMOOTH = {
    "bowl": R,
    "flat bowl": 150 + 0.1 * R,
    "steep bowl": 1.2 * R,
    "hill": 60 + 150 * np.exp(-(R**2) / 7200),
    "paraboloid": 220 - R**2 / 200,
    "vignette": 200 * np.cos(np.arctan(R / 250)) ** 4,
}


@pytest.mark.parametrize("noise_dn", [0.0, 0.5])
@pytest.mark.parametrize("name", list(SMOOTH))
def test_rounded_smooth_light_has_no_confident_circle(name, noise_dn):
    levels = SMOOTH[name] + np.random.default_rng(1).normal(0, noise_dn, R.shape)
    found = detect(np.clip(np.floor(levels), 0, 255).astype(np.uint8))
    assert [d for d in found if d.confidence >= 0.5] == []


def test_slopes():
    circle = np.array([160.3, 119.6, 60.0, 60.0, 0.0])
    assert slope_beside(R.astype(np.float32), circle) == pytest.approx(1.0, abs=0.01)  # bilinear samples of a cone
    for blur_px, most in ((0.5, 0.02), (3.0, 0.4)):
        disc = picture([(circle, 30.0)], 320, 240, blur_px=blur_px)
        assert abs(slope_beside(disc.astype(np.float32), circle)) < most
    # Shading on one side alone does not hide an edge.
    shaded = picture([(circle, 30.0)], 320, 240, blur_px=0.5) + np.where(R > 60, 3.0 * (R - 60), 0.0)
    assert slope_beside(shaded.astype(np.float32), circle) < 0.02
