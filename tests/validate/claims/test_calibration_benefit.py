"""Benefit of calibration, on tables of scores whose answer is known."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from roundel.validate.claims.calibration_benefit import (
    BOARD,
    ERRORS,
    FACTOR,
    CalibrationBenefit,
    calibration_benefit,
    error_ratio,
    level_of,
    off_axis_deg,
    verdict_of,
)
from roundel.validate.claims.calibration_benefit_text import answer, benefit_record, title_of, where
from roundel.validate.figures.calibration_benefit import benefit_pictures
from roundel.validate.statistics.intervals import Interval
from roundel.validate.tables.calibration_benefit import benefit_table

N = 252
FRAMES = np.arange(N)
DISTANCE = np.repeat([10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0], 36)
TILT = np.tile([15.0, 30.0, 45.0], 84)
# A third on the axis, the rest evenly from 1 to 17 degrees off it, whatever the distance.
OFFSET = np.where(FRAMES % 3 == 0, 0.05, 1.0 + 16.0 * ((FRAMES * 0.618) % 1.0))
NOISE = np.random.default_rng(7).lognormal(-3.0, 0.5, N)


def offsets(degrees: np.ndarray) -> pa.Table:
    """As `off_axis_deg` gives them."""
    return pa.table({"frame_id": FRAMES, "marker_id": np.zeros(N, dtype=int), "off_axis_deg": degrees})


OFFSETS = offsets(OFFSET)


def scores(runs: dict[str, dict[str, np.ndarray]], method: str = "ml", reference: str = "truth") -> pa.Table:
    """Rows as scores.parquet has them, with the columns that the question needs."""
    rows: list[dict[str, Any]] = []
    for label, errors in runs.items():
        for i in range(N):
            rows.append(
                {
                    "frame_id": i,
                    "marker_id": 0,
                    "method": method,
                    "intrinsics": label,
                    "reference": reference,
                    "distance_D": DISTANCE[i],
                    "tilt_deg": TILT[i],
                    **{e.oracle: float(errors[e.name][i]) for e in ERRORS},
                }
            )
    return pa.Table.from_pylist(rows)


def everywhere(factor: Any) -> dict[str, np.ndarray]:
    """The noise times a factor, for each error."""
    return {error.name: NOISE * factor for error in ERRORS}


def asked(runs: dict[str, dict[str, np.ndarray]], board: pa.Table | None = None) -> CalibrationBenefit:
    found = calibration_benefit(scores(runs), OFFSETS, board)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def mixed() -> CalibrationBenefit:
    """Normal: only beyond 5 degrees. Position: always. Reprojection: on the axis up to 30 D, off it never."""
    default = {
        "normal": NOISE * np.where(OFFSET > 5, 12.0, 1.0),
        "position": np.full(N, 13.0),
        "reprojection": NOISE * np.where((OFFSET < 0.5) & (DISTANCE <= 30), 8.0, 1.0),
    }
    position = {"calibrated:5": 0.01, "calibrated:20": 0.005, "true": 0.001}
    runs = {label: {**everywhere(1.0), "position": np.full(N, value)} for label, value in position.items()}
    board = scores({"calibrated:chessboard": everywhere(3.0)}, "chessboard_pnp")
    return asked({"default": default, "scaled:0.85": everywhere(2.0), **runs}, board)


def test_the_pair_is_fewest_views_against_default(mixed: CalibrationBenefit) -> None:
    assert (mixed.calibrated, mixed.uncalibrated) == ("calibrated:5", "default")
    assert mixed.labels == ["true", "calibrated:20", "calibrated:5", "default", "scaled:0.85"]
    assert len(mixed.on_axis) == N // 3
    assert len(mixed.on_axis) + len(mixed.off_axis) == N


def test_worth_beyond_an_offset(mixed: CalibrationBenefit) -> None:
    normal, position, reprojection = answer(mixed)[1:4]
    short = answer(mixed)[0]
    found = re.search(r"normal: on the axis nowhere, off the axis from ([\d.]+)\N{DEGREE SIGN} on;", short)
    assert found is not None, short
    # The bin that the step lies in is mixed; bins are two degrees wide.
    assert 3.0 < float(found[1]) < 7.0
    assert "position: everywhere;" in short
    assert "reprojection: on the axis up to 30 D, off the axis nowhere." in short
    assert "a factor of 1.0 [1.0, 1.0]" in normal
    assert "13.0 % and 0.0100 %, a factor of 1,300 [1,300, 1,300]" in position
    assert "(more than 2 up to 30 D" in reprojection


def test_not_worth_where_errors_are_alike() -> None:
    rng = np.random.default_rng(3)
    other = {error.name: rng.permutation(NOISE) for error in ERRORS}
    benefit = asked({"calibrated:5": everywhere(1.0), "default": other})
    assert answer(benefit)[0].endswith("for the normal, position and reprojection: nowhere.")
    verdicts = [gain["beneficial"] for panel in benefit_record(benefit)["panels"] for gain in panel["gain"]]
    assert set(verdicts) <= {"no", "open"}
    assert verdicts.count("no") > verdicts.count("open")


def test_pairs_see_what_unpaired_frames_hide() -> None:
    # The frames scatter by a factor of 1.65, the ratio within each of them not at all.
    benefit = asked({"calibrated:5": everywhere(1.0), "default": everywhere(2.5)})
    gain = error_ratio(benefit, "normal", benefit.off_axis)
    assert gain.value == pytest.approx(2.5)
    assert gain.low == pytest.approx(2.5)
    assert gain.high == pytest.approx(2.5)
    level = level_of(benefit, "normal", "default", benefit.off_axis)
    assert level.high / level.low > 1.1


def test_what_one_of_two_did_not_solve_is_no_pair() -> None:
    holes = everywhere(3.0)
    holes["normal"] = np.where(FRAMES % 2 == 0, np.nan, holes["normal"])
    benefit = asked({"calibrated:5": everywhere(1.0), "default": holes})
    assert error_ratio(benefit, "normal", np.arange(N)).n == N // 2
    assert error_ratio(benefit, "position", np.arange(N)).n == N
    nothing = error_ratio(benefit, "normal", np.flatnonzero(FRAMES % 2 == 0))
    assert (nothing.value, verdict_of(nothing)) == (None, "open")
    assert error_ratio(benefit, "normal", np.arange(6)).low is None  # three pairs say nothing


def test_no_noise_is_no_infinity() -> None:
    benefit = asked({"calibrated:5": everywhere(0.0), "default": everywhere(1.0)})
    json.dumps(benefit_record(benefit), allow_nan=False)


@pytest.mark.parametrize(
    "labels",
    [("true", "default"), ("calibrated:5", "true"), ("scaled:1", "scaled:0.7"), ("calibrated:5", "calibrated:40")],
    ids="-".join,
)
def test_no_question_without_both(labels: tuple[str, ...]) -> None:
    assert calibration_benefit(scores({label: everywhere(1.0) for label in labels}), OFFSETS) is None
    assert (
        calibration_benefit(
            scores({"calibrated:5": everywhere(1), "default": everywhere(1)}, reference="chessboard"), OFFSETS
        )
        is None
    )


def test_exif_serves_where_nothing_else_is_wrong() -> None:
    assert asked({"calibrated:phone": everywhere(1.0), "exif": everywhere(2.0)}).uncalibrated == "exif"


def test_studies_that_stay_on_the_axis_or_off_it() -> None:
    table = scores({"calibrated:5": everywhere(1.0), "default": everywhere(3.0)})
    for offset, words in ((0.1, "on the axis"), (9.0, "off the axis")):
        benefit = calibration_benefit(table, offsets(np.full(N, offset)))
        assert benefit is not None
        assert "for the normal, position and reprojection: everywhere" in answer(benefit)[0]
        assert words in answer(benefit)[1]
        assert benefit_pictures(benefit)[0].svg.startswith("<svg")


@pytest.mark.parametrize(
    ("verdicts", "words"),
    [
        ("yyyy", "everywhere"),
        ("nnon", "nowhere"),
        ("noyy", "from 30 D on"),
        ("yyon", "up to 20 D"),
        ("nyyn", "from 20 to 30 D"),
        ("ynyn", "at 10, 30 D"),
    ],
)
def test_where(verdicts: str, words: str) -> None:
    full = [{"y": "yes", "n": "no", "o": "open"}[v] for v in verdicts]
    assert where(full, [10, 20, 30, 40], [10, 20, 30, 40], " D") == words


def test_a_verdict_needs_its_whole_interval() -> None:
    def gain(low: float, high: float) -> Interval:
        return Interval(FACTOR, low, high, 50, "")

    assert [verdict_of(gain(*i)) for i in ((2.1, 3), (1.0, 1.9), (1.9, 2.1))] == ["yes", "no", "open"]


def test_the_record_and_the_table(mixed: CalibrationBenefit) -> None:
    record = json.loads(json.dumps(benefit_record(mixed), allow_nan=False))
    assert record["answer"] == answer(mixed)
    entry = next(
        e for e in record["overall"] if (e["error"], e["part"], e["intrinsics"]) == ("position", "off_axis", "default")
    )
    assert entry["value"] == pytest.approx(13.0)
    assert entry["gain"]["value"] == pytest.approx(1300.0)
    assert entry["n"] == 2 * N // 3
    table = benefit_table(record)
    assert {len(row) for row in table.rows} == {len(table.columns)}
    assert [row[:2] for row in table.rows][:2] == [("on the axis", "true"), ("on the axis", "calibrated:20")]
    assert sum(row[1] == BOARD for row in table.rows) == 2
    assert benefit_table(None).rows == ()


def test_the_picture(mixed: CalibrationBenefit) -> None:
    (picture,) = benefit_pictures(mixed)
    assert picture.svg == benefit_pictures(mixed)[0].svg
    for label in (*mixed.labels, BOARD):
        assert f">{title_of(label)}<" in picture.svg
    # Three errors by distance on and off the axis, tilt off it, and offset.
    assert len(re.findall(r'id="benefit-axes_\d+"', picture.svg)) == 12


def test_too_few_circles_for_a_curve_are_no_picture() -> None:
    table = scores({"calibrated:5": everywhere(1.0), "default": everywhere(3.0)})
    benefit = calibration_benefit(table.filter(pa.compute.less(table["frame_id"], 1)), OFFSETS)
    assert benefit is not None
    assert benefit_pictures(benefit) == []


def test_the_offset_is_the_angle_of_the_line_of_sight() -> None:
    truth = pa.table({
        "frame_id": [4, 5], "marker_id": [0, 0],
        "centre_x_m": [0.0, 0.3], "centre_y_m": [0.0, 0.4], "centre_z_m": [2.0, 0.5],
    })  # fmt: skip
    found = off_axis_deg(truth)
    assert found["frame_id"].to_pylist() == [4, 5]
    assert found["off_axis_deg"].to_pylist() == pytest.approx([0.0, 45.0])


def test_what_is_on_the_axis() -> None:
    # 0.2 degrees off the axis are on it, 0.7 degrees are not.
    offset = offsets(np.where(FRAMES % 2, 0.2, 0.7))
    runs = {"calibrated:5": everywhere(1.0), "default": everywhere(10.0)}
    found = calibration_benefit(scores(runs), offset)
    assert found is not None
    assert (len(found.on_axis), len(found.off_axis)) == (N // 2, N // 2)
    assert set(found.on_axis.tolist()) == {i for i in range(N) if i % 2}
