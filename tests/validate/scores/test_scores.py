"""Scores: assignment, oracle (the candidate nearer to the truth) and choice, references, and wrong estimates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_lenses import OPENCV
from helpers_reports import BOARDS, POINTS, estimate_rows, failed_row, make_dataset, write_estimates

from roundel.datasets.dataset import Dataset
from roundel.scenes.errors import DataError, NotComparableError, RoundelError, UsageError
from roundel.validate.calibration.chessboard_reference import reference_of
from roundel.validate.calibration.opencv import look_for_boards
from roundel.validate.estimates.runs import read_runs
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.scores.scores import SCORES_SCHEMA, Scores, score

RING = POINTS.replace("{kind: disc, diameter_m: 0.08}", "{kind: ring, diameter_m: 0.08, inner_diameter_m: 0.05}")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("points") / "ds", POINTS)


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("boards") / "ds", BOARDS)


def scored(dataset: Dataset, folder: Path, rows: list[dict[str, Any]]) -> Scores:
    runs = read_runs([write_estimates(folder / "estimates.parquet", rows)], dataset)
    return score(dataset, true_targets(dataset, 3.0), runs)


def test_perfect_estimates_have_no_error(dataset: Dataset, tmp_path: Path) -> None:
    table = scored(dataset, tmp_path, estimate_rows(dataset, ["true"])).table
    assert table.schema == SCORES_SCHEMA
    assert table.num_rows == 36
    assert all(table["solved"].to_pylist())
    # The closed form at 15 deg of tilt amplifies 1e-16 of the conic by some 1e6.
    assert max(table["oracle_normal_error_deg"].to_pylist()) < 1e-6
    assert max(table["oracle_position_error_D"].to_pylist()) < 1e-6
    assert max(table["oracle_reprojection_error_px"].to_pylist()) < 1e-6
    assert max(table["contour_error_px"].to_pylist()) < 1e-6
    # Nothing was chosen: null, not false.
    assert table["branch_correct"].null_count == table["normal_error_deg"].null_count == 36


def test_the_chosen_candidate_is_scored_as_chosen(dataset: Dataset, tmp_path: Path) -> None:
    table = scored(dataset, tmp_path, estimate_rows(dataset, ["true"], chosen=True)).table
    right = np.array(table["branch_correct"].to_pylist(), dtype=bool)
    chosen, oracle = table["normal_error_deg"].to_numpy(), table["oracle_normal_error_deg"].to_numpy()
    assert 0 < right.sum() < 36
    np.testing.assert_array_equal(chosen[right], oracle[right])
    # The wrong one is some twice the tilt away: 30 deg at the least tilt.
    assert chosen[~right].min() > 10


def test_a_wrong_focal_length_moves_the_centre_and_not_the_normal(dataset: Dataset, tmp_path: Path) -> None:
    table = scored(dataset, tmp_path, estimate_rows(dataset, ["scaled:0.7", "scaled:1.3"])).table
    # Errata, section 5: |k - 1| of the distance (30.0 %); the normal unmoved but for the 5 px off the axis.
    np.testing.assert_allclose(table["oracle_position_error_pct"].to_numpy(), 30.0, atol=0.1)
    assert max(table["oracle_normal_error_deg"].to_pylist()) < 0.3
    assert (np.sign(table["oracle_along_ray_m"].to_numpy()) == np.where(
        np.array(table["intrinsics"].to_pylist()) == "scaled:1.3", 1, -1)).all()  # fmt: skip


def test_missing_and_failed_frames_are_rows_with_a_reason(dataset: Dataset, tmp_path: Path) -> None:
    rows = [r for r in estimate_rows(dataset, ["true"]) if r["frame_id"] not in (3, 7)]
    table = scored(dataset, tmp_path, [*rows, failed_row(3, "true")]).table
    lost = {r["frame_id"]: r for r in table.to_pylist() if not r["solved"]}
    assert lost[3]["reason"] == "no circle found"
    assert lost[7]["reason"] == "the estimates have no row for this frame"
    assert lost[3]["oracle_normal_error_deg"] is None
    assert lost[3]["contour_error_px"] is None
    assert lost[3]["distance_D"] == pytest.approx(15)


def test_detections_of_nothing_are_counted(dataset: Dataset, tmp_path: Path) -> None:
    rows = estimate_rows(dataset, ["true"])
    ghosts = [
        {**r, "detection_id": 5, "ellipse_x_px": r["ellipse_x_px"] + 200} for r in rows if r["frame_id"] in (1, 2)
    ]
    twins = [{**r, "detection_id": 6, "ellipse_a_px": r["ellipse_a_px"] + 1} for r in rows if r["frame_id"] == 2]
    found = scored(dataset, tmp_path, [*rows, *ghosts, *twins])
    assert [(f.detections, f.count, f.frame_ids) for f in found.false_detections] == [(39, 3, [1, 2])]
    # The nearer of two detections of one marker is the one that counts.
    assert max(found.table["contour_error_px"].to_pylist()) < 1e-6
    missed = scored(
        dataset, tmp_path, [r for r in [*rows, *ghosts] if not (r["frame_id"] == 1 and r["detection_id"] == 0)]
    )
    assert next(r["reason"] for r in missed.table.to_pylist() if r["frame_id"] == 1).startswith("1 detection, 1")


def test_the_inner_circle_is_not_the_ring(tmp_path: Path) -> None:
    rings = make_dataset(tmp_path / "ds", RING)
    rows = [
        {**r, **{k: r[k] * 5 / 8 for k in ("ellipse_a_px", "ellipse_b_px")}} for r in estimate_rows(rings, ["true"])
    ]
    table = scored(rings, tmp_path, rows).table
    near = table["distance_D"].to_numpy() < 20
    # 3/8 of the semi-axis exceeds the gate of a quarter; far away the gate of 3 px is the wider.
    assert not np.array(table["solved"].to_pylist())[near].any()


@pytest.mark.parametrize(
    "lens",
    [
        "distortion_model: fisheye, distortion: [0.02, -0.01, 0.001, 0.0]",
        f"distortion: {list(OPENCV['14'])}",
    ],
    ids=["fisheye", "14"],
)
def test_every_lens_is_scored_in_its_own_image(tmp_path: Path, lens: str) -> None:
    text = POINTS.replace("focal_px: 1280", f"focal_px: 1280, {lens}")
    wide = make_dataset(tmp_path / "ds", text)
    rows = estimate_rows(wide, ["true"])
    errors = np.array(scored(wide, tmp_path, rows).table["contour_error_px"].to_pylist())
    # The true ellipses: what is left is that a foot point is sought with five steps.
    assert errors.max() < 1e-6
    # A file that does not name the model means OpenCV's, and of another model's numbers makes another image.
    old = write_estimates(tmp_path / "old.parquet", rows, drop=("distortion_model",))
    model = {run.cameras[0].distortion_model for run in read_runs([old], wide)} if "fisheye" in lens else {"opencv"}
    assert model == {"opencv"}


def test_rows_are_the_same_in_any_order(dataset: Dataset, tmp_path: Path) -> None:
    rows = estimate_rows(dataset, ["true", "scaled:0.7"], noise_px=0.1)
    shuffled = [rows[i] for i in np.random.default_rng(0).permutation(len(rows))]
    assert scored(dataset, tmp_path, rows).table.equals(scored(dataset, tmp_path, shuffled).table)


def test_a_lone_candidate_is_judged_by_the_two_solutions(dataset: Dataset, tmp_path: Path) -> None:
    both = estimate_rows(dataset, ["true"], chosen=True)
    lone = [{**r, "chosen": True} for r in both if r["candidate"] == 0]
    a = scored(dataset, tmp_path, both).table["branch_correct"].to_pylist()
    assert scored(dataset, tmp_path, lone).table["branch_correct"].to_pylist() == a


@pytest.mark.parametrize(
    ("change", "error", "sentence"),
    [
        ({"frame_id": 99}, NotComparableError, "frame 99, which"),
        ({"normal_x": float("nan")}, UsageError, "missing or not finite"),
        ({"centre_x_m": None}, UsageError, "missing or not finite"),
        ({"normal_x": 0.5}, UsageError, "not of unit length"),
        ({"centre_z_m": -1.0}, UsageError, "behind the camera"),
        ({"normal_x": 0.0, "normal_y": 0.0, "normal_z": 1.0}, UsageError, "points away"),
        ({"ellipse_b_px": 1e3}, UsageError, "a >= b > 0"),
        ({"fx_px": -3.0}, UsageError, "focal lengths"),
        ({"distortion": [0.1]}, UsageError, "1 coefficients; opencv takes 0, 4, 5, 8, 12, 14"),
        ({"distortion_model": "brown"}, UsageError, "distortion_model 'brown' is unknown"),
        ({"distortion_model": "fisheye", "distortion": [0.1] * 5}, UsageError, "5 coefficients; fisheye takes 4"),
        ({"distortion": [0.1, None, 0.0, 0.0]}, UsageError, "not finite"),
        ({"candidate": 2}, UsageError, "neither 0 nor 1"),
        ({"candidate": 1}, UsageError, "two rows for frame 0"),
        ({"detection_id": -1}, UsageError, "detection_id is negative"),
        ({"status": "fine"}, UsageError, "neither ok nor failed"),
        ({"status": "failed", "chosen": True}, UsageError, "chosen, but"),
        ({"method": None}, UsageError, "column method has empty values"),
    ],
)
def test_estimates_that_lie(
    dataset: Dataset, tmp_path: Path, change: dict[str, Any], error: type[RoundelError], sentence: str
) -> None:
    rows = estimate_rows(dataset, ["true"])
    rows[0] = {**rows[0], **change}
    with pytest.raises(error, match=sentence) as caught:
        scored(dataset, tmp_path, rows)
    assert "\n" not in str(caught.value)


def test_both_chosen_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="both candidates are chosen"):
        scored(dataset, tmp_path, [{**r, "chosen": True} for r in estimate_rows(dataset, ["true"])])


def test_files_that_are_no_estimates(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no estimates found"):
        read_runs([tmp_path / "nowhere"], dataset)
    broken = tmp_path / "broken.parquet"
    broken.write_bytes(b"PAR1 no")
    with pytest.raises(DataError, match="damaged or truncated Parquet file"):
        read_runs([broken], dataset)
    short = write_estimates(tmp_path / "short.parquet", estimate_rows(dataset, ["true"]), drop=("fx_px", "status"))
    with pytest.raises(UsageError, match="has no column fx_px"):
        read_runs([short], dataset)
    empty = write_estimates(tmp_path / "empty" / "estimates.parquet", [])
    with pytest.raises(NotComparableError, match="nothing to score"):
        read_runs([empty.parent], dataset)
    with pytest.raises(NotComparableError, match="no estimates given"):
        read_runs([], dataset)


def test_the_chessboard_as_reference(boards: Dataset, tmp_path: Path) -> None:
    targets = true_targets(boards, 3.0)
    views = look_for_boards(boards.images)
    reference = reference_of(boards, views, targets, None, "true")
    rows = reference.rows.to_pylist()
    assert len(rows) == 9
    assert all(r["solved"] and r["method"] == "chessboard_pnp" and r["kind"] == "chessboard" for r in rows)
    # Corners of 4 x 4 subpixels scatter by some 0.03 px over 100 px and more.
    assert max(r["oracle_normal_error_deg"] for r in rows) < 0.5
    assert max(r["oracle_position_error_pct"] for r in rows) < 0.2
    assert max(r["oracle_reprojection_error_px"] for r in rows) < 0.1
    runs = read_runs([write_estimates(tmp_path / "e.parquet", estimate_rows(boards, ["true", "default"]))], boards)
    table = score(boards, targets, runs, reference.circles).table
    assert [table["reference"].to_pylist().count(r) for r in ("truth", "chessboard")] == [8, 8]
    by_board = [r for r in table.to_pylist() if r["reference"] == "chessboard" and r["intrinsics"] == "true"]
    # The estimates are exact: what the board says of them is the board's own error, carried over to the disc.
    assert max(r["oracle_normal_error_deg"] for r in by_board) < 0.5
    assert max(r["contour_error_px"] for r in by_board) < 0.3
    assert {r["group"] for r in by_board} == {"marker"}


def test_a_frame_whose_board_was_not_found_has_no_reference(boards: Dataset, tmp_path: Path) -> None:
    targets = true_targets(boards, 3.0)
    views = look_for_boards(boards.images, "marker")
    blind = [vars(v) | ({"corners_px": None} if i == 0 else {}) for i, v in enumerate(views)]
    reference = reference_of(boards, [type(views[0])(**v) for v in blind], targets, None, "true")
    runs = read_runs([write_estimates(tmp_path / "e.parquet", estimate_rows(boards, ["true"]))], boards)
    rows = [
        r for r in score(boards, targets, runs, reference.circles).table.to_pylist() if r["reference"] == "chessboard"
    ]
    assert rows[0]["solved"]
    assert rows[0]["reason"] == "no reference: the chessboard was not found"
    assert rows[0]["oracle_normal_error_deg"] is None
    assert rows[1]["oracle_normal_error_deg"] is not None


def test_only_the_groups_of_the_study_are_expected(tmp_path: Path) -> None:
    text = POINTS.replace("solve: {", "groups:\n  a: {}\n  b: {}\nsolve: {groups: [a], ")
    two = make_dataset(tmp_path / "ds", text)
    rows = estimate_rows(two, ["true"])
    in_a = [r for r in rows if r["frame_id"] < 36]
    assert scored(two, tmp_path, in_a).table.num_rows == 36
    # One frame of b is enough to be measured by all of b.
    table = scored(two, tmp_path, [*in_a, *[r for r in rows if r["frame_id"] == 40]]).table
    assert table.num_rows == 72
    assert sum(table["solved"].to_pylist()) == 37


def test_scores_survive_the_disk(dataset: Dataset, tmp_path: Path) -> None:
    table = scored(dataset, tmp_path, estimate_rows(dataset, ["true"])).table
    pq.write_table(table, tmp_path / "scores.parquet")
    assert pq.read_table(tmp_path / "scores.parquet").equals(table)


LARGE = """\
schema: 1
name: large
mode: points
camera: {width_px: 4000, height_px: 3000, focal_px: 4000}
marker: {kind: disc, diameter_m: 0.08}
pose: {distance_D: 2.5, tilt_deg: 15}
frames: 1
"""


def test_a_poor_match_within_the_gate_is_better_than_none(tmp_path: Path) -> None:
    # The circle is 800 px large, so a contour 110 px off is within the gate; the other detection is far outside it.
    dataset = make_dataset(tmp_path / "ds", LARGE)
    near = [{**row, "ellipse_x_px": row["ellipse_x_px"] + 170.0} for row in estimate_rows(dataset, ["true"])]
    small = {"ellipse_x_px": 300.0, "ellipse_y_px": 300.0, "ellipse_a_px": 50.0, "ellipse_b_px": 45.0}
    far = [{**row, **small, "detection_id": 1} for row in near]
    found = scored(dataset, tmp_path, [*near, *far])
    assert found.table["solved"].to_pylist() == [True]
    assert 100 < found.table["contour_error_px"].to_pylist()[0] < 150
    assert [f.count for f in found.false_detections] == [1]
