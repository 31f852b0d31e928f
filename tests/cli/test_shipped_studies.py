"""Shipped studies by name: `roundel studies`, `roundel init`, and names in place of study files."""

import re
from pathlib import Path

import pytest

import roundel
from roundel.cli.main import main
from roundel.cli.verbs.studies import find_study
from roundel.configs.shipped import starting_point, study_names, study_path, study_summary
from roundel.datasets import environment
from roundel.scenes.study.study import load_study


def test_every_shipped_study_has_a_line_that_says_what_it_is_for() -> None:
    for name in study_names():
        assert load_study(study_path(name)).name == name
        # A line of the list fits a terminal of 120 columns beside the longest name.
        assert 20 < len(study_summary(name)) <= 100, name


def test_studies_are_listed_a_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["studies"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == study_names()


def test_a_study_is_printed_as_it_ships(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["studies", "demo"]) == 0
    assert capsys.readouterr().out == study_path("demo").read_text(encoding="utf-8")


def test_a_shipped_name_stands_for_its_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "demo"]) == 0
    assert load_study(study_path("demo")).digest() in capsys.readouterr().out


def test_a_file_of_that_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_study("demo") == study_path("demo")
    Path("demo").write_text("schema: 1\n")
    assert find_study("demo") == Path("demo")


@pytest.mark.parametrize("words", [["check", "dem0"], ["studies", "dem0"], ["init", "FILE", "--from", "dem0"]])
def test_an_unknown_name_gets_a_suggestion(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "new.yaml"
    assert main([str(file) if word == "FILE" else word for word in words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not file.exists()


def test_suggestion_names_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "dem0"]) == 2
    assert "did you mean demo?" in capsys.readouterr().err


def test_a_path_is_never_taken_for_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "nowhere/demo.yaml"]) == 2
    assert "nowhere/demo.yaml" in capsys.readouterr().err


def test_init_writes_a_study_that_checks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.yaml"
    assert main(["init", str(file)]) == 0
    assert file.read_text(encoding="utf-8") == starting_point()
    assert main(["check", str(file)]) == 0
    assert "8 frames" in capsys.readouterr().out


def test_init_from_a_shipped_study(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    assert main(["init", str(file), "--from", "noise"]) == 0
    assert load_study(file).digest() == load_study(study_path("noise")).digest()


def test_init_overwrites_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("mine")
    assert main(["init", str(file)]) == 2
    assert "already exists" in capsys.readouterr().err
    assert file.read_text() == "mine"


def test_init_in_a_folder_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["init", str(tmp_path / "no" / "mine.yaml")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def cache_key_of(study: str, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["check", study, "--cache-key"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    return line


def test_the_key_of_a_cache_changes_with_what_the_frames_depend_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = cache_key_of("demo", capsys)
    # It names a folder, and GitHub's keys take no commas.
    assert re.fullmatch(rf"roundel-{re.escape(roundel.__version__)}-[0-9a-f]{{12}}-[0-9a-f]{{8}}", own)
    text = study_path("demo").read_text(encoding="utf-8")
    (tmp_path / "copy.yaml").write_text(f"# another comment\n{text}", encoding="utf-8")
    (tmp_path / "seed.yaml").write_text(text.replace("seed: 7", "seed: 8"), encoding="utf-8")
    assert cache_key_of(str(tmp_path / "copy.yaml"), capsys) == own
    assert cache_key_of(str(tmp_path / "seed.yaml"), capsys) != own
    installed = dict(environment.versions())
    for package in ("roundel", "mitsuba"):
        changed = tuple({**installed, package: "0.1.0"}.items())
        monkeypatch.setattr(environment, "_versions", lambda changed=changed: changed)
        assert cache_key_of("demo", capsys) != own
