"""Arrays of any type as grey levels in linear light."""

from __future__ import annotations

import numpy as np
import pytest

from roundel.scenes.camera.response_curve import SRGB, UNKNOWN, gamma_curve
from roundel.scenes.camera.srgb import srgb_to_linear
from roundel.solver.photometry.image_levels import averaged_rounding, encodable, grey_levels

RAMP = np.arange(256, dtype=np.uint8).reshape(8, 32)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int16", "int32", "uint32", "float16", "float32", "float64"])
def test_every_type_is_decoded_alike(dtype):
    # A curve applies to fractions of the range: 127 of 255 and 32,639 of 65,535 are the same light.
    scale = {"uint16": 257, "int16": 128}.get(dtype, 1)
    grey, top = grey_levels((RAMP.astype(np.float64) * scale).astype(dtype), SRGB)
    assert grey.dtype == np.float32
    assert grey.flags.c_contiguous
    light = srgb_to_linear(RAMP.astype(np.float64) * scale / top)
    np.testing.assert_allclose(grey / top, light, atol=2e-7 if dtype != "float16" else 1e-3)


def test_unknown_and_linear_levels_stay():
    for curve in (UNKNOWN, gamma_curve(1.0)):
        grey, top = grey_levels(RAMP, curve)
        assert top == 255.0
        assert np.array_equal(grey, RAMP)


def test_colours_are_averaged_in_light():
    image = np.zeros((600, 4, 3), np.uint8)  # more rows than one strip
    image[..., 0] = 255
    grey, _ = grey_levels(image, SRGB)
    np.testing.assert_allclose(grey, 85.0, rtol=1e-6)  # of sRGB values the mean would be 85, too; of 128 it is not:
    image[..., 0] = 128
    np.testing.assert_allclose(grey_levels(image, SRGB)[0], 255 * srgb_to_linear(128 / 255) / 3, rtol=1e-6)
    assert averaged_rounding(image) == pytest.approx(1 / 3)
    assert averaged_rounding(image[..., 0]) == 1.0


def test_a_black_pixel_has_no_negative_power():
    grey, _ = grey_levels(np.array([[-0.5, 0.0, 1.0]]), gamma_curve(2.2))
    np.testing.assert_allclose(grey, [[0.0, 0.0, 1.0]])


def test_levels_that_no_file_has_are_not_encoded():
    assert encodable(RAMP)
    assert not encodable(RAMP.astype(np.int16) - 1)
    assert not encodable(RAMP * 1e4)
