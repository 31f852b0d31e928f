"""Results in BOP's format: the truth itself scores zero; what is wrong is one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_reports import POINTS, make_dataset

from roundel.cli.main import main
from roundel.datasets.dataset import Dataset
from roundel.scenes.errors import NotComparableError, UsageError
from roundel.validate.estimates.reader import read_estimates
from roundel.validate.metrics.ground_truth import poses_of

HEAD = "scene_id,im_id,obj_id,score,R,t,time\n"
GOOD = "0,3,1,0.9,1 0 0 0 1 0 0 0 1,10 20 500,-1\n"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("bop") / "ds", POINTS)


def test_the_truth_scores_zero(dataset: Dataset, tmp_path: Path) -> None:
    lines = []
    for frame_id, pose in zip(dataset.truth["frame_id"].to_pylist(), poses_of(dataset.truth), strict=True):
        rotation = " ".join(f"{v:.17g}" for v in pose[:3, :3].ravel())
        lines.append(f"0,{frame_id},1,1.0,{rotation},{' '.join(f'{1000 * v:.17g}' for v in pose[:3, 3])},-1\n")
    file = tmp_path / "best_roundel-test.csv"
    file.write_text(HEAD + "".join(lines))
    assert main(["validate", str(dataset.path), str(file), "--out", str(tmp_path / "report")]) == 0
    rows = pq.read_table(tmp_path / "report" / "scores.parquet").to_pylist()
    assert {row["method"] for row in rows} == {"best"}
    assert all(row["solved"] for row in rows)
    assert len(rows) == len(dataset)
    for name in ("normal_error_deg", "position_error_m", "mssd_m", "mspd_px"):
        assert max(row[name] for row in rows) < 1e-6


def test_several_poses_of_an_image_are_several_detections(tmp_path: Path) -> None:
    # The last digits of a rotation are often missing.
    turned = "0,3,1,0.5,0.8661 -0.5 0 0.5 0.866 0 0 0 1.0004,0 0 400,-1\n"
    (tmp_path / "a.csv").write_text(HEAD + GOOD + turned + "\n")
    first, second = read_estimates(tmp_path / "a.csv").to_pylist()
    assert (first["detection_id"], second["detection_id"]) == (0, 1)
    assert (first["centre_x_m"], first["normal_z"], first["confidence"]) == (0.01, 1.0, 0.9)
    normal = np.array([second[f"normal_{a}"] for a in "xyz"])
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("0,3,1,0.9,1 0 0 0 1 0 0 0 1,10 20 500", "has 6 columns"),
        ("0,x,1,0.9,1 0 0 0 1 0 0 0 1,10 20 500,-1", "are numbers"),
        ("0,3,1,0.9,1 0 0 0 1 0 0 0,10 20 500,-1", "R has nine"),
        ("0,3,1,0.9,1 0 0 0 1 0 0 0 1,10 20,-1", "t three"),
        ("0,3,1,0.9,1 0 0 0 1 0 0 0 2,10 20 500,-1", "no rotation"),
        ("0,3,1,0.9,1 0 0 0 1 0 0 0 -1,10 20 500,-1", "no rotation"),
        ("0,3,1,nan,1 0 0 0 1 0 0 0 1,10 20 500,-1", "not finite"),
    ],
)
def test_a_wrong_line_is_named(line: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(HEAD + GOOD + line + "\n")
    with pytest.raises(UsageError, match=rf"a\.csv:3: .*{words}"):
        read_estimates(tmp_path / "a.csv")


def test_unknown_frames_and_no_results(dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "none.csv").write_text(HEAD)
    with pytest.raises(NotComparableError, match="no results"):
        read_estimates(tmp_path / "none.csv")
    (tmp_path / "other.csv").write_text(HEAD + GOOD.replace("0,3,", "0,999999,"))
    assert main(["validate", str(dataset.path), str(tmp_path / "other.csv"), "--out", str(tmp_path / "out")]) == 3
    error = capsys.readouterr().err
    assert "999999" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
