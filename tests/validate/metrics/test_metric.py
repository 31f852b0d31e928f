"""A metric's title, unit and scale are defined once: changing the record changes all displayed text."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from helpers_reports import BOARDS, estimate_rows, make_dataset, write_estimates

from roundel.validate.calibration.camera_errors import calibrate_dataset
from roundel.validate.gate.accuracy import accuracy_questions
from roundel.validate.metrics import metric
from roundel.validate.metrics.metric import METRICS, SHIFT_X, SHIFT_Y, Metric
from roundel.validate.scores.terminal_table import terminal_table
from roundel.validate.tables.report import report_tables
from roundel.validate.validate import validate_dataset


@pytest.fixture
def renamed() -> Iterator[Metric]:
    """The normal's error under another title and in another unit."""
    kept = dict(vars(metric.NORMAL))
    object.__setattr__(metric.NORMAL, "title", "Zenith")
    object.__setattr__(metric.NORMAL, "unit", "gon")
    yield metric.NORMAL
    for key, value in kept.items():
        object.__setattr__(metric.NORMAL, key, value)


def test_a_title_and_a_unit_stand_once(renamed: Metric, tmp_path: Path) -> None:
    make_dataset(tmp_path / "ds", BOARDS)
    calibrate_dataset(tmp_path / "ds", tmp_path / "phone.json", "calibration")
    dataset = make_dataset(tmp_path / "again", BOARDS)
    rows = estimate_rows(dataset, ["true", "default"], noise_px=0.1, chosen=True)
    file = write_estimates(tmp_path / "e.parquet", rows)
    out = tmp_path / "report"
    summary = validate_dataset(dataset.path, [file], out, camera_path=tmp_path / "phone.json")

    assert "zenith gon" in terminal_table(summary)
    for name, table in report_tables(summary).items():
        titles = {(c.title, c.unit) for c in table.columns if c.key.startswith("normal_error_deg")}
        assert titles <= {("Zenith", "gon")}, name
    assert ("Zenith", "gon") in {(c.title, c.unit) for c in report_tables(summary)["results"].columns}
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "normal [deg]" not in page
    figures = list(out.rglob("*.svg"))
    labelled = [f for f in figures if "zenith [gon]" in f.read_text(encoding="utf-8")]
    assert labelled
    assert not any("normal [" in f.read_text(encoding="utf-8") for f in figures)


def test_the_gate_speaks_of_the_metric_by_its_title(renamed: Metric) -> None:
    rng = np.random.default_rng(0)
    n = 60
    columns = {name: np.abs(rng.normal(size=n)) for name in (
        "oracle_pose_error_bounds", "oracle_normal_error_deg", "oracle_position_error_m", "contour_error_px",
        "ellipse_centre_x_error_px", "ellipse_centre_y_error_px", "normal_bound_deg", "position_bound_m",
        "ellipse_centre_bound_px",
    )}  # fmt: skip
    rows = pa.table(
        {**columns, "frame_id": np.arange(n), "group": ["a"] * n, "solved": [True] * n, "branch_correct": [True] * n}
    )
    asked, _ = accuracy_questions("run", rows, rows)
    assert " gon of " in next(q.sentence for q in asked if q.title == "zenith")
    assert "normal" not in {q.title for q in asked}


def test_columns_with_and_without_the_oracle() -> None:
    assert (metric.NORMAL.oracle, metric.NORMAL.name) == ("oracle_normal_error_deg", "normal")
    assert (metric.CONTOUR.oracle, metric.CONTOUR.name) == ("contour_error_px", "contour")
    assert (metric.POSE.name, metric.ELLIPSE_CENTRE.name) == ("pose", "ellipse_centre")
    assert metric.ALONG_RAY.table_column == "along_ray_mm"
    assert metric.MSSD.words == "MSSD"
    assert len({m.column for m in (*METRICS, SHIFT_X, SHIFT_Y)}) == len(METRICS) + 2


def test_bounds_are_in_the_units_of_their_errors() -> None:
    table = pa.table(
        {
            "oracle_position_error_pct": [2.0, None, 3.0],
            "position_bound_m": [0.01, 0.01, 0.0],
            "distance_m": [0.5, 0.5, 0.5],
        }
    )
    np.testing.assert_allclose(metric.POSITION.values(table), [2.0, np.nan, 3.0])
    np.testing.assert_allclose(metric.POSITION.bounds(table), [2.0, 2.0, 0.0])
    # Without a positive bound there is nothing to compare with.
    np.testing.assert_allclose(metric.POSITION.over_bound(table), [1.0, np.nan, np.nan])
    assert np.isnan(metric.REPROJECTION.bounds(table)).all()
