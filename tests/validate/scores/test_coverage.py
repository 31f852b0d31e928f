"""Coverage of stated regions in scores, summary and report: covariances that hold, and those that do not."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from helpers_reports import POINTS, SIGMA, estimate_rows, make_dataset, stated_rows, write_estimates
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from roundel.datasets.dataset import Dataset
from roundel.validate.scores.comparisons import stated_difference
from roundel.validate.scores.scores import UNCERTAINTY
from roundel.validate.scores.stated_uncertainty import (
    COVERAGE_LEVELS,
    HOLDS,
    NARROW,
    OPEN,
    WIDE,
    coverage,
    region_text,
    region_verdict,
    reliability,
)
from roundel.validate.scores.summary import Summary
from roundel.validate.scores.terminal_table import terminal_table
from roundel.validate.validate import validate_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    text = POINTS.replace("frames_per_cell: 4", "frames_per_cell: 30")
    return make_dataset(tmp_path_factory.mktemp("coverage") / "ds", text)


@pytest.fixture(scope="module")
def report(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Summary]:
    folder = tmp_path_factory.mktemp("report")
    runs = {"honest": 1.0, "bold": 0.25, "shy": 4.0, "mad": 1e-12}
    rows = [row for name, factor in runs.items() for row in stated_rows(dataset, factor, name)]
    rows += estimate_rows(dataset, ["true"], method="silent")
    file = write_estimates(folder / "e.parquet", rows)
    return folder / "report", validate_dataset(dataset.path, [file], folder / "report")


def test_coverage_tells_honest_from_bold_and_shy(report: tuple[Path, Summary]) -> None:
    found = {run["method"]: run["coverage"]["oracle"] for run in report[1].runs}
    assert found["silent"] is None
    assert [entry["level"] for entry in found["honest"]["levels"]] == list(COVERAGE_LEVELS)
    for entry in found["honest"]["levels"]:
        # Wilson's interval of 270 frames holds the level, but for one time in twenty; the seed is fixed.
        assert entry["low"] <= entry["level"] <= entry["high"]
    at_95 = {name: share["levels"][2] for name, share in found.items() if share}
    assert at_95["bold"]["high"] < 0.8
    assert at_95["shy"]["rate"] == 1.0
    assert at_95["mad"]["rate"] == 0.0
    verdicts = {name: share["verdict"] for name, share in found.items() if share}
    assert verdicts == {"honest": HOLDS, "bold": NARROW, "shy": WIDE, "mad": NARROW}
    assert found["honest"]["median_chi2"] == pytest.approx(4.35, abs=0.7)
    assert min(found, key=lambda name: found[name]["log_score"] if found[name] else np.inf) == "honest"
    assert sum(found["bold"]["percentiles"]) == found["bold"]["n"] == 270


def test_the_columns_and_the_page(report: tuple[Path, Summary]) -> None:
    folder = report[0]
    table = pq.read_table(folder / "scores.parquet")
    for name in UNCERTAINTY:
        for prefix in ("", "oracle_"):
            values = table[f"{prefix}{name}"].to_pylist()
            assert all((v is None) == (m == "silent") for v, m in zip(values, table["method"].to_pylist(), strict=True))
    rows = {row["method"]: row for row in table.to_pylist() if row["frame_id"] == 0}
    assert rows["shy"]["oracle_normal_sigma_deg"] == pytest.approx(np.degrees(2 * SIGMA[3] * np.sqrt(2)), rel=1e-6)
    assert rows["shy"]["oracle_position_sigma_m"] == pytest.approx(2 * np.linalg.norm(SIGMA[:3]), rel=1e-6)
    page = (folder / "report.html").read_text()
    assert "Is the stated uncertainty right?" in page
    assert 'id="figure-uncertainty"' in page
    assert (folder / "tables" / "uncertainty.csv").read_text().count("\n") == 5


def test_the_verdict_is_in_the_report_and_on_the_terminal(report: tuple[Path, Summary]) -> None:
    folder, summary = report
    page = (folder / "report.html").read_text()
    lines = terminal_table(summary).splitlines()
    at = lines.index("95 % regions hold the truth (90 to 98 % asked for):")
    assert [line.split(";")[0].strip() for line in lines[at + 1 :]] == [
        "bold, true: too narrow", "honest, true: holds", "mad, true: too narrow", "shy, true: too wide",
    ]  # fmt: skip
    for outcome, run in ((NARROW, "bold"), (HOLDS, "honest"), (NARROW, "mad"), (WIDE, "shy")):
        assert re.search(rf">{outcome}</strong> {run}, true <span", page)
    assert "Do its 95 % regions hold the truth? No, they are too narrow: they hold the truth of" in page


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (0.90, 0.98, HOLDS),
        (0.92, 0.96, HOLDS),
        (0.89, 0.96, OPEN),
        (0.92, 0.99, OPEN),
        (0.80, 0.99, OPEN),
        (0.85, 0.899, NARROW),
        (0.88, 0.90, OPEN),
        (0.981, 1.0, WIDE),
        (0.98, 1.0, OPEN),
        (None, None, OPEN),
    ],
)
def test_the_whole_interval_decides(low: float | None, high: float | None, verdict: str) -> None:
    assert region_verdict({"rate": 0.95, "low": low, "high": high}) == verdict


def test_a_single_pose_has_a_share_and_an_interval(report: tuple[Path, Summary]) -> None:
    whole = pq.read_table(report[0] / "scores.parquet")
    one = coverage(whole.filter(pc.equal(whole["method"], "mad")).slice(0, 1), "oracle_")
    assert one is not None
    # Wilson's interval of none of one.
    assert region_text(one) == "they hold the truth of 0.0 % [0.0, 79.3] of 1 pose"
    assert one["verdict"] == NARROW


def test_a_report_without_covariances_has_no_such_section(dataset: Dataset, tmp_path: Path) -> None:
    file = write_estimates(tmp_path / "e.parquet", estimate_rows(dataset, ["true"], method="silent"))
    validate_dataset(dataset.path, [file], tmp_path / "report")
    assert "Is the stated uncertainty right?" not in (tmp_path / "report" / "report.html").read_text()
    assert not (tmp_path / "report" / "tables" / "uncertainty.csv").exists()


def test_probabilities_of_candidates_are_scored(dataset: Dataset, tmp_path: Path) -> None:
    nearer = {}
    truth = {row["frame_id"]: np.array([row[f"normal_{a}"] for a in "xyz"]) for row in dataset.truth.to_pylist()}
    rows = []
    for method, stated, right in (("honest", 0.8, 0.8), ("swapped", 0.8, 0.2), ("silent", 0.5, 1.0)):
        rng = np.random.default_rng(3)
        pairs = estimate_rows(dataset, ["true"], noise_px=0.02, method=method)
        for first, second in zip(pairs[::2], pairs[1::2], strict=True):
            off = [
                np.linalg.norm([row[f"normal_{a}"] for a in "xyz"] - truth[row["frame_id"]]) for row in (first, second)
            ]
            good, bad = (first, second) if off[0] <= off[1] else (second, first)
            likely = rng.random() < right
            good["probability"], bad["probability"] = (stated, 1 - stated) if likely else (1 - stated, stated)
            nearer[method] = nearer.get(method, 0) + likely
        rows += pairs
    file = write_estimates(tmp_path / "e.parquet", rows)
    summary = validate_dataset(dataset.path, [file], tmp_path / "report")
    found = {run["method"]: run["choice"] for run in summary.runs}
    assert found["silent"] is None
    for method in ("honest", "swapped"):
        assert found[method]["n"] == len(dataset)
        assert found[method]["stated"] == pytest.approx(0.8)
        assert found[method]["right"]["rate"] == pytest.approx(nearer[method] / len(dataset))
    assert found["honest"]["right"]["low"] < 0.8 < found["honest"]["right"]["high"]
    assert found["honest"]["log_score"] < np.log(2) < found["swapped"]["log_score"]
    table = (tmp_path / "report" / "tables" / "probabilities.csv").read_text().splitlines()
    assert [line.split(",")[:2] for line in table[1:]] == [["which candidate", m] for m in ("honest", "swapped")]
    page = (tmp_path / "report" / "report.html").read_text()
    assert "Stated probabilities" in page
    assert 'id="figure-reliability"' in page
    assert (tmp_path / "report" / "figures" / "reliability.svg").read_text().count("share right") == 1


def test_the_worst_stated_circles_come_first(report: tuple[Path, Summary]) -> None:
    folder = report[0]
    scores = {
        (r["method"], r["frame_id"]): r for r in pq.read_table(folder / "scores.parquet").to_pylist() if r["solved"]
    }
    rows = list(csv.DictReader((folder / "tables" / "worst_stated.csv").read_text().splitlines()))
    assert [row["method"] for row in rows] == [m for m in ("bold", "honest", "mad", "shy") for _ in range(3)]
    for method in ("bold", "honest", "mad", "shy"):
        largest = sorted((r["oracle_pose_chi2"] for (m, _), r in scores.items() if m == method), reverse=True)[:3]
        mine = [row for row in rows if row["method"] == method]
        assert [float(row["pose_chi2"]) for row in mine] == largest
        for row in mine:
            its = scores[method, int(row["frame_id"])]
            assert float(row["normal_in_sigma"]) == its["oracle_normal_error_deg"] / its["oracle_normal_sigma_deg"]
            assert float(row["depth_in_sigma"]) == its["oracle_along_ray_m"] / its["oracle_depth_sigma_m"]
            assert float(row["p"]) == pytest.approx(stats.chi2.sf(float(row["pose_chi2"]), 5), rel=1e-12)
    page = (folder / "report.html").read_text()
    section = page[page.index('<section id="uncertainty">') :].partition("</section>")[0]
    # The pictures of four methods.
    assert section.count("<details") == 12
    assert section.count("Chi-square ") >= 12


def test_two_runs_are_compared_in_what_they_state(report: tuple[Path, Summary]) -> None:
    rows = list(csv.DictReader((report[0] / "tables" / "stated_pairs.csv").read_text().splitlines()))
    found = {row["second"]: row for row in rows}
    assert {row["first"] for row in rows} == {"bold"}
    # The same poses, of which one states the covariance that they were drawn from.
    assert found["honest"]["better"] == "honest"
    assert float(found["honest"]["log_score_high"]) < 0
    assert (found["honest"]["first_verdict"], found["honest"]["second_verdict"]) == (NARROW, HOLDS)
    assert found["mad"]["better"] == "bold"
    assert found["mad"]["second_within_95_pct"] == "0.0"


def shifted(scores: pa.Table, by: NDArray[np.float64]) -> pa.Table:
    name = "oracle_pose_log_score"
    values = scores[name].to_numpy(zero_copy_only=False) + by
    return scores.set_column(scores.column_names.index(name), name, pa.array(values, mask=np.isnan(values)))


def test_the_difference_of_log_scores_is_the_paired_t_test(report: tuple[Path, Summary]) -> None:
    whole = pq.read_table(report[0] / "scores.parquet")
    one = whole.filter(pc.equal(whole["method"], "honest"))
    by = np.random.default_rng(2).normal(0.05, 1.0, one.num_rows)
    found = stated_difference(one, shifted(one, by))
    assert found is not None
    test = stats.ttest_1samp(by, 0.0)
    assert found["difference"] == pytest.approx(by.mean(), abs=1e-12)
    assert found["p_value"] == pytest.approx(test.pvalue, rel=1e-9)
    assert [found["low"], found["high"]] == pytest.approx(list(test.confidence_interval(0.95)), rel=1e-9)
    assert not found["same"]
    same = stated_difference(one, one)
    assert same is not None
    assert (same["difference"], same["p_value"], same["same"]) == (0.0, 1.0, True)


@pytest.mark.parametrize("lacking", ["column", "values", "frames"])
def test_without_stated_covariances_nothing_is_compared(report: tuple[Path, Summary], lacking: str) -> None:
    whole = pq.read_table(report[0] / "scores.parquet")
    one = whole.filter(pc.equal(whole["method"], "honest"))
    other = whole.filter(pc.equal(whole["method"], "silent"))
    if lacking == "column":
        other = one.drop_columns(["oracle_pose_log_score"])
    if lacking == "frames":
        one = other = one.slice(0, 1)
    assert stated_difference(one, other) is None


@given(st.integers(0, 10_000), st.integers(1, 400))
def test_reliability_is_counted_and_scored_as_by_hand(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    # Few distinct probabilities, some on the edges of bins.
    stated = rng.choice([0.0, 0.05, 0.5, 0.62, 0.9, 0.95, 1.0], n)
    right = rng.random(n) < stated
    found = reliability(stated, right, np.arange(n), (0.0, 0.5, 0.9, 1.01))
    assert found is not None
    assert found["brier"] == pytest.approx(np.mean((stated - right) ** 2), abs=1e-12)
    assert found["brier_constant"] == pytest.approx(np.var(right), abs=1e-12)
    assert sum(b["n"] for b in found["bins"]) == found["n"] == n
    for b, (low, high) in zip(
        found["bins"],
        [e for e in ((0.0, 0.5), (0.5, 0.9), (0.9, 1.01)) if np.any((stated >= e[0]) & (stated < e[1]))],
        strict=True,
    ):
        here = (stated >= low) & (stated < high)
        assert b["rate"] == pytest.approx(right[here].mean(), abs=1e-12)
        assert b["stated"] == pytest.approx(stated[here].mean(), abs=1e-12)
        interval = stats.binomtest(int(right[here].sum()), int(here.sum())).proportion_ci(method="wilson")
        # Ends are rounded to nine digits, and at a rate of 0 or 1 they are that rate.
        assert [b["low"], b["high"]] == pytest.approx([interval.low, interval.high], abs=1e-8)


def test_no_statements_have_no_reliability() -> None:
    nothing = np.zeros(0)
    assert reliability(nothing, nothing > 0, nothing.astype(np.int64), (0.0, 1.01)) is None


def test_confidences_of_right_and_wrong_detections_are_scored(dataset: Dataset, tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    rows: list[dict[str, Any]] = []
    right, stated = [], []
    for row in estimate_rows(dataset, ["true"], method="detector", chosen=True):
        if row["candidate"] == 1:
            continue
        rows.append({**row, "confidence": float(rng.choice([0.97, 0.8, 0.3]))})
        right.append(True)
        if rng.random() < 0.4:
            # A detection far from the marker, more often unsure than not.
            false = {**row, "detection_id": 7, "ellipse_x_px": row["ellipse_x_px"] + 300}
            rows.append({**false, "confidence": float(rng.choice([0.97, 0.3, 0.3, 0.3]))})
            right.append(False)
        stated += [r["confidence"] for r in rows[len(stated) :]]
    rows += estimate_rows(dataset, ["true"], method="silent")
    file = write_estimates(tmp_path / "e.parquet", rows)
    summary = validate_dataset(dataset.path, [file], tmp_path / "report")
    found = {run["method"]: run["confidence"] for run in summary.runs}
    assert found["silent"] is None
    mine = found["detector"]
    assert mine["n"] == len(right)
    assert mine["right"]["rate"] == pytest.approx(np.mean(right))
    assert mine["brier"] == pytest.approx(np.mean((np.array(stated) - right) ** 2))
    assert [round(b["stated"], 2) for b in mine["bins"]] == [0.3, 0.8, 0.97]
    assert [b["rate"] for b in mine["bins"]] == pytest.approx(
        [np.mean(np.array(right)[np.array(stated) == value]) for value in (0.3, 0.8, 0.97)]
    )
    page = (tmp_path / "report" / "report.html").read_text()
    assert "is it a marker" in page
    assert 'id="figure-confidence"' in page
    # All groups together: the same false positives, group by group.
    assert len((tmp_path / "report" / "tables" / "probability_bins.csv").read_text().splitlines()) == 4
