"""Covariances, probabilities and confidences of other programs: in CSV and Parquet, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from helpers_reports import POINTS, make_dataset
from hypothesis import given
from hypothesis import strategies as st

from roundel.cli.main import main
from roundel.datasets.dataset import Dataset
from roundel.scenes.geometry.pose import minimal_rotation
from roundel.validate.estimates.row_checks import covariances, indefinite
from roundel.validate.estimates.runs import read_runs
from roundel.validate.estimates.schema import COVARIANCE
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.scores.scores import UNCERTAINTY, score

SMALL = POINTS.replace("frames_per_cell: 4", "frames_per_cell: 1")
POSE = [f"normal_{a}" for a in "xyz"] + [f"centre_{a}_m" for a in "xyz"]
GUIDE = Path(__file__).resolve().parents[3] / "docs" / "your-own-method.md"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("stated") / "ds", SMALL)


def covariance_of(normal: np.ndarray) -> np.ndarray:
    """Of rank five: correlated errors of centre and normal."""
    axes = minimal_rotation([0.0, 0.0, 1.0], normal)[:, :2]
    root = np.array([2e-4, 3e-4, 1e-3, 4e-4, 3e-4])[:, None] * (np.eye(5) + 0.4)
    basis = np.zeros((5, 6))
    basis[:3, :3], basis[3:, 3:] = np.eye(3), axes.T
    return basis.T @ root @ root.T @ basis


def rows_of(dataset: Dataset) -> list[dict[str, Any]]:
    """The true poses, moved by a millimetre in depth, as one candidate of each frame."""
    rows = []
    for true in dataset.truth.to_pylist():
        row = {"frame_id": true["frame_id"], **{name: true[name] for name in POSE}}
        row["centre_z_m"] += 1e-3
        cov = covariance_of(np.array([true[f"normal_{a}"] for a in "xyz"]))
        row |= {f"cov_{i}{j}": float(cov[i, j]) for i in range(6) for j in range(i, 6)}
        rows.append({**row, "probability": 0.75, "confidence": 0.5})
    return rows


def written(folder: Path, rows: list[dict[str, Any]], ending: str) -> Path:
    file = folder / f"mine.{ending}"
    table = pa.Table.from_pylist(rows)
    pa_csv.write_csv(table, file) if ending == "csv" else pq.write_table(table, file)
    return file


def test_csv_and_parquet_say_the_same(dataset: Dataset, tmp_path: Path) -> None:
    rows = rows_of(dataset)
    runs = {ending: read_runs([written(tmp_path, rows, ending)], dataset) for ending in ("csv", "parquet")}
    for (run,) in runs.values():
        expected = [covariance_of(normal) for normal in run.normal]
        np.testing.assert_allclose(run.covariance, expected, rtol=1e-12, atol=0)
        assert set(run.probability) == {0.75}
        assert set(run.confidence) == {0.5}
    tables = [score(dataset, true_targets(dataset, 3.0), run).table for run in runs.values()]
    for name in (*UNCERTAINTY, *(f"oracle_{name}" for name in UNCERTAINTY)):
        values = [table[name].to_numpy() for table in tables]
        assert np.isfinite(values[0]).all()
        np.testing.assert_array_equal(*values)


def test_one_covariance_in_two_hundred_is_enough_to_be_scored(dataset: Dataset, tmp_path: Path) -> None:
    # Others are empty: they state nothing, and are not refused.
    rows = [{**row, **({} if i == 0 else dict.fromkeys(COVARIANCE))} for i, row in enumerate(rows_of(dataset))]
    table = score(dataset, true_targets(dataset, 3.0), read_runs([written(tmp_path, rows, "csv")], dataset)).table
    assert [v is not None for v in table["oracle_pose_chi2"].to_pylist()] == [i == 0 for i in range(len(rows))]


def test_six_digits_are_enough(dataset: Dataset, tmp_path: Path) -> None:
    rows = rows_of(dataset)
    rounded = [{k: float(f"{v:.6g}") if k in COVARIANCE else v for k, v in row.items()} for row in rows]
    exact, short = (
        score(dataset, true_targets(dataset, 3.0), read_runs([written(tmp_path, some, "csv")], dataset)).table
        for some in (rows, rounded)
    )
    for name in ("oracle_pose_chi2", "oracle_normal_sigma_deg", "oracle_depth_sigma_m"):
        # The matrix of correlations has a condition of some 30: of six digits four to five are left.
        np.testing.assert_allclose(short[name].to_numpy(), exact[name].to_numpy(), rtol=3e-4)


def test_the_code_of_the_guide_states_what_its_text_says() -> None:
    (code,) = re.findall(r"```python\n(import numpy as np\n\nnormal.*?)```", GUIDE.read_text(encoding="utf-8"), re.S)
    known: dict[str, Any] = {}
    exec(code, known)
    cov = covariances(pa.table({name: [known["row"][name]] for name in COVARIANCE}))[0]
    np.testing.assert_array_equal(cov, known["cov"])
    turned = np.cross(known["u"], known["normal"])
    # A turn by `sa` about u moves the normal by `sa` along u x normal.
    assert turned @ cov[3:, 3:] @ turned == pytest.approx(known["sa"] ** 2)
    assert known["normal"] @ cov[3:, 3:] @ known["normal"] == pytest.approx(0.0, abs=1e-20)
    assert np.linalg.matrix_rank(cov / np.sqrt(np.outer(*[np.diag(cov) + 1e-12] * 2)), tol=1e-9) == 5


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"cov_22": -1e-6}, "its covariance is not positive semidefinite"),
        ({"cov_02": 1.0}, "its covariance is not positive semidefinite"),
        ({"cov_11": None}, "a number of its covariance is missing or not finite"),
        ({"cov_44": float("nan")}, "a number of its covariance is missing or not finite"),
        ({"cov_55": float("inf")}, "a number of its covariance is missing or not finite"),
        (dict.fromkeys(POSE), "its pose, ellipse and centre are missing"),
        ({"probability": 1.2}, "its probability is not between 0 and 1"),
        ({"probability": -0.1}, "its probability is not between 0 and 1"),
        ({"probability": float("nan")}, "its probability is not between 0 and 1"),
        ({"confidence": float("nan")}, "its confidence is not finite"),
    ],
)
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_what_is_impossible_is_one_line(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict, sentence: str, ending: str
) -> None:
    rows = [{**row, "status": "ok"} for row in rows_of(dataset)]
    rows[2] |= change
    file = written(tmp_path, rows, ending)
    assert main(["validate", str(dataset.path), str(file), "--out", str(tmp_path / "report")]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert f"{file}: frame {rows[2]['frame_id']}, " in said.err
    assert sentence in said.err


def test_a_covariance_needs_a_pose(dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [{**row, "centre_image_x_px": 3.0, "centre_image_y_px": 4.0} for row in rows_of(dataset)]
    rows[1] |= dict.fromkeys(POSE)
    file = written(tmp_path, rows, "csv")
    assert main(["validate", str(dataset.path), str(file), "--out", str(tmp_path / "report")]) == 2
    assert "it has a covariance, but no pose" in capsys.readouterr().err


def test_two_probabilities_add_up(dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    both = [{**row, "candidate": k, "chosen": False, "probability": 0.6} for row in rows_of(dataset) for k in (0, 1)]
    file = written(tmp_path, both, "csv")
    assert main(["validate", str(dataset.path), str(file), "--out", str(tmp_path / "report")]) == 2
    assert "the probabilities of its two candidates add up to more than 1" in capsys.readouterr().err
    third = [{**row, "probability": 0.6 if row["candidate"] else 0.4} for row in both]
    assert len(read_runs([written(tmp_path, third, "csv")], dataset)) == 1


def test_a_part_of_the_columns_is_named(dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [{k: v for k, v in row.items() if k not in ("cov_12", "cov_45")} for row in rows_of(dataset)]
    file = written(tmp_path, rows, "csv")
    assert main(["validate", str(dataset.path), str(file), "--out", str(tmp_path / "report")]) == 2
    assert "has no column cov_12, cov_45;" in capsys.readouterr().err


@given(st.integers(0, 10_000), st.integers(1, 6), st.floats(-6, 6))
def test_no_covariance_is_taken_for_another_matrix(seed: int, rank: int, magnitude: float) -> None:
    """Matrices J J^T of any rank and scale pass; one with a negative eigenvalue does not."""
    rng = np.random.default_rng(seed)
    unit = np.repeat([10.0**magnitude, 1.0], 3)
    factor = rng.normal(size=(6, rank))
    good = factor @ factor.T
    values, vectors = np.linalg.eigh(good)
    bad = good - vectors[:, :1] @ vectors[:, :1].T * (values[0] + 0.01 * values[-1])
    scaled = np.stack([good, bad, np.zeros((6, 6)), np.full((6, 6), np.nan)]) * unit * unit[:, None]
    assert indefinite(scaled).tolist() == [False, True, False, False]
