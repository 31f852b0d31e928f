"""The least noise of a pixel, and what records say of a camera's processing."""

from __future__ import annotations

import numpy as np
import pytest

from roundel.scenes.camera.response_curve import LINEAR, SRGB, gamma_curve
from roundel.solver.photometry.photometry import Photometry, level_step, processing_of


@pytest.mark.parametrize("curve", [LINEAR, SRGB, gamma_curve(2.2)], ids=str)
def test_rounding_is_that_of_decoded_levels(curve):
    """Light is rounded through the curve; its error is compared with the floor at that level."""
    floor = Photometry(curve, 255.0, 1.0).noise_floor(20.0, 200.0, 0.8)
    random = np.random.default_rng(0)
    for level_dn in (8.0, 40.0, 120.0, 230.0):
        light = level_dn + random.uniform(-3, 3, 20_000)  # several levels wide
        back = 255 * curve.light(np.rint(255 * curve.level(light / 255)) / 255)
        # 20,000 errors of a uniform distribution: 1 %; the slope changes over the 6 levels.
        assert floor(level_dn) == pytest.approx(np.mean((back - light) ** 2), rel=0.15)


def test_averaging_and_wider_steps():
    one, colour, shifted = (
        Photometry(LINEAR, 255.0, step, part).noise_floor(0, 255, 1) for step, part in ((1, 1), (1, 1 / 3), (4, 1))
    )
    assert one(100.0) == pytest.approx(1 / 12)
    assert colour(100.0) == pytest.approx(1 / 36)
    assert shifted(100.0) == pytest.approx(16 / 12)
    assert Photometry(SRGB).noise_floor(0, 255, 1)(100.0) == 0.0  # real numbers


def test_steps_of_arrays():
    levels = np.arange(256, dtype=np.uint8)
    assert level_step(levels, 255.0) == 1.0
    assert level_step(levels / 255, 1.0) == pytest.approx(1 / 255)
    assert level_step(levels.astype(np.float32), 255.0) == 1.0
    assert level_step(np.linspace(0, 1, 1000), 1.0) == 0.0
    assert level_step(levels * 1e300, 255e300) == 0.0


def test_processing_of_records():
    assert processing_of(None) == processing_of({}) == (False, False)
    assert processing_of({"sharpen_amount": 0.7, "contrast": 0.0, "black_point": 0.0, "white_point": 1.0}) == (
        True,
        False,
    )
    assert processing_of({"sharpen_amount": 0.0, "contrast": 0.2}) == (False, True)
    assert processing_of({"black_point": 0.02}) == (False, True)
