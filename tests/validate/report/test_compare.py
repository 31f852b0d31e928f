"""Several reports in one, and several methods in one report: compared in pairs only for shared frames."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_reports import POINTS, estimate_rows, failed_row, make_dataset, stated_rows, write_estimates

from roundel.cli.main import main
from roundel.datasets.dataset import open_dataset
from roundel.datasets.store.records import document_of
from roundel.scenes.errors import DataError, NotComparableError, UsageError
from roundel.validate.report.compare import compare_reports, labels_of
from roundel.validate.validate import validate_dataset

LARGER = POINTS.replace("frames_per_cell: 4", "frames_per_cell: 8")


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Reports of one dataset (good, bad: three times the noise) and one of another."""
    folder = tmp_path_factory.mktemp("house")
    dataset = make_dataset(folder / "ds", LARGER)
    rows = {"good": estimate_rows(dataset, ["true"], 0.1), "bad": estimate_rows(dataset, ["true"], 0.3)}
    for name, mine in rows.items():
        file = write_estimates(folder / f"{name}.parquet", mine)
        validate_dataset(dataset.path, [file], folder / name)
    other = make_dataset(folder / "ds2", POINTS.replace("seed: 4", "seed: 5"))
    validate_dataset(other.path, [write_estimates(folder / "o.parquet", estimate_rows(other, ["true"], 0.1))],
                     folder / "other")  # fmt: skip
    return folder


def rows_of(folder: Path, name: str) -> list[dict[str, Any]]:
    return list(csv.DictReader((folder / "tables" / f"{name}.csv").read_text().splitlines()))


def test_one_dataset_is_compared_frame_by_frame(house: Path, tmp_path: Path) -> None:
    said = compare_reports([house / "good", house / "bad"], tmp_path)
    assert said[0] == "2 reports are of one dataset, the same images: they are compared frame by frame."
    rows = rows_of(tmp_path, "comparisons")
    assert [row["error"].split()[0] for row in rows] == ["normal", "position", "reprojection"]
    # The same draws, three times as large: errors of first order in them are, too.
    assert all(2.5 < float(row["ratio_rms"]) < 3.5 and int(row["frames"]) == 72 for row in rows)
    assert {row["better"] for row in rows} == {"good: ml, true"}
    assert {row["better"] for row in rows_of(tmp_path, "solved_by_one")} == {"no difference shown"}
    html = (tmp_path / "compare.html").read_text()
    assert "good and bad" in html
    assert str(house) not in html


def test_of_two_methods_the_one_that_states_its_errors_better_is_named(house: Path, tmp_path: Path) -> None:
    dataset = open_dataset(house / "ds")
    for name, factor in (("honest", 1.0), ("bold", 0.1)):
        file = write_estimates(tmp_path / f"{name}.parquet", stated_rows(dataset, factor))
        validate_dataset(dataset.path, [file], tmp_path / name)
    said = compare_reports([tmp_path / "bold", tmp_path / "honest"], tmp_path / "out")
    (row,) = rows_of(tmp_path / "out", "stated_pairs")
    assert row["better"] == "honest: ml, true"
    assert (row["poses"], row["first_verdict"]) == ("72", "too narrow")
    assert float(row["log_score_low"]) < float(row["log_score_difference"]) < float(row["log_score_high"]) < 0
    assert float(row["p_holm"]) < 1e-6
    # The errors are the same.
    assert {row["better"] for row in rows_of(tmp_path / "out", "comparisons")} == {"identical"}
    (sentence,) = [line for line in said if line.startswith("Stated uncertainty")]
    assert "true intrinsics: honest: ml, true has the better log score (second minus first: \N{MINUS SIGN}" in sentence
    assert "of bold: ml, true (too narrow)" in sentence
    assert "Stated uncertainty" in (tmp_path / "out" / "compare.html").read_text()
    # A report of the same covariances is no better, and one without any is not compared.
    file = write_estimates(tmp_path / "again.parquet", stated_rows(dataset, 1.0))
    validate_dataset(dataset.path, [file], tmp_path / "again")
    same = compare_reports([tmp_path / "honest", tmp_path / "again"], tmp_path / "same")
    assert any("identical; 95 % regions hold the truth in" in line for line in same)
    assert not any("Stated" in line for line in compare_reports([tmp_path / "bold", house / "good"], tmp_path / "none"))


def test_different_datasets_stand_side_by_side(house: Path, tmp_path: Path) -> None:
    said = compare_reports([house / "good", house / "other"], tmp_path)
    assert len(said) == 1
    assert "no difference between them is claimed" in said[0]
    assert not (tmp_path / "tables" / "comparisons.csv").exists()
    assert len(rows_of(tmp_path, "results")) == 2


