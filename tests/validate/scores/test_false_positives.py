"""Confidences of all detections, right and wrong, from a report alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_reports import POINTS, estimate_rows, failed_row, make_dataset, write_estimates

from roundel.datasets.dataset import Dataset
from roundel.datasets.store.records import document_of, record_of_document
from roundel.scenes.errors import DataError
from roundel.validate.scores.false_positives import FALSE_POSITIVES_SCHEMA
from roundel.validate.scores.report_files import FALSE_POSITIVES, SUMMARY, read_false_positives, read_report_files
from roundel.validate.validate import validate_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("points") / "ds", POINTS)


@pytest.fixture
def report(dataset: Dataset, tmp_path: Path) -> Path:
    """One method states a confidence for each detection, the other for none; frame 3 is missed by both."""
    rows = []
    for method, stated in (("silent", None), ("sure", 0.9)):
        good = [r for r in estimate_rows(dataset, ["true"], method=method) if r["frame_id"] != 3]
        rows += [{**r, "confidence": stated} for r in good]
        rows.append(failed_row(3, "true") | {"method": method})
        rows += [
            {**r, "detection_id": 5, "confidence": stated and 0.25, "ellipse_x_px": r["ellipse_x_px"] + 200}
            for r in good
            if r["frame_id"] in (1, 2)
        ]
    # A score of another scale is no probability.
    rows += [{**r, "method": "loud", "confidence": 40.0} for r in good]
    file = write_estimates(tmp_path / "e.parquet", rows)
    validate_dataset(dataset.path, [file], tmp_path / "report")
    return tmp_path / "report"


def test_every_detection_has_its_confidence(report: Path) -> None:
    facts, scores = read_report_files(report)
    rows = scores.to_pylist()
    assert {r["confidence"] for r in rows if r["method"] in ("silent", "loud")} == {None}
    stated = [(r["frame_id"] == 3, r["confidence"]) for r in rows if r["method"] == "sure"]
    assert set(stated) == {(False, 0.9), (True, None)}
    false = read_false_positives(report, facts)
    assert false is not None
    assert false.schema == FALSE_POSITIVES_SCHEMA
    found = [(r["method"], r["frame_id"], r["detection_id"], r["confidence"]) for r in false.to_pylist()]
    assert found == [("silent", 1, 5, None), ("silent", 2, 5, None), ("sure", 1, 5, 0.25), ("sure", 2, 5, 0.25)]
    assert np.isfinite(false["image_x_px"].to_numpy()).all()
    assert {run["method"]: run["false_detections"] for run in facts["runs"]} == {"loud": 0, "silent": 2, "sure": 2}


def test_a_report_of_an_older_version_has_none(report: Path) -> None:
    facts = record_of_document((report / SUMMARY).read_bytes())
    del facts["checksums"][FALSE_POSITIVES]
    (report / SUMMARY).write_bytes(document_of(facts))
    (report / FALSE_POSITIVES).unlink()
    again, _ = read_report_files(report)
    assert read_false_positives(report, again) is None


def test_another_file_is_refused(report: Path) -> None:
    facts, _ = read_report_files(report)
    table = pq.read_table(report / FALSE_POSITIVES)
    pq.write_table(table.slice(1), report / FALSE_POSITIVES)
    with pytest.raises(DataError, match=r"false_positives\.parquet is not the file that summary\.json was made from"):
        read_false_positives(report, facts)
    (report / FALSE_POSITIVES).unlink()
    with pytest.raises(DataError, match=r"false_positives\.parquet"):
        read_false_positives(report, facts)
