"""From files of estimates to the verdict: one pose a circle in a CSV, and statements that are no longer true."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_reports import POINTS, estimate_rows, make_dataset, write_estimates

from roundel.cli.main import main
from roundel.datasets.dataset import Dataset
from roundel.scenes.geometry.pose import minimal_rotation

FRAMES = 270
SIGMA = np.array([2e-4, 2e-4, 1e-3, 2e-3, 2e-3])  # centre in m, normal in rad


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    text = POINTS.replace("frames_per_cell: 4", "frames_per_cell: 30")
    return make_dataset(tmp_path_factory.mktemp("gate") / "ds", text)


def one_pose(dataset: Dataset, file: Path, seed: int, wrong: float, normal_scale: float = 1.0) -> Path:
    """A CSV as another program would write it: one noisy pose a frame, of some frames that of the second solution."""
    g = np.random.default_rng(seed)
    columns = ["frame_id", *(f"normal_{a}" for a in "xyz"), *(f"centre_{a}_m" for a in "xyz")]
    with file.open("w", newline="") as opened:
        writer = csv.writer(opened)
        writer.writerow(columns)
        for row in dataset.truth.to_pylist():
            kind = "other_" if g.random() < wrong else ""
            normal, centre = (
                np.array([row[f"{kind}{what}_{a}{unit}"] for a in "xyz"])
                for what, unit in (("normal", ""), ("centre", "_m"))
            )
            error = g.normal(size=5) * SIGMA * [1, 1, 1, normal_scale, normal_scale]
            normal = normal + minimal_rotation([0.0, 0.0, 1.0], normal)[:, :2] @ error[3:]
            normal /= np.linalg.norm(normal)
            writer.writerow([row["frame_id"], *normal.tolist(), *(centre + error[:3]).tolist()])
    return file


def reported(dataset: Dataset, file: Path) -> Path:
    out = file.with_suffix("")
    assert main(["validate", str(dataset.path), str(file), "--out", str(out)]) == 0
    return out


def gated(old: Path, new: Path) -> int:
    baseline = old.with_suffix(".baseline")
    assert main(["baseline", "accept", str(old), "--baseline", str(baseline), "--reason", "before"]) == 0
    return main(["gate", str(new), "--baseline", str(baseline)])


def test_a_csv_with_half_of_its_solutions_wrong(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def report(name: str, *arguments: Any) -> Path:
        (tmp_path / name).mkdir()
        return reported(dataset, one_pose(dataset, tmp_path / name / "mine.csv", *arguments))

    before = report("before", 1, 0.5)
    # The same method on other noise, one that loses a factor of two in its normal, and one that is wrong more often.
    assert gated(before, report("again", 2, 0.5)) == 0
    capsys.readouterr()
    assert gated(before, report("noisy", 3, 0.5, 2.0)) == 1
    said = capsys.readouterr().out
    red = [line for line in said.splitlines() if line.startswith("worse")]
    assert [line.split(": ")[1] for line in red] == ["normal"]
    assert "a loss of 0.0 %" not in said
    assert gated(before, report("wrong", 4, 0.9)) == 1
    red = [line for line in capsys.readouterr().out.splitlines() if line.startswith("worse")]
    assert [line.split(": ")[1] for line in red] == ["right candidate"]
    # The second solution is told from the truth, wherever the noise is far smaller than what lies between them.
    scores = pq.read_table(tmp_path / "wrong" / "mine" / "scores.parquet")
    assert scores["oracle_branch_correct"].to_pylist() == scores["branch_correct"].to_pylist()
    errors = scores["oracle_normal_error_deg"].to_numpy()
    right = np.array(scores["oracle_branch_correct"].to_pylist())
    assert errors[right].max() < 1.0
    assert errors[~right].min() > 10.0


def stating(dataset: Dataset) -> list[dict[str, Any]]:
    """Two poses a frame with probabilities and a confidence that hold, and false positives of low confidence."""
    g = np.random.default_rng(5)
    truth = {row["frame_id"]: np.array([row[f"normal_{a}"] for a in "xyz"]) for row in dataset.truth.to_pylist()}
    rows = estimate_rows(dataset, ["true"], noise_px=0.02)
    out = []
    for pair in zip(rows[::2], rows[1::2], strict=True):
        off = [np.linalg.norm([row[f"normal_{a}"] for a in "xyz"] - truth[row["frame_id"]]) for row in pair]
        first = 0.9 if (g.random() < 0.9) == (off[0] <= off[1]) else 0.1
        confidence = float(g.uniform(0.9, 1.0))
        out += [
            {**row, "probability": p, "confidence": confidence} for row, p in zip(pair, (first, 1 - first), strict=True)
        ]
        if g.random() < 0.2:
            low = float(g.uniform(0.0, 0.2))
            out += [
                {**row, "detection_id": 5, "ellipse_x_px": row["ellipse_x_px"] + 200, "confidence": low} for row in pair
            ]
    return out


CHANGES: dict[str, tuple[Callable[[dict[str, Any]], dict[str, Any]], set[str]]] = {
    "swapped": (
        lambda row: {**row, "probability": 1 - row["probability"]},
        {"probability of the likelier candidate"},
    ),
    "certain": (lambda row: {**row, "confidence": 1.0}, {"one confidence for all", "confidence"}),
}


@pytest.mark.parametrize("name", CHANGES)
def test_statements_that_are_no_longer_true_end_with_1_and_are_named(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    change, titles = CHANGES[name]
    rows = stating(dataset)
    before = reported(dataset, write_estimates(tmp_path / "before.parquet", rows))
    after = reported(dataset, write_estimates(tmp_path / "after.parquet", [change(row) for row in rows]))
    capsys.readouterr()
    assert gated(before, after) == 1
    red = [line for line in capsys.readouterr().out.splitlines() if line.startswith("worse")]
    assert {line.split(": ")[1] for line in red} == titles
    assert gated(before, before) == 0
