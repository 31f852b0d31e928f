"""Statistics of runs: intervals, recall with its misses, errors relative to bounds, and comparison of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from helpers_reports import POINTS, estimate_rows, failed_row, make_dataset, write_estimates

from roundel.datasets.dataset import Dataset
from roundel.validate.estimates.runs import read_runs
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.scores.comparisons import comparisons, power_of
from roundel.validate.scores.run_statistics import RECALLS, recalls, statistics, statistics_of
from roundel.validate.scores.scores import Scores, score
from roundel.validate.scores.summary import Summary, main_key, summarise

TWO = POINTS.replace("frames_per_cell: 4", "frames_per_cell: 8")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("points") / "ds", TWO)


def scored(dataset: Dataset, folder: Path, rows: list[dict[str, Any]]) -> Scores:
    return score(dataset, true_targets(dataset, 3.0), read_runs([write_estimates(folder / "e.parquet", rows)], dataset))


def summary_of(dataset: Dataset, scores: Scores) -> Summary:
    return summarise(dataset, scores, {"reprojection_extent_D": 3.0}, 36, None)


def test_statistics_with_intervals() -> None:
    values = np.abs(np.random.default_rng(0).normal(size=400))
    found = statistics(values, np.arange(400))
    for name in ("median", "p95", "rms"):
        assert found[f"{name}_low"] < found[name] < found[f"{name}_high"]
        assert found["interval"][name] == "BCa"
    # The median of |normal| is 0.674, its RMS 1, its 95th percentile 1.96: these 400 hold them.
    assert found["median_low"] < 0.674 < found["median_high"]
    assert found["rms_low"] < 1.0 < found["rms_high"]
    few = statistics(values[:15], np.arange(15))
    assert few["median_low"] is not None
    assert (few["rms_low"], few["interval"]["rms"]) == (None, "fewer than 20 frames")
    # Each value thrice in one frame: no more is known than before.
    thrice = statistics(np.repeat(values, 3), np.repeat(np.arange(400), 3))
    assert thrice["rms_high"] - thrice["rms_low"] == pytest.approx(found["rms_high"] - found["rms_low"], rel=1e-6)
    assert thrice["median_high"] - thrice["median_low"] == pytest.approx(
        found["median_high"] - found["median_low"], rel=0.1
    )
    assert statistics_of([]) == {}
    assert statistics(np.array([np.nan]), np.arange(1))["interval"]["rms"] == "no samples"


def test_a_miss_is_never_dropped(dataset: Dataset, tmp_path: Path) -> None:
    rows = [r for r in estimate_rows(dataset, ["true"]) if r["frame_id"] >= 18]
    run = summary_of(dataset, scored(dataset, tmp_path, [*rows, failed_row(3, "true")])).runs[0]
    assert (run["n"], run["solved"]) == (72, 54)
    assert run["solved_interval"]["rate"] == 0.75
    assert run["solved_interval"]["low"] < 0.75 < run["solved_interval"]["high"]
    for family in RECALLS:
        found = run["recall"]["oracle"][family.metric.name]
        # Perfect where found, and a miss in every fourth circle, at every threshold.
        assert [level["rate"] for level in found["levels"]] == [0.75] * len(family.thresholds)
        assert found["levels"][0]["n"] == 72
        assert found["average"]["value"] == 0.75
    assert run["recall"]["oracle"]["average_recall"]["value"] == 0.75
    assert run["recall"]["chosen"] is None
    assert run["branch_interval"]["rate"] is None


def test_chosen_oracle_and_branch_are_told_apart(dataset: Dataset, tmp_path: Path) -> None:
    run = summary_of(dataset, scored(dataset, tmp_path, estimate_rows(dataset, ["true"], chosen=True))).runs[0]
    right = run["branch_correct"] / run["branch_chosen"]
    assert 0 < right < 1
    assert run["branch_interval"]["rate"] == right
    # The wrong candidate is tens of degrees away, and its position hardly at all.
    assert run["recall"]["chosen"]["normal"]["levels"][-1]["rate"] == pytest.approx(right)
    assert run["recall"]["oracle"]["normal"]["levels"][0]["rate"] == 1.0
    assert run["oracle"]["mssd_m"]["rms"] < 1e-9 < run["chosen"]["mssd_m"]["rms"]


def test_thresholds_are_those_of_bop() -> None:
    n = 40
    table = pa.table(
        {
            "frame_id": np.arange(n),
            "solved": [True] * n,
            "distance_m": np.full(n, 1.0),
            "distance_D": np.full(n, 10.0),
            **{
                f"{prefix}{name}": np.full(n, value)
                for prefix in ("", "oracle_")
                for name, value in (
                    ("normal_error_deg", 0.5),
                    ("position_error_pct", 1.5),
                    ("mssd_m", 0.0225),
                    ("mspd_px", 24.0),
                )
            },
        }
    )
    found = recalls(table, np.full(n, 1280.0))["chosen"]
    # Below, not at: 0.5 deg is a miss at 0.5.
    assert [level["rate"] for level in found["normal"]["levels"]] == [0, 0, 1, 1, 1]
    assert [level["rate"] for level in found["position"]["levels"]] == [0, 0, 0, 1, 1]
    # 22.5 % of a diameter of 0.1 m; 24 px of 1,280 are 12 of 640.
    assert found["mssd"]["average"]["value"] == pytest.approx(0.6)
    assert found["mspd"]["average"]["value"] == pytest.approx(0.8)
    assert found["average_recall"]["value"] == pytest.approx(0.7)


def test_an_efficient_method_has_ratios_of_one(dataset: Dataset, tmp_path: Path) -> None:
    run = summary_of(dataset, scored(dataset, tmp_path, estimate_rows(dataset, ["true"]))).runs[0]
    assert set(run["efficiency"]) == {"normal", "position", "ellipse_centre"}
    assert all(v["n"] == 72 and v["median"] < 1e-4 for v in run["efficiency"].values())


def test_runs_are_compared_on_the_same_circles(dataset: Dataset, tmp_path: Path) -> None:
    # All are Roundel's, so that none leads but the first by name.
    rows = estimate_rows(dataset, ["true", "scaled:0.7"], noise_px=0.3)
    rows += estimate_rows(dataset, ["true"], noise_px=0.3, method="szpak2015")
    rows += [r for r in estimate_rows(dataset, ["true"], noise_px=0.6, method="wu2004") if r["frame_id"] > 5]
    summary = summary_of(dataset, scored(dataset, tmp_path, rows))
    found = {(c["method"], c["intrinsics"], c["metric"]): c for c in summary.comparisons}
    assert ("ml", "true", "oracle_normal_error_deg") not in found
    focal = found["ml", "scaled:0.7", "oracle_position_error_pct"]
    assert focal["verdict"] == "larger"
    assert focal["low"] < focal["ratio"] < focal["high"]
    assert focal["p_value"] <= focal["p_holm"]
    twin = found["szpak2015", "true", "oracle_normal_error_deg"]
    assert (twin["verdict"], twin["ratio"], twin["low"]) == ("same", 1.0, None)
    worse = found["wu2004", "true", "ellipse_centre_error_px"]
    assert worse["n"] == 66
    assert worse["ratio"] == pytest.approx(2.0, rel=0.3)
    assert worse["verdict"] == "larger"
    power = {(p["method"], p["intrinsics"], p["error"]): p for p in summary.power}
    one = power["ml", "true", "normal"]
    assert one["over_bound"]
    # 72 normal errors: sqrt(2) (2.33 + 1.64) / (2 sqrt(72)) or so in the logarithm, for two degrees of freedom each.
    assert 0.2 < one["change"] < 1.5


def test_few_frames_and_no_error_are_said(dataset: Dataset, tmp_path: Path) -> None:
    rows = [r for r in estimate_rows(dataset, ["true"]) if r["frame_id"] < 5]
    rows += [r for r in estimate_rows(dataset, ["true"], noise_px=0.1, method="other") if r["frame_id"] < 5]
    table = scored(dataset, tmp_path, rows).table
    names = table["method"].to_pylist()
    tables = {(m, "true", "truth"): table.filter(pa.array([n == m for n in names])) for m in ("ml", "other")}
    few = comparisons(tables, ("ml", "true", "truth"))
    assert all(c["low"] is None and c["verdict"] == "undecided" for c in few)
    assert all(p["change"] is None for p in power_of(tables))
    unlike = {("ml", "true", "truth"): tables["ml", "true", "truth"], ("x", "y", "chessboard"): table}
    assert comparisons(unlike, ("ml", "true", "truth")) == []
    none = table.slice(0, 0)
    assert comparisons({("ml", "true", "truth"): table, ("b", "true", "truth"): none}, ("ml", "true", "truth")) == []
    assert power_of({("b", "true", "truth"): none}) == []


def test_the_leading_run_is_the_study_s_first() -> None:
    keys = [("b", "scaled:0.7", "truth"), ("a", "true", "truth"), ("b", "true", "truth"), ("b", "true", "chessboard")]
    assert main_key(keys, ["b"]) == ("b", "true", "truth")
    assert main_key(keys, []) == ("a", "true", "truth")
    assert main_key([("chessboard_pnp", "true", "truth")], []) is None


def test_fidelity_of_an_older_version_is_no_error(dataset: Dataset, tmp_path: Path) -> None:
    scores = scored(dataset, tmp_path, estimate_rows(dataset, ["true"]))
    dataset.manifest["fidelity"] = {"circles": 3, "shift_x_px": {"mean": 0.0}}
    found = summary_of(dataset, scores).dataset["fidelity"]
    assert found["circles"] == 0
    assert "older version" in found["reason"]
    whole = dict.fromkeys(
        ("shift_x_px", "shift_y_px", "scale_px", "residual", "monte_carlo", "z_rms", "z_passed", "z_consistent"), 1.0
    )
    dataset.manifest["fidelity"] = {"circles": 3, **whole, "by_effect": {"none": whole}}
    assert summary_of(dataset, scores).dataset["fidelity"] == dataset.manifest["fidelity"]
