"""Tiny and odd studies, and odd arguments: each gives a report, or one clear line and the right exit status."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from roundel.cli.main import main

HEAD = """\
schema: 1
name: odd
camera: {width_px: 320, height_px: 240, focal_px: 400}
marker: {kind: disc, diameter_m: 0.08}
"""
POSE = "pose: {distance_D: 6, tilt_deg: 30}\n"
GRID = "pose: {distance_D: {grid: [4, 6, 8]}, tilt_deg: {grid: [15, 30, 45]}}\n"
SCALED = 'solve: {intrinsics: ["true", "scaled:0.7"]}\n'
# No image is rendered: what is odd here lies behind the renderer.
POINTS = "mode: points\n"


REPORTS = {
    "one frame": POINTS + POSE + "frames: 1\n",
    "one frame, two cameras": POINTS + POSE + "frames: 1\n" + SCALED,
    "one frame a cell": POINTS + GRID + "frames_per_cell: 1\n",
    "one frame a cell, two cameras": POINTS + GRID + "frames_per_cell: 1\n" + SCALED,
    "two frames a cell, two cameras": POINTS + GRID + "frames_per_cell: 2\n" + SCALED,
    "one distance": POINTS + "pose: {distance_D: {grid: [6]}, tilt_deg: {grid: [30]}}\nframes_per_cell: 1\n" + SCALED,
    "two distances": POINTS + "pose: {distance_D: {grid: [4, 8]}, tilt_deg: 30}\nframes_per_cell: 1\n" + SCALED,
    "many distances": POINTS + "pose: {distance_D: {uniform: [4, 9]}, tilt_deg: 30}\nframes: 9\n" + SCALED,
    "only tilts": POINTS + "pose: {distance_D: 6, tilt_deg: {grid: [15, 30, 45]}}\nframes_per_cell: 1\n" + SCALED,
    "no tilt": POINTS + "pose: {distance_D: 6, tilt_deg: 0}\nframes: 2\n",
    "no noise": POINTS + POSE + "points: {sigma_px: 0}\nframes: 3\n" + SCALED,
    "much noise": POINTS + POSE + "points: {sigma_px: 30}\nframes: 3\n",
    "few points": POINTS + POSE + "points: {count: 6}\nframes: 3\n",
    "one level": POINTS + POSE + "frames: 2\nsweep: {key: points.sigma_px, levels: [1]}\n",
    "two levels of one frame": POINTS + POSE + "frames: 1\nsweep: {key: points.sigma_px, levels: [0, 1]}\n",
    "one level twice": POINTS + POSE + "frames: 2\nsweep: {key: points.sigma_px, levels: [1, 1]}\n",
    "falling levels": POINTS + POSE + "frames: 2\nsweep: {key: points.sigma_px, levels: [2, 1]}\n",
    "negative levels": POINTS + POSE + "frames: 2\nsweep: {key: pose.offset_x_px, levels: [-20, 0, 20]}\n",
    "no true camera": POINTS + POSE + "frames: 2\nsolve: {intrinsics: [default]}\n",
    "one camera twice": POINTS + POSE + 'frames: 2\nsolve: {intrinsics: ["true", "scaled:1"]}\n',
    "two groups of one frame": POINTS + POSE + "groups: {a: {frames: 1}, b: {frames: 1}}\n" + SCALED,
    "groups named alike": POINTS + POSE + "groups: {on_axis: {frames: 1}, on-axis: {frames: 1}}\n" + SCALED,
    "a group named in Greek": POINTS + POSE + "groups: {\u03b1: {frames: 2}}\n" + SCALED,
    "one group solved": POINTS + POSE + "groups: {a: {frames: 1}, b: {frames: 1}}\nsolve: {groups: [a]}\n",
    "a name with spaces": POINTS.replace("mode", "mode") + POSE + "frames: 2\nlicence: a b  c\n",
    "a tiny marker": POINTS + "pose: {distance_D: 200}\nframes: 2\n",
    "a marker of a millimetre": POINTS + POSE + "marker: {kind: disc, diameter_m: 0.001}\nframes: 2\n",
    "at the corner": POINTS + "pose: {distance_D: 6, offset_x_px: 150, offset_y_px: 110}\nframes: 2\n",
    "no seed but the largest": POINTS + POSE + f"seed: {2**63 - 1}\nframes: 2\n",
    "every frame declared": POINTS + POSE + "frames: 2\nsolve: {knowledge: same_side}\n",
}

LINES = {
    "no frames": POSE + "frames: 0\n",
    "frames that do not divide": GRID + "frames: 10\n",
    "a mapping that is a word": POSE + "frames: 1\nlight: {map: sky}\n",
    "a section that is a number": POSE + "frames: 1\nsensor: 5\n",
    "true without quotes": POSE + "frames: 1\nsolve: {intrinsics: [true]}\n",
    "a list that is a word": POSE + "frames: 1\nsolve: {groups: main}\n",
    "a sweep of an unknown key": POSE + "frames: 1\nsweep: {key: camera.focl_px, levels: [1]}\n",
    "a sweep of an unknown section": POSE + "frames: 1\nsweep: {key: foo, levels: [1]}\n",
    "a sweep out of range": POSE + "frames: 1\nsweep: {key: pose.tilt_deg, levels: [99]}\n",
    "a sweep into a number": POSE + "frames: 1\nsweep: {key: camera.focal_px.x, levels: [1]}\n",
}


def study(text: str, folder: Path) -> Path:
    """HEAD and what a case adds; a key that the case has takes the place of HEAD's."""
    keys = {line.split(":")[0] for line in text.splitlines()}
    file = folder / "a study.yaml"
    head = "".join(f"{line}\n" for line in HEAD.splitlines() if line.split(":")[0] not in keys)
    file.write_text(head + text, encoding="utf-8")
    return file


