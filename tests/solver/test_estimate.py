"""An estimate as a user reads it: distance, tilt, and what a notebook shows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.conic import Ellipse
from roundel.scenes.geometry.pose import normal_of
from roundel.solver.estimates import Estimate


def estimate(**given: object) -> Estimate:
    fields: dict[str, object] = {
        "normal": np.array([normal_of(30.0, 10.0), normal_of(28.0, -170.0)]),
        "centre_m": np.array([[0.3, 0.0, 0.4], [0.0, 0.0, 0.6]]),
        "probability": (0.75, 0.25),
        "ellipse": Ellipse(320.0, 240.0, 40.0, 35.0, 12.0),
    } | given
    return Estimate(3, 0, "pixels", "true", "ok", **fields)  # type: ignore[arg-type]


def test_distance_and_tilt_of_both_candidates() -> None:
    found = estimate()
    assert found.distance_m is not None
    assert found.tilt_deg is not None
    assert found.distance_m == pytest.approx([0.5, 0.6], rel=1e-15)
    assert found.tilt_deg == pytest.approx([30.0, 28.0], rel=1e-12)


@given(st.floats(0.0, 90.0), st.floats(-180.0, 180.0))
def test_the_tilt_is_that_of_the_normal(tilt_deg: float, azimuth_deg: float) -> None:
    found = estimate(normal=normal_of(tilt_deg, azimuth_deg)[None], centre_m=np.array([[0.0, 0.0, 1.0]]))
    assert found.tilt_deg is not None
    assert found.tilt_deg[0] == pytest.approx(tilt_deg, abs=1e-12)


def test_an_estimate_shows_both_poses_in_a_few_lines() -> None:
    lines = repr(estimate(chosen=0, caveats=("the edge has a step",))).splitlines()
    assert lines == [
        "<Estimate of frame 3, pixels, true",
        "  ellipse: centre (320.00, 240.00) px, semi-axes 40.00 and 35.00 px, 12.0 deg",
        "  pose 0: distance 0.5 m, tilt 30.00 deg, probability 0.75, chosen",
        "  pose 1: distance 0.6 m, tilt 28.00 deg, probability 0.25",
        "  caveat: the edge has a step>",
    ]


def test_a_failure_shows_its_reason() -> None:
    failed = Estimate(3, -1, "pixels", "true", "failed", "no circle found")
    assert repr(failed) == "<Estimate of frame 3, pixels, true: failed, no circle found>"
    assert failed.distance_m is None
    assert failed.tilt_deg is None


def test_a_camera_from_nested_lists() -> None:
    camera = Camera(640, 480, [[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])  # type: ignore[arg-type]
    assert camera.K.dtype == np.float64
    assert camera.K.shape == (3, 3)
