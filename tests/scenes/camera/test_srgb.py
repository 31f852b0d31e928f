"""The sRGB curve: values of the standard, and the two directions are inverse."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.camera.srgb import linear_to_srgb, srgb_to_linear


@pytest.mark.parametrize(("level", "light"), [(0.0, 0.0), (1.0, 1.0), (0.04045, 0.04045 / 12.92), (0.5, 0.21404114)])
def test_published_values(level: float, light: float) -> None:
    # Eight digits of 0.5 are printed in many places; the others are exact.
    assert float(srgb_to_linear(level)) == pytest.approx(light, abs=5e-9)


@given(st.floats(0.0, 1.0))
def test_there_and_back(level: float) -> None:
    # The standard's two pieces meet to 1e-7 only, so that near the joint the way back may take the other piece.
    assert float(linear_to_srgb(srgb_to_linear(level))) == pytest.approx(level, abs=2e-6)


def test_negative_light_stays_negative() -> None:
    np.testing.assert_allclose(linear_to_srgb(-0.001), -0.01292)
