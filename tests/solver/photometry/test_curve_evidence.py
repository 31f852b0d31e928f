"""The response curve from the edges: right or undecided, never wrong, on ideal edges of many blurs and noises."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_images import picture

from roundel.scenes.camera.response_curve import LINEAR, SRGB, gamma_curve
from roundel.solver.methods.roundel_fits import detect_circles
from roundel.solver.photometry.curve_evidence import CurveEvidence, curve_evidence

ELLIPSE = np.array([150.3, 110.2, 30.0, 22.0, 20.0])


def delivered(curve, blur_px: float, noise_dn: float, seed: int = 0, dark: float = 30.0) -> np.ndarray:
    """An 8-bit image of light with noise, through a curve."""
    light = picture([(ELLIPSE, dark)], 320, 240, blur_px=blur_px).astype(np.float64)
    light += np.random.default_rng(seed).normal(0.0, noise_dn, light.shape)
    return np.rint(255 * curve.level(np.clip(light, 0, 255) / 255)).astype(np.float32)


def evidence(levels: np.ndarray) -> CurveEvidence:
    seen = detect_circles(levels, 255.0)
    return curve_evidence(levels, [d.edges for d in seen.detections], 255.0)


# Measured: 36 right, 24 undecided (most with a noise of 4 dn, or blurred and noisy), none wrong.
def test_no_wrong_decision_and_few_undecided():
    kinds = []
    for curve in (LINEAR, SRGB):
        for blur_px in (0.0, 0.4, 0.8, 1.5, 3.0):
            for noise_dn in (0.5, 1.5, 4.0):
                for seed in range(2):
                    found = evidence(delivered(curve, blur_px, noise_dn, seed)).curve.kind
                    assert found in (curve.kind, "unknown"), (curve.kind, blur_px, noise_dn, seed)
                    kinds.append(found)
    assert kinds.count("unknown") <= 28


@pytest.mark.parametrize("gamma", [1.5, 0.5])
def test_other_curves_are_neither(gamma):
    found = evidence(delivered(gamma_curve(gamma), 0.6, 0.5)).curve
    assert found.kind == "unknown"
    assert "neither linear nor sRGB" in found.basis or "do not tell" in found.basis


def test_a_power_of_two_point_two_is_taken_for_srgb():
    # The two differ by at most 3 % of the range, and displace an edge by nearly the same distance.
    assert evidence(delivered(gamma_curve(2.2), 0.6, 0.5)).curve.kind == "srgb"


def test_without_contours_nothing_is_known():
    found = curve_evidence(np.zeros((60, 80), np.float32), [], 255.0).curve
    assert (found.kind, found.basis) == ("unknown", "no edge in the image can be measured")


def test_clipped_paper_leaves_the_curve_unknown():
    light = np.clip(1.6 * picture([(ELLIPSE, 30.0)], 320, 240, blur_px=0.8).astype(np.float64), 0, 255)
    assert evidence(light.astype(np.float32)).curve.kind == "unknown"


def test_a_difference_from_a_few_places_decides_nothing():
    chi2, third = (500.0, 300.0), 600.0
    assert CurveEvidence(chi2, third, -5.0, 1.0, 1).curve.kind == "srgb"
    assert CurveEvidence(chi2, third, -2.0, 1.0, 1).curve.kind == "unknown"
    assert CurveEvidence(chi2, third, -5.0, 50.0, 1).curve.kind == "unknown"
    assert CurveEvidence(chi2, 200.0, -5.0, 1.0, 1).curve.kind == "unknown"
