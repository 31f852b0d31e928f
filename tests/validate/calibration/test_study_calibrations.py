"""Calibrations from few and from many views: labels, camera files, and comparison with the truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_reports import BOARDS, make_dataset

from roundel.cli.main import main
from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.scenes.errors import StudyError, UsageError
from roundel.scenes.study.schema import SolveSection
from roundel.scenes.study.study import load_study
from roundel.solver.intrinsics.specification import parse_intrinsics
from roundel.validate.calibration.opencv import BoardView, first_views, look_for_boards, read_camera
from roundel.validate.calibration.study_calibrations import (
    Calibrations,
    calibrate_study,
    several_calibrations,
    spread_in_words,
)
from roundel.validate.figures.calibration import calibration_pictures

VIEWS = 8
TEXT = BOARDS.replace("frames: 5", f"frames: {VIEWS}").replace("frames: 4", "frames: 1")
TEXT = TEXT.replace("calibrated, default", '"calibrated:3", "calibrated:6", default')


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("calibrations") / "ds", TEXT)


@pytest.fixture(scope="module")
def views(dataset: Dataset) -> list[BoardView]:
    return look_for_boards(dataset.images, "calibration")


@pytest.fixture(scope="module")
def calibrations(dataset: Dataset, views: list[BoardView]) -> Calibrations:
    found = several_calibrations(dataset, views, ["true", "calibrated:3", "calibrated:6", "calibrated", "default"])
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("label", "count"),
    [("calibrated:5", 5), ("calibrated:40", 40), ("calibrated", None), ("calibrated:phone.json", None),
     ("calibrated:-5", None), ("calibrated:5.0", None), ("calibrated:\N{SUPERSCRIPT TWO}", None), ("scaled:5", None)],
)  # fmt: skip
def test_labels(label: str, count: int | None) -> None:
    assert IntrinsicsLabel.of(label).views == count


def test_one_camera_file_a_label(dataset: Dataset, tmp_path: Path) -> None:
    solve = SolveSection(
        intrinsics=["true", "calibrated:3", "calibrated:6", "calibrated"], calibrate_from="calibration"
    )
    records, files = calibrate_study(dataset.path, solve, tmp_path / "chessboard.json", tmp_path / "cameras")
    assert [r["views"] for r in records] == [VIEWS, 3, 6]
    assert sorted(files) == ["calibrated", "calibrated:3", "calibrated:6"]
    for label, file in files.items():
        # Estimates are labelled by the file's stem.
        assert parse_intrinsics(f"calibrated:{file}").label == (
            "calibrated:chessboard" if label == "calibrated" else label
        )
    used = [json.loads(files[f"calibrated:{n}"].read_text())["calibration"]["frames"] for n in (3, 6)]
    assert used == [[0, 1, 2], [0, 1, 2, 3, 4, 5]]


def test_the_command_takes_the_first_views(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "c.json"
    assert main(["calibrate", str(dataset.path), str(file), "--group", "calibration", "--views", "3"]) == 0
    assert "3 of 3 views" in capsys.readouterr().out
    assert json.loads(file.read_text())["calibration"]["frames"] == [0, 1, 2]
    assert main(["calibrate", str(dataset.path), str(file), "--group", "calibration", "--views", "9"]) == 2
    assert "9 views are requested, but 8 show a chessboard" in capsys.readouterr().err


@pytest.mark.parametrize("views", ["0", "-3", "2.5", "five"])
def test_a_number_of_views_is_one(views: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["calibrate", "ds", "c.json", f"--views={views}"])
    assert stopped.value.code == 2
    assert "give a number of views" in capsys.readouterr().err


def test_first_views(views: list[BoardView]) -> None:
    assert [v.frame_id for v in first_views(views, 3)] == [0, 1, 2]
    assert first_views(views, None) == views
    with pytest.raises(UsageError, match="9 views are requested"):
        first_views(views, 9)


def test_each_is_judged_against_the_truth(calibrations: Calibrations) -> None:
    assert [r["label"] for r in calibrations.records] == ["calibrated:3", "calibrated:6"]
    for record, difference in zip(calibrations.records, calibrations.differences, strict=True):
        # 8 x 8 subpixels; the command measured 0.014 % from five such views.
        assert abs(record["fx_error_pct"]) < 0.2
        lengths = np.linalg.norm(difference.rotated, axis=-1)
        assert record["projection_mean_rotated_px"] == pytest.approx(np.nanmean(lengths))
        assert record["projection_max_rotated_px"] == pytest.approx(np.nanmax(lengths))
        # Principal point and rotation look alike: with the rotation removed less is left.
        assert record["projection_mean_rotated_px"] < record["projection_mean_px"]


def test_draws_of_few_views(dataset: Dataset, views: list[BoardView], calibrations: Calibrations) -> None:
    # Six of eight would be nearly the same views each time.
    assert {s["views"] for s in calibrations.subsets} == {3}
    assert len({s["fx_error_pct"] for s in calibrations.subsets}) > 5
    again = several_calibrations(dataset, views, ["calibrated:3"])
    assert again is not None
    assert again.subsets == calibrations.subsets
    assert spread_in_words(calibrations.subsets)[0].startswith("10 random subsets of 3 views: residual RMS 0.0")


def test_nothing_to_calibrate(dataset: Dataset, views: list[BoardView]) -> None:
    assert several_calibrations(dataset, views, ["true", "calibrated"]) is None
    assert several_calibrations(dataset, [], ["calibrated:3"]) is None
    blind = [replace(view, corners_px=None) for view in views]
    assert several_calibrations(dataset, blind, ["calibrated:3"]) is None


def test_pictures(calibrations: Calibrations) -> None:
    pictures = calibration_pictures(calibrations)
    assert [p.name for p in pictures] == ["calibration-maps", "calibration-residuals"]
    assert [p.svg for p in pictures] == [p.svg for p in calibration_pictures(calibrations)]
    assert ">3 views<" in pictures[0].svg
    assert "<image" not in pictures[0].svg
    assert calibration_pictures(None) == []
    assert calibration_pictures(replace(calibrations, differences=[])) == []
    assert len(calibration_pictures(replace(calibrations, subsets=[]))) == 1


def test_the_shipped_study_asks_for_four_calibrations() -> None:
    study = load_study(Path(__file__).resolve().parents[3] / "configs" / "paper_real.yaml")
    assert [n for label in study.solve.intrinsics if (n := IntrinsicsLabel.of(label).views)] == [5, 10, 20, 40]
    assert study.groups["calibration"].frames == 40


def test_more_views_than_there_are(tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    file.write_text(TEXT.replace("calibrated:6", f"calibrated:{VIEWS + 1}"))
    with pytest.raises(StudyError, match=r"s\.yaml:\d+:\d+: .*`calibrated:9` needs 9 views, but group .* has 8$"):
        load_study(file)


def test_a_camera_file_of_views_is_a_camera(dataset: Dataset, tmp_path: Path) -> None:
    solve = SolveSection(intrinsics=["calibrated:3"], calibrate_from="calibration")
    _, files = calibrate_study(dataset.path, solve, tmp_path / "all.json", tmp_path)
    assert read_camera(files["calibrated:3"]).K[0, 0] == pytest.approx(600, rel=2e-3)
