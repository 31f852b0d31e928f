"""Wrong units on the command line and in studies are warned of in one line each."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import pytest
from helpers_studies import SMALL

from roundel.cli.main import main
from roundel.cli.plausibility import implausible_arguments


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"diameter_m": 80.0}, "--diameter-m 80: a print of 80 m; lengths are in metres: 80 mm are 0.08"),
        ({"spacing_m": 25.0}, "--spacing-m 25: a print of 25 m"),
        ({"intrinsics": ["focal:26"]}, "focal:26: a focal length of 26 px is very short"),
        ({"intrinsics": ["focal:26+-1"]}, "give focal35:26"),
        ({"intrinsics": ["focal35:0.026"]}, "if it is 0.026 m, give focal35:26"),
        ({"intrinsics": ["default", "focal35:3100"]}, "if it is 3100 px, give focal:3100"),
    ],
)
def test_each_wrong_unit_is_one_line(given: dict[str, object], words: str) -> None:
    lines = implausible_arguments(Namespace(**given))
    assert len(lines) == 1
    assert words in lines[0]


def test_right_units_are_not_warned_of() -> None:
    labels = ["focal:3100+-60", "focal:231", "focal35:26+-1", "focal35:13", "focal35:800", "default", "exif", "true"]
    assert implausible_arguments(Namespace(diameter_m=0.08, spacing_m=1.5, intrinsics=labels)) == []
    assert implausible_arguments(Namespace(diameter_m=None, intrinsics=None)) == []


def test_check_warns_on_stderr_and_still_checks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(SMALL.replace("0.08", "80") + "solve: {intrinsics: ['focal:26']}\n")
    assert main(["check", str(path)]) == 0
    out, err = capsys.readouterr()
    warnings = [line for line in err.splitlines() if "warning" in line]
    assert len(warnings) == 2
    assert f"{path}:5:" in warnings[0]
    assert "80 mm are 0.08" in warnings[0]
    assert f"{path}:14:1: solve: --intrinsics focal:26" in warnings[1]
    assert "dataset_id" in out


def test_solve_warns_before_it_solves(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = str(tmp_path / "none.jpg")
    main(["solve", missing, str(tmp_path / "o"), "--diameter-m", "80", "--intrinsics", "focal:26"])
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "roundel: warning: --diameter-m 80: a print of 80 m; lengths are in metres: 80 mm are 0.08"
    assert lines[1].startswith("roundel: warning: --intrinsics focal:26")
