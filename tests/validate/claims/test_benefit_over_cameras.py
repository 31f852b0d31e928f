"""The benefit of a calibration over the reports of several cameras."""

import csv
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from helpers_reports import POINTS, estimate_rows, make_dataset, write_estimates

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.claims.benefit_over_cameras import benefit_over_cameras
from roundel.validate.report.compare import compare_reports
from roundel.validate.validate import validate_dataset


def scores(rng, off, sets=3, frames=12, labels=("default", "calibrated:5_{}")):
    """Scores of a camera whose default errors are `off` times those of its calibrations, which are 1 to 2."""
    parts = []
    for label in (labels[0], *(labels[1].format(i) for i in range(sets))):
        errors = rng.uniform(1.0, 2.0, frames) * (off if label == labels[0] else 1.0)
        parts.append(
            pa.table(
                {
                    "frame_id": np.arange(frames),
                    "marker_id": np.zeros(frames, dtype=np.int64),
                    "method": ["pixels"] * frames,
                    "intrinsics": [label] * frames,
                    "reference": ["truth"] * frames,
                    "oracle_normal_error_deg": errors,
                    "oracle_position_error_pct": errors * 10,
                    "oracle_reprojection_error_px": errors,
                }
            )
        )
    return pa.concat_tables(parts)


def test_the_factor_is_the_geometric_mean_over_cameras():
    rng = np.random.default_rng(1)
    found = benefit_over_cameras([scores(rng, off) for off in (1, 10, 100) * 3])
    assert [(f.error.words, f.without, f.views, f.cameras, f.sets) for f in found] == [
        (error, "default", 5, 9, 27) for error in ("normal", "position", "reprojection")
    ]
    for f in found:
        assert f.factor.value == pytest.approx(10, rel=0.15)
        assert f.factor.low < 10 < f.factor.high
        assert f.factor.high / f.factor.low > 4  # cameras differ by far more than circles
        assert f.low == pytest.approx(1, rel=0.4)
        assert f.high == pytest.approx(100, rel=0.4)


def test_cameras_without_a_calibration_are_left_out():
    rng = np.random.default_rng(2)
    bare = scores(rng, 5.0, sets=0)
    assert benefit_over_cameras([bare, scores(rng, 5.0)]) == []
    found = benefit_over_cameras([bare, *(scores(rng, 5.0) for _ in range(7))])
    assert {f.cameras for f in found} == {7}
    assert benefit_over_cameras([scores(rng, 5.0, frames=4)] * 8) == []


def test_few_cameras_have_a_factor_without_an_interval():
    rng = np.random.default_rng(3)
    found = benefit_over_cameras([scores(rng, 5.0, labels=("default", "calibrated:mine{}")) for _ in range(3)])
    assert {(f.views, f.factor.n) for f in found} == {(None, 3)}
    assert all(f.factor.low is None for f in found)


@pytest.mark.parametrize(
    ("label", "views"),
    [("calibrated:5", 5), ("calibrated:5_12", 5), ("calibrated:5_", None), ("calibrated:x_2", None), ("true", None)],
)
def test_views_of_a_set(label, views):
    assert IntrinsicsLabel.of(label).views_of_set == views


def test_reports_of_cameras_are_compared(tmp_path: Path):
    reports = []
    for seed in (5, 6):
        dataset = make_dataset(tmp_path / f"ds{seed}", POINTS.replace("seed: 4", f"seed: {seed}"))
        rows = [*estimate_rows(dataset, ["default"], 0.5), *estimate_rows(dataset, ["calibrated:5"], 0.1)]
        reports.append(tmp_path / f"report{seed}")
        validate_dataset(dataset.path, [write_estimates(tmp_path / f"{seed}.parquet", rows)], reports[-1])
    compare_reports(reports, tmp_path / "out")
    rows = list(csv.DictReader((tmp_path / "out" / "tables" / "benefit_over_cameras.csv").read_text().splitlines()))
    assert [row["error"] for row in rows] == ["normal", "position", "reprojection"]
    assert all(row["cameras"] == "2" and row["views"] == "5" for row in rows)
    # Five times the noise, of which the helper's errors of the normal are of first order.
    assert float(rows[0]["factor"]) == pytest.approx(5, rel=0.2)
    assert all(float(row["factor"]) > 3 for row in rows)
    assert "Benefit of a calibration, over cameras" in (tmp_path / "out" / "compare.html").read_text()
