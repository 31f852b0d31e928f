"""The paper's synthetic experiment, through study, solver and validator, against published tables.

Tables: errata of the paper, section 5: means over 300 trials of an independent implementation; isotropic noise of 1 px,
as many points as the perimeter has pixels, maximum-likelihood fit, the candidate nearer to the truth, marker on axis.
"""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from roundel.render.run import render_study
from roundel.scenes.study.study import load_study
from roundel.solver.methods.solve import solve_dataset
from roundel.validate.validate import validate_dataset

CONFIG = Path(__file__).resolve().parents[2] / "configs" / "paper_points.yaml"
TRIALS_OF_TABLES = 300

# distance_D: by tilt of 15, 30, 45 degrees.
NORMAL_DEG = {
    15: ("1.11", ".54", ".40"),
    20: ("1.71", ".81", ".58"),
    25: ("2.41", "1.23", ".81"),
    30: ("3.12", "1.52", "1.12"),
    35: ("4.05", "2.03", "1.40"),
    40: ("4.75", "2.56", "1.80"),
    45: ("5.69", "2.98", "2.00"),
    50: ("6.77", "3.51", "2.35"),
}
# distance_D: by focal multiplier of 0.7, 0.85, 1, 1.15, 1.3, at a tilt of 30 degrees.
POSITION_D = {
    15: ("4.50", "2.25", ".031", "2.24", "4.49"),
    20: ("6.01", "3.01", ".065", "2.98", "5.98"),
    25: ("7.52", "3.78", ".112", "3.71", "7.46"),
    30: ("9.04", "4.55", ".181", "4.43", "8.92"),
    35: ("10.58", "5.35", ".272", "5.12", "10.35"),
    40: ("12.07", "6.08", ".380", "5.89", "11.88"),
    45: ("13.62", "6.89", ".521", "6.56", "13.28"),
    50: ("15.19", "7.73", ".683", "7.20", "14.66"),
}
# distance_D: by focal multiplier of 0.7, 1, 1.3, at a tilt of 30 degrees; 3x3 grid of +-3 D.
REPROJECTION_PX = {
    15: ("9.09", ".93", "4.93"),
    20: ("5.22", "1.02", "2.92"),
    25: ("3.55", "1.21", "2.13"),
    30: ("2.66", "1.26", "1.73"),
    35: ("2.28", "1.41", "1.65"),
    40: ("2.03", "1.53", "1.66"),
    45: ("1.92", "1.59", "1.67"),
    50: ("1.92", "1.71", "1.75"),
}


@pytest.fixture(scope="module", params=[30, pytest.param(TRIALS_OF_TABLES, marks=pytest.mark.slow)])
def scores(request, tmp_path_factory) -> dict:
    """Errors by (intrinsics, distance_D, tilt_deg), from a tenth of the trials of the tables and from as many."""
    trials = request.param
    folder = tmp_path_factory.mktemp("paper")
    text = CONFIG.read_text().replace("frames_per_cell: 300", f"frames_per_cell: {trials}")
    # The tables of N = 200 are not needed here; half the time is.
    text = text.replace("  n200: {points: {count: 200, sigma_px: 1}}\n", "")
    (folder / "study.yaml").write_text(text)
    study = load_study(folder / "study.yaml")
    assert list(study.groups) == ["perimeter"]
    render_study(study, folder / "dataset")
    solve_dataset(folder / "dataset", folder / "estimates", methods=("ml",), intrinsics=tuple(study.solve.intrinsics))
    validate_dataset(folder / "dataset", [folder / "estimates"], folder / "report")
    rows = pq.read_table(folder / "report" / "scores.parquet").to_pylist()
    assert len(rows) == 24 * trials * 5
    assert all(row["solved"] for row in rows)
    cells: dict = {}
    for row in rows:
        cells.setdefault((row["intrinsics"], round(row["distance_D"]), round(row["tilt_deg"])), []).append(row)
    return cells


def disagreement(rows: list[dict], column: str, printed: str) -> float:
    """Distance from the printed mean in standard errors of the difference, beyond half its last digit."""
    values = np.array([row[column] for row in rows])
    half_digit = 0.5 * 10.0 ** -len(printed.split(".")[1])
    error = values.std(ddof=1) * np.sqrt(1 / len(values) + 1 / TRIALS_OF_TABLES)
    return float((abs(values.mean() - float(printed)) - half_digit) / error)


@pytest.mark.parametrize("distance", NORMAL_DEG)
def test_normal_errors_are_those_of_the_tables(scores: dict, distance: int) -> None:
    for tilt, printed in zip((15, 30, 45), NORMAL_DEG[distance], strict=True):
        for label in ("scaled:0.7", "scaled:1", "scaled:1.3"):  # on the axis the focal length does not matter
            assert disagreement(scores[label, distance, tilt], "oracle_normal_error_deg", printed) < 4


@pytest.mark.parametrize("distance", POSITION_D)
def test_position_errors_are_those_of_the_tables(scores: dict, distance: int) -> None:
    for factor, printed in zip(("0.7", "0.85", "1", "1.15", "1.3"), POSITION_D[distance], strict=True):
        rows = scores[f"scaled:{factor}", distance, 30]
        assert disagreement(rows, "oracle_position_error_D", printed) < 4


@pytest.mark.parametrize("distance", REPROJECTION_PX)
def test_reprojection_errors_are_those_of_the_tables(scores: dict, distance: int) -> None:
    for factor, printed in zip(("0.7", "1", "1.3"), REPROJECTION_PX[distance], strict=True):
        rows = scores[f"scaled:{factor}", distance, 30]
        assert disagreement(rows, "oracle_reprojection_error_px", printed) < 4
