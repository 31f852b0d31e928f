"""Response curves: both directions, and the parser's messages."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.camera.response_curve import LINEAR, SRGB, UNKNOWN, ResponseCurve, gamma_curve, parse_curve
from roundel.scenes.errors import UsageError


@given(st.floats(0, 1), st.sampled_from([LINEAR, SRGB, UNKNOWN, gamma_curve(2.2), gamma_curve(0.5)]))
def test_light_and_level_are_inverse(value, curve):
    assert curve.light(curve.level(value)) == pytest.approx(value, abs=1e-7)  # the standard's rounded constants


def test_words():
    assert parse_curve("linear") == ResponseCurve("linear", basis="as given")
    assert parse_curve(" sRGB ") == ResponseCurve("srgb", basis="as given")
    assert parse_curve("gamma:2.2") == ResponseCurve("gamma", 2.2, "as given")
    assert parse_curve("gamma:1").kind == "linear"
    assert parse_curve("estimate") is None
    assert [str(c) for c in (LINEAR, SRGB, UNKNOWN, gamma_curve(2.2))] == ["linear", "srgb", "unknown", "gamma:2.2"]
    assert [c.identity for c in (LINEAR, SRGB, UNKNOWN)] == [True, False, True]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sgrb", "did you mean srgb?"),
        ("lineal", "did you mean linear?"),
        ("gamma", "did you mean gamma:2.2?"),
        ("gamma2.2", "did you mean gamma:2.2?"),
        ("log", "use linear, srgb, gamma:2.2 or estimate"),
        ("", "use linear, srgb, gamma:2.2 or estimate"),
        ("gamma:", "from 0.2 to 5"),
        ("gamma:nan", "from 0.2 to 5"),
        ("gamma:0", "from 0.2 to 5"),
        ("gamma:22", "from 0.2 to 5"),
        (2.2, "must be one of"),
    ],
)
def test_curves_that_do_not_exist(text, message):
    with pytest.raises(UsageError, match="curve") as error:
        parse_curve(text)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_gamma_at_the_ends():
    np.testing.assert_allclose(gamma_curve(2.2).light([-1.0, 0.0, 1.0]), [0.0, 0.0, 1.0])
