"""What a camera declares about its rolling shutter: row times, and the record of it."""

import math

import numpy as np
import pytest
from helpers_studies import small_study

from roundel.datasets.finish import camera_record
from roundel.scenes.camera.row_time import (
    GLOBAL_SHUTTER,
    MOVING_RATE_SIGMA_DEG_S,
    MOVING_VELOCITY_SIGMA_M_S,
    RowTime,
    row_time_from_json,
    row_time_to_json,
)
from roundel.scenes.errors import DataError
from roundel.scenes.world.frame import frame_of


def test_row_times_are_those_of_the_rendered_frame(tmp_path) -> None:
    shutter = (
        "motion: {exposure_s: 0.004, readout_s: 0.02, twist_prior: {velocity_sigma_m_s: 0.1, rate_sigma_deg_s: 5}}"
    )
    frame = frame_of(small_study(tmp_path, ("pose:", f"{shutter}\npose:")), 0)
    record = camera_record(frame, None)
    assert record["exposure_s"] == 0.004
    row_time = row_time_from_json(record)
    assert row_time == RowTime(0.02, 0.1, 5.0)
    rows = np.array([0.0, 17.25, frame.camera.height_px - 1.0])
    px = np.stack([np.full(3, 5.0), rows], axis=-1)
    times = row_time.time_s(px, (0.0, frame.motion.centre_row_px), frame.camera.width_px, frame.camera.height_px)
    # The same product in another order: a few roundings of 0.02 s.
    np.testing.assert_allclose(times, frame.motion.row_time_s(rows), atol=1e-17)


def test_an_upright_photograph_is_read_along_x() -> None:
    upright = RowTime(0.02, 0.1, 5.0, along_x=True)
    assert upright.row_s(480, 640) == 0.02 / 480
    assert upright.time_s([[240.0, 7.0]], (0.0, 99.0), 480, 640) == pytest.approx([0.01])


def test_the_twist_has_metres_and_radians() -> None:
    np.testing.assert_allclose(RowTime(0.02, 0.1, 180.0).twist_sigma, [0.1, 0.1, 0.1, math.pi, math.pi, math.pi])


def test_records_with_and_without_a_prior() -> None:
    assert row_time_from_json(row_time_to_json(0.01, 0.002, (0.1, 3.0))) == RowTime(0.01, 0.1, 3.0)
    moving = RowTime(0.01, MOVING_VELOCITY_SIGMA_M_S, MOVING_RATE_SIGMA_DEG_S)
    assert row_time_from_json(row_time_to_json(0.01, 0.002, None)) == moving
    # A camera with a global shutter moves if that is declared.
    assert row_time_from_json(row_time_to_json(0.0, 0.002, (0.1, 3.0))) == RowTime(0.0, 0.1, 3.0)
    assert row_time_from_json(row_time_to_json(0.0, 0.002, None)) == GLOBAL_SHUTTER
    assert RowTime(0.0, 0.1, 0.0).moves
    assert not GLOBAL_SHUTTER.moves
    assert row_time_from_json({"readout_s": None}) is None
    assert row_time_from_json({}) is None


@pytest.mark.parametrize(
    "record",
    [
        {"readout_s": "fast"},
        {"readout_s": -0.01},
        {"readout_s": float("nan")},
        {"readout_s": [0.01]},
        {"readout_s": 0.01, "twist_prior": {"velocity_sigma_m_s": 0.1}},
        {"readout_s": 0.01, "twist_prior": 3},
        {"readout_s": 0.01, "twist_prior": {"velocity_sigma_m_s": -1, "rate_sigma_deg_s": 3}},
    ],
)
def test_a_wrong_record_is_one_line(record) -> None:
    with pytest.raises(DataError, match="readout_s") as caught:
        row_time_from_json(record)
    assert "\n" not in str(caught.value)
