"""Sweeps: the level at which an error doubles is found where it was planted, with an interval that covers it."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from roundel.validate.claims.robustness import crossing, sweep_summary, sweeps_of
from roundel.validate.figures.robustness import doubling_in_words, sweep_pictures

LEVELS = [1.0, 2.0, 4.0, 8.0, 16.0]


def study(levels: list[float], key: str = "sensor.full_well_e") -> dict[str, object]:
    return {"groups": {"main": {"sweep": {"key": key, "levels": levels}}}}


def table(
    levels: list[float], error: dict[float, np.ndarray], lost: frozenset[tuple[int, float]] = frozenset()
) -> pa.Table:
    rows = [
        {
            "frame_id": i * len(error[level]) + j,
            "marker_id": 0,
            "method": "ml",
            "intrinsics": "true",
            "reference": "truth",
            "group": "main",
            "sweep_level": level,
            "sweep_frame": j,
            "solved": (j, level) not in lost,
            "oracle_normal_error_deg": None if (j, level) in lost else float(error[level][j]),
            "oracle_position_error_pct": None if (j, level) in lost else 3.0 * float(error[level][j]),
            "oracle_reprojection_error_px": None if (j, level) in lost else 5.0 * float(error[level][j]),
            "normal_bound_deg": 0.01,
        }
        for i, level in enumerate(levels)
        for j in range(len(error[level]))
    ]
    return pa.Table.from_pylist(rows)


@given(st.floats(0.1, 0.9), st.integers(1, 3), st.floats(1e-3, 10.0))
def test_a_planted_crossing_is_found(t: float, i: int, unit: float) -> None:
    """A curve straight in both logarithms doubles exactly where it was made to."""
    where = math.exp((1 - t) * math.log(LEVELS[i]) + t * math.log(LEVELS[i + 1]))
    slope = math.log(2.0) / math.log(where)
    values = unit * np.array(LEVELS) ** slope
    assert crossing(LEVELS, values, 0) == pytest.approx(where, rel=1e-9)


def test_the_nearest_crossing_on_either_side_counts() -> None:
    levels = [-0.2, -0.1, 0.0, 0.1, 0.2]
    assert crossing(levels, np.array([9.0, 1.5, 1.0, 4.0, 8.0]), 2) == pytest.approx(0.05)
    assert crossing(levels, np.array([9.0, 4.0, 1.0, 1.0, 1.0]), 2) == pytest.approx(-0.05)
    assert crossing(levels, np.ones(5), 2) is None
    assert crossing(levels, np.array([1.0, 1.0, 1.0, 1.0, math.inf]), 2) == 0.2


def test_the_interval_covers_the_planted_level() -> None:
    """Errors of each frame grow as sqrt(level): the doubling at 4 lies in the interval, and near the estimate."""
    scatter = np.exp(0.3 * np.random.default_rng(1).normal(size=40))
    errors = {level: 0.02 * scatter * math.sqrt(level) for level in LEVELS}
    (sweep,) = sweeps_of(table(LEVELS, errors), study(LEVELS))
    doubling = sweep.curves[0].doubling
    # Frames are paired: their scatter cancels exactly.
    assert doubling.level == pytest.approx(4.0, rel=1e-9)
    assert doubling.low == pytest.approx(4.0, rel=1e-9)
    assert doubling.high == pytest.approx(4.0, rel=1e-9)


def test_independent_noise_widens_the_interval_around_the_level() -> None:
    random = np.random.default_rng(2)
    errors = {level: 0.02 * math.sqrt(level) * np.abs(random.normal(size=60)) for level in LEVELS}
    (sweep,) = sweeps_of(table(LEVELS, errors), study(LEVELS))
    doubling = sweep.curves[0].doubling
    assert doubling.low is not None
    assert doubling.low < 4.0 < (doubling.high or math.inf)
    assert doubling.low < 0.95 * (doubling.high or math.inf)


def test_a_lost_circle_is_infinitely_wrong() -> None:
    """With more than half of the frames lost the median is infinite, and the error has doubled there."""
    errors = {level: np.full(12, 0.02) for level in LEVELS}
    lost = frozenset((j, 8.0) for j in range(7)) | frozenset((j, 16.0) for j in range(12))
    sweeps = sweeps_of(table(LEVELS, errors, lost), study(LEVELS))
    curve = sweeps[0].curves[0]
    assert math.isinf(curve.median_deg[3])
    assert curve.median[0] == pytest.approx(2.0)  # 0.02 deg over a bound of 0.01
    assert curve.doubling.level == 8.0
    assert curve.solved == [12, 12, 12, 5, 0]
    facts = sweep_summary(sweeps)
    assert facts[0]["curves"][0]["normal_median_deg"][3] is None
    assert "has doubled at 8.00 electrons" in doubling_in_words(facts[0], facts[0]["curves"][0])
    # Position and reprojection are drawn beside the normal, and so is the recall.
    drawn = facts[0]["curves"][0]
    assert drawn["position_median"] == pytest.approx([0.06, 0.06, 0.06, None, None])
    assert drawn["reprojection_median_low"][:3] == pytest.approx([0.1, 0.1, 0.1])
    (picture,) = sweep_pictures(facts)
    for label in ("position error, median", "reprojection error, median", "recall"):
        assert label in picture.svg
    assert "recall" in picture.caption


def test_coverage_of_each_level_is_that_of_its_poses() -> None:
    """Of 20 poses, 1 lies outside at the first level, 10 at the second; at the third none has a covariance."""
    levels = LEVELS[:3]
    rows = table(levels, {level: np.full(20, 0.02) for level in levels})
    inside, outside = stats.chi2.ppf([0.949, 0.951], 5)
    chi2 = [outside, *[inside] * 19, *[inside, outside] * 10, *[None] * 20]
    rows = rows.append_column("oracle_pose_chi2", pa.array(chi2, pa.float64()))
    (facts,) = sweep_summary(sweeps_of(rows, study(levels)))
    curve = facts["curves"][0]
    assert curve["coverage"] == [0.95, 0.5, None]
    # Wilson's interval of 10 of 20, from its definition.
    z = stats.norm.ppf(0.975)
    half = z / (1 + z**2 / 20) * math.sqrt(0.25 / 20 + z**2 / (4 * 20**2))
    assert [curve["coverage_low"][1], curve["coverage_high"][1]] == pytest.approx([0.5 - half, 0.5 + half], abs=1e-12)


def test_few_frames_give_no_curve() -> None:
    errors = {level: np.full(5, 0.02) for level in LEVELS}
    assert sweeps_of(table(LEVELS, errors), study(LEVELS)) == []


def test_no_sweep_gives_nothing() -> None:
    errors = {level: np.full(12, 0.02) for level in LEVELS}
    assert sweeps_of(table(LEVELS, errors), {"groups": {"main": {"sweep": None}}}) == []


def test_a_frame_that_lacks_a_level_is_left_out() -> None:
    """Levels are compared on the same frames: one that was not scored at every level would compare unlike sets."""
    errors = {level: np.full(12, 0.02) for level in LEVELS}
    # The frame that is missing at the last level is ten times better than the others elsewhere.
    errors = {level: np.concatenate([values, np.full(12, 0.002)]) for level, values in errors.items()}
    whole = table(LEVELS, errors)
    keep = [not (row["sweep_level"] == 16.0 and row["sweep_frame"] >= 12) for row in whole.to_pylist()]
    (sweep,) = sweeps_of(whole.filter(pa.array(keep)), study(LEVELS))
    assert sweep.curves[0].median == pytest.approx(np.full(5, 2.0))
