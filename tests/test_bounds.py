"""Bounds of frames and what they need: a truth that tells, and one clear line where it does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from helpers_reports import POINTS, estimate_rows, make_dataset, write_estimates

from roundel.datasets.dataset import Dataset
from roundel.scenes.errors import DataError
from roundel.validate.bounds import bounds_of
from roundel.validate.records import read_runs
from roundel.validate.scores import score
from roundel.validate.summary import summarise
from roundel.validate.targets import columns_of, true_targets


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("points") / "ds", POINTS)


def with_column(dataset: Dataset, name: str, values: Any) -> Dataset:
    at = dataset.truth.column_names.index(name)
    return replace(dataset, truth=dataset.truth.set_column(at, name, values))


def test_four_times_the_points_halve_every_bound(dataset: Dataset, tmp_path: Path) -> None:
    def counted(count: int) -> Any:
        text = POINTS.replace("frames_per_cell: 4", f"frames_per_cell: 1\npoints: {{count: {count}, sigma_px: 0.2}}")
        made = make_dataset(tmp_path / f"ds{count}", text)
        return bounds_of(made, true_targets(made, 3.0))

    few, many = counted(100), counted(400)
    for name in ("normal_deg", "position_m", "ellipse_centre_px"):
        np.testing.assert_allclose(getattr(few, name), 2 * getattr(many, name), rtol=1e-9)


def test_a_circle_seen_on_edge_has_no_bound(dataset: Dataset) -> None:
    targets = true_targets(dataset, 3.0)
    pose = targets.camera_from_marker.copy()
    # The plane now holds the camera's centre.
    z = pose[0, :3, 3] / np.linalg.norm(pose[0, :3, 3])
    x = np.cross(z, [0.0, 1.0, 0.0]) / np.linalg.norm(np.cross(z, [0.0, 1.0, 0.0]))
    pose[0, :3, :3] = np.stack([z, np.cross(x, z), x], axis=1)
    found = bounds_of(dataset, replace(targets, camera_from_marker=pose))
    assert np.isnan(found.normal_deg[0])
    assert np.isfinite(found.normal_deg[1:]).all()


def test_a_truth_that_lacks_something_is_refused(dataset: Dataset) -> None:
    with pytest.raises(DataError, match="has no column no_such; render it"):
        columns_of(dataset.truth, ["no_such"])
    ragged = pa.array([[0.0] * (5 + (i == 3)) for i in range(dataset.truth.num_rows)])
    with pytest.raises(DataError, match="contours of 2 lengths in contour_x_px"):
        true_targets(with_column(dataset, "contour_x_px", ragged), 3.0)
    with pytest.raises(DataError, match="has frame 900, which its cameras do not have"):
        true_targets(with_column(dataset, "frame_id", pa.array(range(900, 936))), 3.0)


def test_no_circle_is_no_error_of_the_targets(dataset: Dataset) -> None:
    nothing = with_column(dataset, "radius_m", pa.nulls(dataset.truth.num_rows, pa.float64()))
    assert len(true_targets(nothing, 3.0)) == 0


def test_a_detection_is_known_by_its_second_candidate(dataset: Dataset, tmp_path: Path) -> None:
    # Of frame 2 the first candidate failed, and the second did not.
    rows = estimate_rows(dataset, ["true"])
    failed = {"status": "failed", "reason": "no pose", "chosen": False}
    rows = [{**r, **failed} if (r["frame_id"], r["candidate"]) == (2, 0) else r for r in rows]
    runs = read_runs([write_estimates(tmp_path / "e.parquet", rows)], dataset)
    scores = score(dataset, true_targets(dataset, 3.0), runs)
    assert scores.table["solved"].to_pylist() == [True] * 36
    run = summarise(dataset, scores, {"reprojection_extent_D": 3.0}, None)["runs"][0]
    assert (run["solved"], run["false_detections"]) == (36, 0)
