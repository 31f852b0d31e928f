"""Edges that a camera's processing displaces: the computed displacement against that of processed profiles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from roundel.scenes.camera.response_curve import LINEAR, SRGB
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.photometry.processing_displacement import processing_displacement_px

INK, PAPER = 0.035, 0.8
STEP_PX = 0.01


def shifted(amount: float, blur_px: float) -> float:
    """Displacement of the middle of an edge after an unsharp mask of this amount, px."""
    x = np.arange(-12.0, 12.0, STEP_PX)
    level = SRGB.level(INK + (PAPER - INK) * ndtr(x / math.sqrt(blur_px**2 + PIXEL_VARIANCE)))
    level = level + amount * (level - gaussian_filter1d(level, 1.0 / STEP_PX, mode="nearest"))
    light = SRGB.light(np.clip(level, 0.0, 1.0))
    return float(x[np.argmax(light >= (INK + PAPER) / 2)])


@pytest.mark.parametrize("blur_px", [0.1, 0.5, 1.0])
def test_sharpening_moves_an_edge_to_its_darker_side(blur_px: float) -> None:
    found = processing_displacement_px(SRGB, INK, PAPER, blur_px, sharpened=True, toned=False)
    assert found == pytest.approx(shifted(0.7, blur_px), abs=2 * STEP_PX)
    assert found < -0.04
    # Half and twice the typical amount: no more than twice the standard deviation, and no less than two fifths.
    assert 0.5 < found / shifted(1.4, blur_px) < 1.0 < found / shifted(0.35, blur_px) < 2.5
    light_on_dark = processing_displacement_px(SRGB, PAPER, INK, blur_px, sharpened=True, toned=False)
    assert light_on_dark == pytest.approx(-found, abs=1e-3)


def test_a_tone_curve_adds_to_it() -> None:
    toned, sharpened, both = (
        processing_displacement_px(SRGB, INK, PAPER, 0.5, sharpened=s, toned=t)
        for t, s in ((True, False), (False, True), (True, True))
    )
    assert -0.04 < toned < -0.01
    assert both < min(toned, sharpened)


def test_nothing_moves_a_symmetric_edge_nor_one_that_was_not_processed() -> None:
    assert abs(processing_displacement_px(LINEAR, 0.1, 0.7, 0.5, sharpened=True, toned=False)) < 1e-3
    assert processing_displacement_px(SRGB, INK, PAPER, 0.5, sharpened=False, toned=False) == 0.0
    assert processing_displacement_px(SRGB, 0.3, 0.3, 0.5, sharpened=True, toned=True) == 0.0