@pytest.mark.parametrize("case", REPORTS)
def test_an_odd_study_ends_in_a_report(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["run", str(study(REPORTS[case], tmp_path)), str(tmp_path / "the out")])
    err = capsys.readouterr().err
    assert code == 0, err
    assert "internal error" not in err
    assert (tmp_path / "the out" / "report" / "report.html").stat().st_size > 10_000


@pytest.mark.parametrize("case", LINES)
def test_a_wrong_study_is_one_line_at_its_place(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = study(LINES[case], tmp_path)
    assert main(["check", str(file)]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "internal error" not in err
    # Neither Python's types nor pydantic's, and never the first line of the file where the key is known.
    assert not any(word in err for word in ("instance of", "dictionary", "Section", "valid string", "True"))
    assert f"{file}:1:1:" not in err


def test_an_image_study_of_one_frame_ends_in_a_report(tmp_path: Path) -> None:
    text = POSE + "frames: 1\nrender: {band_samples: 64, radiance: false}\n" + SCALED
    assert main(["run", str(study(text, tmp_path)), str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "report" / "report.html").is_file()


@pytest.fixture
def solved(tmp_path: Path) -> Path:
    assert main(["run", str(study(REPORTS["one frame"], tmp_path)), str(tmp_path / "out")]) == 0
    return tmp_path / "out"


def test_results_are_not_written_into_a_dataset(solved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dataset, estimates = str(solved / "dataset"), str(solved / "estimates")
    before = {path.name: path.read_bytes() for path in (solved / "dataset").iterdir() if path.is_file()}
    capsys.readouterr()
    for words in (["solve", dataset, dataset], ["validate", dataset, estimates, "--out", dataset]):
        assert main(words) == 2
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        assert "is a dataset; name another folder" in err
    assert {path.name: path.read_bytes() for path in (solved / "dataset").iterdir() if path.is_file()} == before


def test_an_ascii_terminal_gets_its_output(solved: Path) -> None:
    command = [str(Path(sys.executable).parent / "roundel")]
    words = ["validate", str(solved / "dataset"), str(solved / "estimates"), "--out", str(solved / "again")]
    run = subprocess.run(
        [*command, *words],
        capture_output=True,
        check=False,
        timeout=120,
        env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"},
    )
    assert run.returncode == 0, run.stderr
    run.stdout.decode("ascii")
