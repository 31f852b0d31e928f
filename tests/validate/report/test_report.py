"""The report: its three files, their content, self-containedness and determinism."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_reports import BOARDS, POINTS, estimate_rows, failed_row, make_dataset, write_estimates

import roundel
from roundel.datasets.dataset import Dataset
from roundel.datasets.store.records import record_of_document
from roundel.datasets.store.writing import sha256
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.scenes.errors import NotComparableError, UsageError
from roundel.validate.calibration.camera_errors import calibrate_dataset, calibration_lines
from roundel.validate.scores.run_statistics import statistics
from roundel.validate.scores.summary import Summary, number, summary_record
from roundel.validate.scores.terminal_table import terminal_table
from roundel.validate.validate import validate_dataset

LABELS = ["scaled:0.7", "scaled:1", "scaled:1.3"]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    # Names are the users', and end up in HTML.
    text = POINTS.replace("name: points", "name: \"points <script>alert('x')</script>\"")
    return make_dataset(tmp_path_factory.mktemp("report") / "ds", text)


@pytest.fixture(scope="module")
def report(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Summary]:
    folder = tmp_path_factory.mktemp("out")
    rows = [r for r in estimate_rows(dataset, LABELS, noise_px=0.1) if r["frame_id"] != 5]
    rows += [failed_row(5, label) for label in LABELS]
    write_estimates(folder / "estimates" / "estimates.parquet", rows)
    return folder / "report", validate_dataset(dataset.path, [folder / "estimates"], folder / "report")


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Summary]:
    folder = tmp_path_factory.mktemp("boards")
    dataset = make_dataset(folder / "ds", BOARDS)
    calibrate_dataset(folder / "ds", folder / "phone.json", "calibration")
    write_estimates(folder / "e.parquet", estimate_rows(dataset, ["true", "default"], noise_px=0.1, chosen=True))
    out = folder / "report"
    return out, validate_dataset(folder / "ds", [folder / "e.parquet"], out, camera_path=folder / "phone.json")


class Page(HTMLParser):
    """Tags, attributes and text of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.ids: list[str] = []
        self.words: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        self.ids += [value for key, value in attrs if key == "id" and value]

    def handle_data(self, data: str) -> None:
        self.words.append(data)


@pytest.mark.parametrize("name", ["report", "boards"])
def test_the_page_stands_alone(name: str, request: pytest.FixtureRequest) -> None:
    folder, _ = request.getfixturevalue(name)
    html = (folder / "report.html").read_text()
    page = Page(html)
    assert "script" not in page.tags
    assert "link" not in page.tags
    assert "iframe" not in page.tags
    assert not [key for key, _ in page.attributes if key.startswith("on")]
    links = [value or "" for key, value in page.attributes if key in ("href", "src", "xlink:href", "action")]
    assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)
    inner = {link[1:] for link in links if link.startswith("#")}
    assert inner <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))
    assert "@import" not in html
    assert "url(http" not in html
    policy = [
        value or "" for key, value in page.attributes if key == "content" and "default-src 'none'" in (value or "")
    ]
    assert len(policy) == 1
    assert "script" not in policy[0]
    assert "prefers-color-scheme: dark" in html
    assert "@media print" in html
    # A report is to be mailed.
    assert len(html) < 1_000_000


def test_names_are_escaped(report: tuple[Path, Summary]) -> None:
    html = (report[0] / "report.html").read_text()
    assert "points &lt;script&gt;alert" in html


def test_no_path_and_no_date(report: tuple[Path, Summary], dataset: Dataset) -> None:
    for name in ("report.html", "summary.json"):
        text = (report[0] / name).read_text()
        assert str(report[0].parent) not in text
        assert str(dataset.path.parent) not in text
    assert not re.search(r"20\d\d-\d\d-\d\d", (report[0] / "summary.json").read_text())


def test_scores_and_estimates_are_one_call_away(report: tuple[Path, Summary]) -> None:
    scores = roundel.read_scores(report[0])
    assert scores.equals(pq.read_table(report[0] / "scores.parquet"))
    estimates = roundel.read_estimates(report[0].parent / "estimates")
    assert set(estimates["intrinsics"].to_pylist()) == set(LABELS)


def test_the_same_input_gives_the_same_files(report: tuple[Path, Summary], dataset: Dataset, tmp_path: Path) -> None:
    validate_dataset(dataset.path, [report[0].parent / "estimates"], tmp_path / "again")
    for name in ("report.html", "summary.json", "scores.parquet", "false_positives.parquet"):
        assert (tmp_path / "again" / name).read_bytes() == (report[0] / name).read_bytes()
    inside = ["false_positives.parquet", "figures", "report.html", "scores.parquet", "summary.json", "tables"]
    assert sorted(p.name for p in (tmp_path / "again").iterdir()) == inside
    for folder in ("tables", "figures"):
        made = sorted((report[0] / folder).iterdir())
        assert made
        assert [p.name for p in made] == sorted(p.name for p in (tmp_path / "again" / folder).iterdir())
        for one in made:
            assert (tmp_path / "again" / folder / one.name).read_bytes() == one.read_bytes()


