"""Incomplete estimates: poses without ellipses, ellipses without poses, centres alone, no camera; their dataset."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pytest
from helpers_reports import POINTS, estimate_rows, make_dataset

from roundel.datasets.dataset import Dataset
from roundel.scenes.errors import NotComparableError, UsageError
from roundel.solver.estimates import EstimateKey
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.plugin import Found, View, check_found
from roundel.solver.methods.registry import plugin_estimate
from roundel.validate.diagnosis.diagnosis import diagnose
from roundel.validate.estimates.runs import Run, read_runs
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.scores.scores import Scores, score

SMALL = POINTS.replace("frames_per_cell: 4", "frames_per_cell: 1")
LENS = SMALL.replace("focal_px: 1280", "focal_px: 1280, distortion: [-0.1, 0.03, 0.0005, -0.0007]")
TWO = SMALL.replace(
    "{kind: disc, diameter_m: 0.08}", "{kind: two_discs, diameter_m: 0.08, second_diameter_m: 0.04, spacing_m: 0.09}"
)
POSE = [f"normal_{a}" for a in "xyz"] + [f"centre_{a}_m" for a in "xyz"]
ELLIPSE = [f"ellipse_{n}" for n in ("x_px", "y_px", "a_px", "b_px", "angle_deg")]
CENTRE = ["centre_image_x_px", "centre_image_y_px"]
KEY = ["frame_id", "detection_id"]


@pytest.fixture(scope="module", params=[SMALL, LENS, TWO], ids=["pinhole", "lens", "two discs"])
def dataset(request, tmp_path_factory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("theirs") / "ds", request.param)


def scored(dataset: Dataset, folder: Path, rows: list[dict[str, Any]], columns: list[str]) -> Scores:
    """Scores of these columns alone, from CSV; Python's shortest digits come back to the same doubles."""
    table = pa.Table.from_pylist([{name: row[name] for name in columns} for row in rows])
    pa_csv.write_csv(table, folder / "mine.csv")
    return score(dataset, true_targets(dataset, 3.0), read_runs([folder / "mine.csv"], dataset))


def whole(dataset: Dataset, folder: Path, rows: list[dict[str, Any]]) -> Scores:
    lens = [{**row, "distortion": " ".join(map(repr, row["distortion"]))} for row in rows]
    names = [*KEY, "candidate", "chosen", *POSE, *ELLIPSE, "fx_px", "fy_px", "skew_px", "cx_px", "cy_px", "distortion"]
    return scored(dataset, folder, lens, names)


def column(scores: Scores, name: str) -> np.ndarray:
    return np.array([np.nan if v is None else v for v in scores.table[name].to_pylist()], dtype=float)


def true_rows(dataset: Dataset) -> list[dict[str, Any]]:
    """The true poses, one a detection."""
    order = {}
    rows = []
    for row in dataset.truth.to_pylist():
        order[row["frame_id"]] = order.get(row["frame_id"], -1) + 1
        rows.append({**row, "detection_id": order[row["frame_id"]]})
    return rows


def test_poses_alone_score_as_poses_with_their_ellipses(dataset, tmp_path):
    rows = estimate_rows(dataset, ["true"], noise_px=0.2)
    full = whole(dataset, tmp_path, rows)
    bare = scored(dataset, tmp_path, rows, [*KEY, "candidate", *POSE])
    assert bare.table["solved"].to_pylist() == [True] * bare.table.num_rows
    for name in ("normal_error_deg", "position_error_m", "reprojection_error_px", "centre_image_error_px"):
        np.testing.assert_allclose(column(bare, f"oracle_{name}"), column(full, f"oracle_{name}"), rtol=1e-9)
    # An ellipse has two poses, and either has that ellipse for its image: to the rounding of a conic's axes.
    np.testing.assert_allclose(column(bare, "contour_error_px"), column(full, "contour_error_px"), atol=1e-6)
    np.testing.assert_allclose(
        column(bare, "ellipse_centre_error_px"), column(full, "ellipse_centre_error_px"), atol=1e-6
    )
    assert read_runs([tmp_path / "mine.csv"], dataset)[0].filled == (
        "intrinsics: each frame's true camera",
        "ellipse: from the pose",
    )


def test_true_poses_have_no_error(dataset, tmp_path):
    scores = scored(dataset, tmp_path, true_rows(dataset), [*KEY, *POSE])
    # One pose is meant, so the chosen columns are filled; and the second disc is matched by its own diameter.
    assert column(scores, "normal_error_deg").max() < 1e-9
    assert column(scores, "position_error_m").max() < 1e-12
    assert column(scores, "centre_image_error_px").max() < 1e-9
    assert column(scores, "contour_error_px").max() < 1e-5
    assert set(scores.table["branch_correct"].to_pylist()) == {True}
    assert [f.count for f in scores.false_detections] == [0]


