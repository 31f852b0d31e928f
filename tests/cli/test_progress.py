"""Progress: long commands report their progress on stderr; short ones do not report their steps."""

from pathlib import Path

import pytest
from helpers_studies import SMALL

from roundel.cli import progress
from roundel.cli.main import main


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "study.yaml"
    path.write_text("mode: points\n" + SMALL)
    return path


def test_a_short_check_is_silent(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(file)]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("words", [["check"], ["render"]])
def test_a_long_check_says_how_far_it_is(
    words: list[str], file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Each frame is long then.
    monkeypatch.setattr(progress, "_SECONDS_BETWEEN_LINES", 0.0)
    assert main([*words, str(file), *([str(file.parent / "ds")] if words == ["render"] else [])]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert [line.rpartition(",")[0] for line in lines if line.startswith("check: ")] == [
        f"check: {done} of 4 frames" for done in (1, 2, 3, 4)
    ]
