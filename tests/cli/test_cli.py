"""The command: exit status, one-line errors, never a traceback; and a full run from study to report."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from helpers_studies import SMALL

from roundel.cli.main import main

RUN = SMALL.replace("frames: 4", 'frames: 4\nsolve: {methods: [ml, direct], intrinsics: ["true", default]}')


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """A small study, run to its report."""
    folder = tmp_path_factory.mktemp("run")
    (folder / "study.yaml").write_text(RUN)
    assert main(["run", str(folder / "study.yaml"), str(folder / "out")]) == 0
    return folder


def call(capsys, *arguments: object) -> tuple[int, str, str]:
    """Exit code, stdout, stderr of the command."""
    try:
        code = main([str(a) for a in arguments])
    except SystemExit as stop:  # argparse's own
        code = int(stop.code or 0)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def refused(capsys, code: int, words: str, *arguments: object) -> None:
    """The command ends with `code` and one line that has `words`."""
    got, _, err = call(capsys, *arguments)
    last = err.strip().splitlines()[-1]
    assert got == code, err
    assert words in last
    assert "Traceback" not in err


def test_a_run_ends_with_a_report(finished: Path, capsys) -> None:
    out = finished / "out"
    assert {p.name for p in out.iterdir()} == {"dataset", "estimates", "report"}
    scores = pq.read_table(out / "report" / "scores.parquet")
    assert scores.num_rows == 4 * 2 * 2
    rows = [r for r in scores.to_pylist() if r["intrinsics"] == "true" and r["method"] == "ml"]
    assert all(r["solved"] for r in rows)
    # 40 px across, 8 bit with noise: tenths of a degree; a swapped axis or a lost half pixel would be degrees.
    assert max(r["oracle_normal_error_deg"] for r in rows) < 2.0
    assert max(r["oracle_position_error_pct"] for r in rows) < 1.0
    assert all(r["normal_error_deg"] is None and r["branch_correct"] is None for r in rows)
    summary = json.loads((out / "report" / "summary.json").read_text())
    assert summary
    report = (out / "report" / "report.html").read_text()
    assert "http://" not in report.replace("http://www.w3.org", "")
    assert "<script" not in report


def test_the_steps_one_by_one_give_the_same_records(finished: Path, tmp_path: Path, capsys) -> None:
    dataset, estimates, report = (finished / "out" / name for name in ("dataset", "estimates", "report"))
    assert call(capsys, "solve", dataset, tmp_path / "est")[0] == 0
    assert call(capsys, "validate", dataset, tmp_path / "est", "--out", tmp_path / "rep")[0] == 0
    one, other = estimates / "estimates.parquet", tmp_path / "est" / "estimates.parquet"
    assert one.read_bytes() == other.read_bytes()
    assert (report / "scores.parquet").read_bytes() == (tmp_path / "rep" / "scores.parquet").read_bytes()
    assert (report / "report.html").read_bytes() == (tmp_path / "rep" / "report.html").read_bytes()


def test_the_solver_needs_no_truth(finished: Path, tmp_path: Path, capsys) -> None:
    blind = tmp_path / "blind"
    shutil.copytree(finished / "out" / "dataset", blind)
    for name in ("truth.parquet", "truth.csv", "study.yaml", "journal.jsonl"):
        (blind / name).unlink()
    shutil.rmtree(blind / "radiance")
    assert call(capsys, "solve", blind, tmp_path / "est")[0] == 0
    one, other = (p / "estimates.parquet" for p in (finished / "out" / "estimates", tmp_path / "est"))
    assert one.read_bytes() == other.read_bytes()


def test_verify_and_check_say_what_they_found(finished: Path, capsys) -> None:
    code, out, _ = call(capsys, "verify", finished / "out" / "dataset", "--full")
    assert code == 0
    assert "all checksums match" in out
    assert "fidelity over 4 circles" in out
    code, out, _ = call(capsys, "check", finished / "study.yaml")
    assert code == 0
    assert "group main: 4 frames" in out
    assert json.loads(call(capsys, "check", "--schema")[1])["title"] == "Roundel study"


def test_doctor_is_well_here(capsys) -> None:
    code, out, _ = call(capsys, "doctor")
    assert code == 0
    assert "mitsuba" in out
    assert "no problems found" in out


def test_wrong_arguments_are_usage_errors(finished: Path, tmp_path: Path, capsys) -> None:
    study, dataset = finished / "study.yaml", finished / "out" / "dataset"
    refused(capsys, 2, "cannot read the study", "check", tmp_path / "none.yaml")
    refused(capsys, 2, "give a STUDY", "check")
    refused(capsys, 2, "give frames as A:B", "render", study, tmp_path / "x", "--frames", "a:b")
    refused(capsys, 2, "no frames in this range", "render", study, tmp_path / "x", "--frames", "3:3")
    refused(capsys, 2, "whole number", "render", study, tmp_path / "x", "--jobs", "0")
    refused(capsys, 2, "ml", "solve", dataset, tmp_path / "e", "--method", "mll")
    refused(capsys, 2, "scaled", "solve", dataset, tmp_path / "e", "--intrinsics", "scaled:-1")
    refused(capsys, 2, "default", "solve", dataset, tmp_path / "e", "--intrinsics", "defualt")
    refused(capsys, 2, "the dataset has main", "solve", dataset, tmp_path / "e", "--group", "mian")
    assert call(capsys)[0] == 2


def test_a_study_with_an_unknown_method_is_refused_before_rendering(tmp_path: Path, capsys) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(RUN.replace("[ml, direct]", "[mll]"))
    refused(capsys, 2, f"{path}:14:1: solve: ", "run", path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_is_no_dataset_is_said(finished: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "empty").mkdir()
    for verb in ("solve", "validate", "verify", "calibrate"):
        for folder in (tmp_path / "none", tmp_path / "empty"):
            extra = {"solve": [tmp_path / "e"], "validate": [tmp_path / "e", "--out", tmp_path / "r"]}
            more = extra.get(verb, [tmp_path / "camera.json"] if verb == "calibrate" else [])
            refused(capsys, 4, str(folder), verb, folder, *more)


def test_damage_is_said_with_exit_code_4(finished: Path, tmp_path: Path, capsys) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(finished / "out" / "dataset", copy)
    image = copy / "images" / "000002.png"
    image.write_bytes(image.read_bytes()[:1000])
    refused(capsys, 4, "the dataset is damaged; problems found: 1", "verify", copy)
    refused(capsys, 4, "000002.png", "solve", copy, tmp_path / "e")
    (copy / "manifest.json").unlink()
    refused(capsys, 4, "manifest is missing", "verify", copy)
    # The frames that there are can be solved, and this one is not what was recorded.
    refused(capsys, 4, "000002.png", "solve", copy, tmp_path / "e")


def test_estimates_that_are_none(finished: Path, tmp_path: Path, capsys) -> None:
    dataset = finished / "out" / "dataset"
    got, _, err = call(capsys, "validate", dataset, tmp_path / "none", "--out", tmp_path / "r")
    assert got in (2, 4)
    assert "Traceback" not in err
    (tmp_path / "bad.parquet").write_bytes(b"PAR1 nonsense")
    got, _, err = call(capsys, "validate", dataset, tmp_path / "bad.parquet", "--out", tmp_path / "r")
    assert got in (2, 3, 4)
    assert "bad.parquet" in err
    assert "Traceback" not in err


def test_an_interrupted_render_ends_with_130_and_goes_on_later(tmp_path: Path) -> None:
    # Enough frames that the signal comes in time even where the renderer leaves little of the processor to this test.
    (tmp_path / "study.yaml").write_text(SMALL.replace("frames: 4", "frames: 40"))
    command = [sys.executable, "-m", "roundel.cli.main", "render", str(tmp_path / "study.yaml"), str(tmp_path / "ds")]

    def heed_interrupts() -> None:
        # A shell starts what it runs in the background with SIGINT ignored, and children inherit that.
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    pipe = subprocess.PIPE
    # The function only resets a signal: nothing in it can wait for another thread.
    process = subprocess.Popen(
        command,
        stdout=pipe,
        stderr=pipe,
        text=True,
        preexec_fn=heed_interrupts,  # noqa: PLW1509
    )
    deadline = time.monotonic() + 120
    journal = tmp_path / "ds" / "log"
    while time.monotonic() < deadline and not journal.exists() and process.poll() is None:
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert err.strip().splitlines()[-1] == "roundel: interrupted; rendered frames are kept"
    assert "Traceback" not in err
    assert subprocess.run(command, check=False, capture_output=True).returncode == 0


def test_a_bug_is_one_line_too(monkeypatch, capsys) -> None:
    from roundel.cli.verbs import chain

    def broken(arguments: object) -> int:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(chain, "do_doctor", broken)
    monkeypatch.delenv("ROUNDEL_DEBUG", raising=False)
    refused(capsys, 4, "internal error: ZeroDivisionError: a bug", "doctor")


@pytest.fixture(scope="module")
def photograph(tmp_path_factory) -> Path:
    """A black disc on white paper, as a phone would save it."""
    import numpy as np
    from helpers_images import picture
    from PIL import Image

    path = tmp_path_factory.mktemp("photograph") / "shot.png"
    Image.fromarray(np.asarray(picture([((150.0, 110.0, 40.0, 31.0, 20.0), 30)], 320, 240, blur_px=0.8))).save(path)
    return path


def test_photographs_from_the_command(photograph: Path, tmp_path: Path, capsys) -> None:
    code, out, _ = call(capsys, "solve", photograph, tmp_path / "o", "--diameter-m", "0.08", "--knowledge", "wall:5")
    assert code == 0
    assert "1 circle at" in out
    assert "default phone model: 29.95 mm" in out
    assert {p.name for p in (tmp_path / "o").iterdir()} == {
        "estimates.parquet",
        "estimates.json",
        "estimates.csv",
        "overlays",
    }
    cut = tmp_path / "cut.png"
    cut.write_bytes(photograph.read_bytes()[:500])
    code, out, err = call(capsys, "solve", cut, photograph, tmp_path / "o2", "--diameter-m", "0.08")
    assert code == 4
    assert "1 circle at" in out
    assert [line for line in err.splitlines() if "cut.png" in line and "truncated" in line]


def test_wrong_arguments_about_photographs(photograph: Path, finished: Path, tmp_path: Path, capsys) -> None:
    dataset, out = finished / "out" / "dataset", tmp_path / "o"
    refused(capsys, 2, "need --diameter-m", "solve", photograph, out)
    refused(capsys, 2, "positive number", "solve", photograph, out, "--diameter-m", "-1")
    refused(
        capsys,
        2,
        "a photograph's camera is not known",
        "solve",
        photograph,
        out,
        "--diameter-m",
        1,
        "--intrinsics",
        "true",
    )
    refused(capsys, 2, "is a file", "solve", photograph, photograph, "--diameter-m", 1)
    refused(capsys, 2, "leave it out", "solve", dataset, out, "--diameter-m", 1)
    refused(capsys, 2, "a single dataset", "solve", dataset, photograph, out, "--diameter-m", 1)
    refused(capsys, 2, "no photographs match", "solve", photograph.parent / "*.jpg", out, "--diameter-m", 1)
    refused(capsys, 2, "did you mean wall", "solve", photograph, out, "--diameter-m", 1, "--knowledge", "wal")
    assert not out.exists()


def test_a_marker_from_the_command(tmp_path: Path, capsys) -> None:
    code, out, _ = call(
        capsys, "marker", "ring", tmp_path / "m.pdf", "--diameter-m", 0.08, "--set", "inner_diameter_m=0.05"
    )
    assert code == 0
    assert "print it at 100 %" in out
    assert (tmp_path / "m.pdf").read_bytes().startswith(b"%PDF")
    refused(capsys, 2, "did you mean disc", "marker", "disk", tmp_path / "m.pdf")
    refused(capsys, 2, "does not fit on a4", "marker", "disc", tmp_path / "m.pdf", "--diameter-m", 0.5)