def test_the_summary_agrees_with_the_scores(report: tuple[Path, Summary]) -> None:
    folder, summary = report
    assert record_of_document((folder / "summary.json").read_bytes()) == summary_record(summary)
    assert summary.checksums["scores.parquet"] == sha256((folder / "scores.parquet").read_bytes())
    table = pq.read_table(folder / "scores.parquet")
    run = next(r for r in summary.runs if r["intrinsics"] == "scaled:0.7")
    mask = np.array(table["intrinsics"].to_pylist()) == "scaled:0.7"
    values = table["oracle_normal_error_deg"].to_numpy()[mask]
    values = values[np.isfinite(values)]
    assert (run["n"], run["solved"], run["false_detections"]) == (36, 35, 0)
    assert run["oracle"]["normal_error_deg"]["rms"] == pytest.approx(np.sqrt((values**2).mean()))
    assert run["oracle"]["normal_error_deg"]["p95"] == pytest.approx(np.percentile(values, 95))
    nothing = {"n": 0, "mean": None, "median": None, "p95": None, "rms": None}
    assert nothing.items() <= run["chosen"]["normal_error_deg"].items()
    assert len(summary.cells) == 27
    assert sum(c["n"] for c in summary.cells) == table.num_rows
    assert {(f["reason"], f["count"]) for f in summary.failures} == {("no circle found", 1)}
    assert summary.dataset["circles"] == 36


def test_the_page_says_it_in_words(report: tuple[Path, Summary]) -> None:
    words = " ".join(Page((report[0] / "report.html").read_text()).words)
    assert "Method ml found 35 of 36 circles" in words
    assert "none was chosen" in words
    assert "roundel solve DATASET ESTIMATES --method ml --intrinsics scaled:0.7" in words
    assert "no circle found" in words


def test_chessboards_in_the_report(boards: tuple[Path, Summary]) -> None:
    folder, summary = boards
    calibration = summary.calibration
    assert calibration["views"] == 5
    assert calibration["rms_px"] < 0.05
    assert abs(calibration["corner_offset_mean_x_px"]) < 0.02
    assert abs(calibration["fx_error_pct"]) < 0.1  # five views of 8 x 8 subpixels; measured 0.014
    keys = [(r["method"], r["intrinsics"], r["reference"]) for r in summary.runs]
    assert keys == [
        ("ml", "true", "truth"),
        ("ml", "default", "truth"),
        ("ml", "true", "chessboard"),
        ("ml", "default", "chessboard"),
        ("chessboard_pnp", "calibrated:phone", "truth"),
    ]
    words = " ".join(Page((folder / "report.html").read_text()).words)
    assert "OpenCV calibrated the camera from 5 chessboard views" in words
    assert "roundel calibrate DATASET phone.json" in words
    assert "--camera phone.json" in words


def test_a_camera_file_holds_no_truth(boards: tuple[Path, Summary]) -> None:
    record = json.loads((boards[0].parent / "phone.json").read_text())
    assert record["calibration"]["group"] == "calibration"
    assert "error" not in json.dumps(record)
    assert "offset" not in json.dumps(record)


def test_calibration_lines() -> None:
    assert calibration_lines({"reason": "found in 2 views"}) == ["calibration: found in 2 views"]


def test_the_terminal_table(boards: tuple[Path, Summary]) -> None:
    lines = terminal_table(boards[1]).splitlines()
    assert lines[0].split()[:4] == ["method", "intrinsics", "reference", "solved"]
    assert len(lines) == 7
    assert lines[1].startswith("ml")
    assert " 4/4 " in lines[1]
    assert all(len(line) <= 120 for line in lines)


def test_refusals(dataset: Dataset, tmp_path: Path) -> None:
    file = write_estimates(tmp_path / "e.parquet", estimate_rows(dataset, ["true"]))
    with pytest.raises(UsageError, match="positive number of diameters"):
        validate_dataset(dataset.path, [file], tmp_path / "out", extent_D=0.0)
    with pytest.raises(UsageError, match="is a file"):
        validate_dataset(dataset.path, [file], file)
    with pytest.raises(UsageError, match="no such camera file"):
        validate_dataset(dataset.path, [file], tmp_path / "out", camera_path=tmp_path / "none.json")
    with pytest.raises(NotComparableError, match="no estimates given"):
        validate_dataset(dataset.path, [], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_nothing_solved_is_a_report_too(dataset: Dataset, tmp_path: Path) -> None:
    rows = [failed_row(frame, "true") for frame in dataset.images.frame_ids]
    file = write_estimates(tmp_path / "e.parquet", rows)
    summary = validate_dataset(dataset.path, [file], tmp_path / "out")
    assert summary.runs[0]["solved"] == 0
    assert "found 0 of 36" in (tmp_path / "out" / "report.html").read_text()
    assert "0/36" in terminal_table(summary)


def test_intrinsics_are_shown_best_known_first() -> None:
    labels = ["scaled:1.3", "default", "true", "scaled:0.85", "exif", "calibrated:a", "other"]
    assert sorted(labels, key=lambda label: IntrinsicsLabel.of(label).rank) == [
        "true", "calibrated:a", "exif", "default", "scaled:0.85", "scaled:1.3", "other"]  # fmt: skip


def test_numbers_for_people() -> None:
    assert [number(v) for v in (2e-7, 0.0123456, 1.5, 30.0, 12345.0, 3.05e9, 0.0, None, float("nan"))] == [
        "2.0e-07", "0.0123", "1.50", "30.0", "12,345", "3.0e+09", "0", "-", "-"]  # fmt: skip
    assert statistics(np.array([-1.0, 1.0]))["p95"] == 1.0