def test_ellipses_alone_get_both_poses(dataset, tmp_path):
    rows = [r for r in estimate_rows(dataset, ["true"], noise_px=0.2) if r["candidate"] == 0]
    full = whole(dataset, tmp_path, estimate_rows(dataset, ["true"], noise_px=0.2))
    bare = scored(dataset, tmp_path, rows, [*KEY, *ELLIPSE])
    assert bare.table["solved"].to_pylist() == [True] * bare.table.num_rows
    np.testing.assert_allclose(column(bare, "contour_error_px"), column(full, "contour_error_px"), rtol=1e-9)
    for name in ("normal_error_deg", "position_error_m", "pose_error_bounds", "centre_image_error_px"):
        np.testing.assert_allclose(column(bare, f"oracle_{name}"), column(full, f"oracle_{name}"), rtol=1e-6, atol=1e-9)
        # Both are equally likely, so that none is chosen.
        assert np.isnan(column(bare, name)).all()
    (run,) = read_runs([tmp_path / "mine.csv"], dataset)
    assert run.filled[-1] == "pose: both poses of the ellipse"
    assert run.candidate.tolist() == [0, 1] * len(rows)
    assert not run.chosen.any()


def test_the_poses_of_an_ellipse_are_those_of_a_python_method(dataset, tmp_path):
    shape = [640.0, 360.0, 30.0, 24.0, 20.0]
    camera, radius_m = dataset.images.camera(0), dataset.truth["radius_m"][0].as_py()
    found = check_found(Found(ellipse=shape), View(np.zeros((720, 1280), np.uint8), camera, 2 * radius_m))
    assert found.normal is None, "Roundel computes the poses"
    key = EstimateKey(0, 0, "mine", "true")
    estimate = plugin_estimate(found, UncertainCamera(camera), 2 * radius_m, None, key)
    table = pa.Table.from_pylist([{"frame_id": 0, **dict(zip(ELLIPSE, shape, strict=True))}])
    pa_csv.write_csv(table, tmp_path / "mine.csv")
    (run,) = read_runs([tmp_path / "mine.csv"], dataset)
    np.testing.assert_allclose(run.normal, estimate.normal, atol=1e-9)
    np.testing.assert_allclose(run.centre_m, estimate.centre_m, atol=1e-12)
    assert estimate.chosen is None


@pytest.mark.parametrize("where", ["column", "comment"])
def test_a_csv_names_its_dataset(dataset, tmp_path, where):
    own = dataset.manifest["dataset_id"]
    other = "0123456789ab" if own[:12] != "0123456789ab" else "ba9876543210"
    row = true_rows(dataset)[0]

    def read(name: str) -> list[Run]:
        named = {"dataset_id": name} if where == "column" else {}
        pa_csv.write_csv(pa.Table.from_pylist([{**{n: row[n] for n in (*KEY, *POSE)}, **named}]), tmp_path / "mine.csv")
        if where == "comment":
            text = (tmp_path / "mine.csv").read_text()
            (tmp_path / "mine.csv").write_text(f"# my detector\n# dataset_id: {name}\n{text}")
        return read_runs([tmp_path / "mine.csv"], dataset)

    assert len(read(own)) == len(read(own[:12])) == 1
    with pytest.raises(NotComparableError, match=f"the estimates are of dataset {other}, but .* is {own[:12]}"):
        read(other)
    with pytest.raises(UsageError, match="dataset_id is 'mine'"):
        read("mine")
    # Wrong estimates of another dataset are not explained by a convention.
    assert diagnose(tmp_path / "mine.csv", dataset) == []


def test_rows_of_two_datasets_are_refused(dataset, tmp_path):
    rows = [
        {**{n: row[n] for n in (*KEY, *POSE)}, "dataset_id": 12 * d}
        for d, row in zip("ab", true_rows(dataset), strict=False)
    ]
    pa_csv.write_csv(pa.Table.from_pylist(rows), tmp_path / "mine.csv")
    with pytest.raises(UsageError, match="rows of 2 datasets"):
        read_runs([tmp_path / "mine.csv"], dataset)


def test_centres_alone_have_two_errors(dataset, tmp_path):
    truth = true_rows(dataset)
    scores = scored(dataset, tmp_path, truth, [*KEY, *CENTRE])
    assert column(scores, "centre_image_error_px").max() < 1e-9
    assert column(scores, "oracle_centre_image_error_px").max() < 1e-9
    # The image of the centre is not the centre of the ellipse: at 15 D and 45 degrees they are 0.2 px apart.
    offset = column(scores, "ellipse_centre_error_px")
    assert 0.1 < offset.max() < 1.0
    assert set(scores.table["reason"].to_pylist()) == {"found, but without a pose"}
    # A point elsewhere is a false detection, and its circle is not found.
    moved = [{**row, CENTRE[0]: row[CENTRE[0]] + 60.0} for row in truth]
    lost = scored(dataset, tmp_path, moved, [*KEY, *CENTRE])
    assert lost.table["detected"].to_pylist() == [False] * len(truth)
    assert [f.count for f in lost.false_detections] == [len(truth)]


def test_frames_that_are_left_out_count(dataset, tmp_path):
    truth = [row for row in true_rows(dataset) if row["frame_id"] != 0]
    scores = scored(dataset, tmp_path, truth, [*KEY, *POSE])
    missed = [row for row in scores.table.to_pylist() if not row["detected"]]
    assert {row["frame_id"] for row in missed} == {0}
    assert {row["reason"] for row in missed} == {"the estimates have no row for this frame"}


def test_a_centre_given_as_the_second_candidate_counts(dataset, tmp_path):
    # Neither candidate has a pose; the one that was detected is scored all the same.
    truth = [{**row, "candidate": 1} for row in true_rows(dataset)]
    scores = scored(dataset, tmp_path, truth, [*KEY, "candidate", *CENTRE])
    assert all(scores.table["detected"].to_pylist())
    assert column(scores, "oracle_centre_image_error_px").max() < 1e-9