def test_the_same_input_gives_the_same_page(house: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        compare_reports([house / "good", house / "bad", house / "other"], tmp_path / name)
    assert (tmp_path / "a" / "compare.html").read_bytes() == (tmp_path / "b" / "compare.html").read_bytes()


def changed(house: Path, folder: Path, **values: Any) -> Path:
    folder.mkdir()
    summary = json.loads((house / "bad" / "summary.json").read_text())
    (folder / "summary.json").write_bytes(document_of({**summary, **values}))
    (folder / "scores.parquet").write_bytes((house / "bad" / "scores.parquet").read_bytes())
    return folder


def test_refusals(house: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, out = house / "good", tmp_path / "out"
    with pytest.raises(UsageError, match="two or more"):
        compare_reports([good], out)
    with pytest.raises(UsageError, match="given twice"):
        compare_reports([good, good], out)
    with pytest.raises(UsageError, match="not a report"):
        compare_reports([good, tmp_path], out)
    with pytest.raises(UsageError, match="is one of the reports"):
        compare_reports([good, house / "bad"], good)
    with pytest.raises(UsageError, match="is a file"):
        compare_reports([good, house / "bad"], house / "good.parquet")
    with pytest.raises(NotComparableError, match="metrics have version 99"):
        compare_reports([good, changed(house, tmp_path / "version", metric_version=99)], out)
    settings = {**json.loads((house / "bad" / "summary.json").read_text())["settings"], "reprojection_extent_D": 5.0}
    with pytest.raises(NotComparableError, match="extends to 5 D"):
        compare_reports([good, changed(house, tmp_path / "extent", settings=settings)], out)
    with pytest.raises(NotComparableError, match="another version of Roundel"):
        compare_reports([good, changed(house, tmp_path / "schema", schema=99)], out)
    with pytest.raises(DataError, match="not the file"):
        compare_reports([good, changed(house, tmp_path / "sum", checksums={})], out)
    broken = changed(house, tmp_path / "broken")
    (broken / "summary.json").write_text("{")
    with pytest.raises(DataError, match="damaged"):
        compare_reports([good, broken], out)
    assert not out.exists()
    assert main(["compare", str(good), str(tmp_path / "version"), "--out", str(out)]) == 3
    assert capsys.readouterr().err.count("\n") == 1
    assert main(["compare", str(good), str(house / "bad"), "--out", str(out)]) == 0
    assert "has the smaller error" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        ("runs.0.oracle", None),
        ("runs.0.oracle.normal_error_deg", None),
        ("runs.0.oracle.normal_error_deg.median", None),
        ("runs.0.oracle.normal_error_deg.median", "0.1"),
        ("runs.0.oracle.normal_error_deg.median_low", None),
        ("runs.0.solved_interval.low", "much"),
        ("runs.0.n", -1),
        ("runs.0.method", 7),
        ("runs.0", [1, 2]),
        ("runs", {}),
        ("dataset.dataset_id", 7),
        ("dataset", None),
        ("settings.reprojection_extent_D", "3"),
        ("versions.validate", {}),
        ("checksums.images", True),
    ],
)
def test_a_summary_altered_on_purpose_is_one_line(house: Path, tmp_path: Path, keys: str, value: Any) -> None:
    summary = json.loads((house / "bad" / "summary.json").read_text())
    at: Any = summary
    *path, last = keys.split(".")
    for key in path:
        at = at[int(key) if key.isdigit() else key]
    at[int(last) if last.isdigit() else last] = value
    altered = changed(house, tmp_path / "altered", **summary)
    with pytest.raises(DataError, match=rf"altered/summary\.json: damaged: {path[0] if path else keys}"):
        compare_reports([house / "good", altered], tmp_path / "out")


def test_reports_are_called_by_what_tells_them_apart() -> None:
    paths = [Path(p) for p in ("/x/a/report", "/x/b/report")]
    assert labels_of(paths) == ["a", "b"]
    assert labels_of([Path("/x/one"), Path("/x/two")]) == ["one", "two"]
    assert labels_of([Path("/a/x/r"), Path("/b/x/r")]) == ["a/x/r", "b/x/r"]


def test_methods_in_one_report(house: Path, tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "ds", LARGER)
    rows = estimate_rows(dataset, ["true"], 0.1)
    lost = [r for r in estimate_rows(dataset, ["true"], 0.1, "worse") if r["frame_id"] >= 20]
    lost += [failed_row(i, "true", method="worse") for i in range(20)]
    files = [write_estimates(tmp_path / "a.parquet", rows), write_estimates(tmp_path / "b.parquet", lost)]
    validate_dataset(dataset.path, files, tmp_path / "out")
    (row,) = rows_of(tmp_path / "out", "solved_by_one")
    # The user's method comes before Roundel's.
    assert (row["first"], row["second"], row["only_first"], row["only_second"]) == ("worse", "ml", "0", "20")
    assert row["better"] == "ml"
    # Of the frames that both solved the estimates are the same: equal is not "no difference shown".
    assert {r["better"] for r in rows_of(tmp_path / "out", "comparisons")} == {"identical"}
    assert np.all([r["frames"] == "52" for r in rows_of(tmp_path / "out", "comparisons")])
    html = (tmp_path / "out" / "report.html").read_text()
    assert 'id="figure-side-by-side"' in html


def test_a_method_in_two_files(house: Path, tmp_path: Path) -> None:
    files = [house / "good.parquet", house / "bad.parquet"]
    with pytest.raises(UsageError, match=r"bad\.parquet: has method ml .* frame 0, as does .*good\.parquet; give each"):
        validate_dataset(house / "ds", files, tmp_path / "out")
