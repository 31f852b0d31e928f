"""Levels of a sensor that saw the same radiance: paired in one report, and between reports of developed datasets."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import pytest
from helpers_reports import estimate_rows, failed_row, write_estimates
from helpers_studies import small_study

from roundel.datasets.dataset import Dataset
from roundel.render.redevelop import develop_dataset
from roundel.render.run import render_study
from roundel.validate.report.compare import compare_reports
from roundel.validate.validate import validate_dataset

FRAMES = 24
TINY = (
    ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 64, height_px: 48, focal_px: 128"),
    ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: {uniform: [-5, 5]}"),
    ("band_samples: 256", "samples: 8, band_samples: 8"),
    ("frames: 4", f"frames: {FRAMES}"),
)


def rows_at(dataset: Dataset, *noise_px: float) -> list[dict[str, Any]]:
    """Estimates whose noise is that of a level: the same draws, larger or smaller."""
    return [
        row
        for level, noise in enumerate(noise_px)
        for row in estimate_rows(dataset, ["true"], noise)[: 2 * FRAMES]
        for row in [{**row, "frame_id": row["frame_id"] + level * FRAMES}]
    ]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Reports of a rendered dataset, of it at two levels (three times the noise at the second), and of these again."""
    folder = tmp_path_factory.mktemp("made")
    dataset = render_study(small_study(folder, *TINY), folder / "ds")
    assert dataset is not None
    reports: dict[str, tuple[Dataset, tuple[float, ...]]] = {"plain": (dataset, (0.01,))}
    # Words as levels need no number.
    (folder / "sweep.yaml").write_text("sweep: {key: sensor.curve, levels: [linear, srgb]}")
    (folder / "again.yaml").write_text("read_noise_e: 9")
    swept = develop_dataset(dataset.path, folder / "swept", folder / "sweep.yaml")
    again = develop_dataset(swept.path, folder / "again", folder / "again.yaml")
    reports |= {"curves": (swept, (0.01, 0.03)), "noisy": (again, (0.02, 0.06))}
    for name, (mine, noise) in reports.items():
        rows = rows_at(mine, *noise)
        if name == "curves":
            rows = [row for row in rows if row["frame_id"] < 2 * FRAMES - 3]
            rows += [failed_row(i, "true") for i in range(2 * FRAMES - 3, 2 * FRAMES)]
        file = write_estimates(folder / f"{name}.parquet", rows)
        validate_dataset(mine.path, [file], folder / f"of_{name}")
    return folder


def rows_of(folder: Path, name: str) -> list[dict[str, Any]]:
    return list(csv.DictReader((folder / "tables" / f"{name}.csv").read_text().splitlines()))


def test_levels_of_a_report_are_compared_in_pairs(made: Path) -> None:
    rows = rows_of(made / "of_curves", "level_comparisons")
    assert [row["error"].split()[0] for row in rows] == ["normal", "position", "reprojection"]
    assert {(row["first"], row["second"], row["frames"]) for row in rows} == {("linear", "srgb", str(FRAMES - 3))}
    # The same draws, three times as large, by the scale of one level: neither 1 nor a ratio of the levels' bounds.
    assert all(2.5 < float(row["ratio_rms"]) < 3.5 for row in rows)
    assert all(float(row["ratio_low"]) > 2 and row["better"] == "linear" for row in rows)
    (lost,) = rows_of(made / "of_curves", "level_solved_by_one")
    assert (lost["circles"], lost["only_first"], lost["only_second"]) == (str(FRAMES), "3", "0")
    html = (made / "of_curves" / "report.html").read_text()
    assert 'id="figure-levels"' in html
    assert 'id="figure-sweep-main-sensor.curve"' in html
    assert "has doubled at" not in html
    assert not (made / "of_plain" / "tables" / "level_comparisons.csv").exists()


def test_a_developed_dataset_is_compared_with_the_rendered_one(made: Path, tmp_path: Path) -> None:
    said = compare_reports([made / "of_plain", made / "of_curves"], tmp_path)
    assert said[0].startswith("2 reports are of the same radiance under different sensors (rendered as dataset ")
    assert not any("different datasets" in line for line in said)
    rows = rows_of(tmp_path, "sensor_comparisons")
    assert [row["second"] for row in rows] == 3 * ["of_curves, curve linear"] + 3 * ["of_curves, curve srgb"]
    assert {row["better"] for row in rows[:3]} == {"identical"}
    assert all(2.5 < float(row["ratio_rms"]) < 3.5 and row["better"] == "of_plain" for row in rows[3:])
    (line,) = [line for line in said if line.startswith("Normal")]
    assert "Normal [deg], ml, true: the RMS of of_curves, curve srgb is " in line
    assert "that of of_plain." in line
    html = (tmp_path / "compare.html").read_text()
    assert 'id="figure-sensors"' in html
    assert (tmp_path / "figures" / "sensors.svg").is_file()
    assert rows_of(tmp_path, "sensor_solved_by_one")[1]["only_first"] == "3"


def test_so_are_two_that_come_from_one(made: Path, tmp_path: Path) -> None:
    compare_reports([made / "of_curves", made / "of_noisy", made / "of_plain"], tmp_path)
    rows = rows_of(tmp_path, "sensor_comparisons")
    pairs = list(dict.fromkeys((row["first"], row["second"]) for row in rows))
    assert pairs == [
        ("of_curves, curve linear", "of_noisy, curve linear"),
        ("of_curves, curve srgb", "of_noisy, curve srgb"),
        ("of_curves, curve linear", "of_plain"),
        ("of_curves, curve srgb", "of_plain"),
    ]
    assert all(1.8 < float(row["ratio_rms"]) < 2.2 for row in rows[:6])
    assert all(float(row["ratio_rms"]) < 0.4 for row in rows[-3:])
