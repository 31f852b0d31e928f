"""The gate from the command line: exit status, files, and one line if there is nothing to compare."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pyarrow.parquet as pq
import pytest
from helpers_reports import POINTS, estimate_rows, failed_row, make_dataset, write_estimates

from roundel.cli.main import main
from roundel.cli.parser import build_parser
from roundel.datasets.store.records import document_of
from roundel.scenes.errors import RoundelError
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import total_frames
from roundel.validate.gate.baseline import read_baseline
from roundel.validate.gate.gate import Frame
from roundel.validate.gate.output import replay_command
from roundel.validate.metrics.metric import METRIC_VERSION

RUN = "scaled:1"


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A dataset of 36 circles, the report of a good solver on it, and that report as a baseline."""
    folder = tmp_path_factory.mktemp("gate")
    dataset = make_dataset(folder / "dataset", POINTS)
    report(folder, "good", estimate_rows(dataset, [RUN], noise_px=0.01))
    accept = ["baseline", "accept", str(folder / "good"), "--baseline", str(folder / "b.parquet"), "--reason", "first"]
    assert main(accept) == 0
    return folder, dataset


def report(folder, name, rows):
    file = write_estimates(folder / f"{name}.parquet", rows)
    assert main(["validate", str(folder / "dataset"), str(file), "--out", str(folder / name)]) == 0
    return folder / name


def gate(folder, name, *more):
    return main(["gate", str(folder / name), "--baseline", str(folder / "b.parquet"), *more])


def test_the_same_report_is_identical(world, capsys):
    folder, _ = world
    assert gate(folder, "good") == 0
    out = capsys.readouterr().out
    assert out.startswith("identical")
    assert out.rstrip().endswith("gate: passed")


def test_a_worse_solver_ends_with_1_and_says_so_everywhere(world, capsys, monkeypatch):
    folder, dataset = world
    report(folder, "bad", estimate_rows(dataset, [RUN], noise_px=0.3))
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(folder / "summary.md"))
    capsys.readouterr()
    assert gate(folder, "bad", "--junit", str(folder / "gate.xml")) == 1
    out = capsys.readouterr().out
    assert "gate: WORSE" in out
    assert "roundel solve DATASET OUT --frames" in out
    assert int(ElementTree.parse(folder / "gate.xml").getroot().attrib["failures"]) > 0
    assert "**worse**" in (folder / "summary.md").read_text()


def test_the_replay_command_replays(world):
    folder, _ = world
    words = replay_command(Frame("ml, scaled:1", 3, 0, 1.0, "")).replace("DATASET", str(folder / "dataset")).split()
    assert words.pop(0) == "roundel"
    assert main([str(folder / "again") if word == "OUT" else word for word in words]) == 0
    table = pq.read_table(folder / "again" / "estimates.parquet")
    assert set(table["frame_id"].to_pylist()) == {3}


def test_a_method_of_a_file_is_shown_and_not_solved(world, capsys):
    folder, dataset = world
    for name, noise in (("before", 0.01), ("after", 0.3)):
        report(folder, name, estimate_rows(dataset, [RUN], noise_px=noise, method="my csv"))
    accept = ["baseline", "accept", str(folder / "before"), "--baseline", str(folder / "c.parquet"), "--reason", "csv"]
    assert main(accept) == 0
    capsys.readouterr()
    assert main(["gate", str(folder / "after"), "--baseline", str(folder / "c.parquet")]) == 1
    out = capsys.readouterr().out
    assert "roundel solve" not in out
    line = next(line for line in out.splitlines() if "roundel browse" in line)
    number = re.search(r"frame (\d+), marker", line)[1]
    assert line.endswith(f"PAGE/index.html#frame-{number}; frame_id {number} in the file of my csv")
    words = shlex.split(line[line.index("roundel browse") :], comments=True)[1:]
    places = {"DATASET": folder / "dataset", "REPORT": folder / "after", "PAGE": folder / "page"}
    assert main([str(places.get(word, word)) for word in words]) == 0
    assert (folder / "page" / "index.html").is_file()


def test_no_samples_end_with_3_and_one_line(world, capsys, monkeypatch):
    folder, dataset = world
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(folder / "refused.md"))
    report(folder, "failed", [failed_row(i, RUN) for i in dataset.images.frame_ids])
    capsys.readouterr()
    assert gate(folder, "failed", "--junit", str(folder / "refused.xml")) == 3
    assert ElementTree.parse(folder / "refused.xml").getroot().attrib["errors"] == "1"
    assert "nothing compared" in (folder / "refused.md").read_text()
    accept = ["baseline", "accept", str(folder / "failed"), "--baseline", str(folder / "x.parquet"), "--reason", "x"]
    assert main(accept) == 3
    empty = write_estimates(folder / "empty.parquet", [])
    assert main(["validate", str(folder / "dataset"), str(empty), "--out", str(folder / "empty")]) == 3
    shutil.copytree(folder / "good", folder / "hollow")
    scores = folder / "hollow" / "scores.parquet"
    pq.write_table(pq.read_table(scores).slice(0, 0), scores)
    assert gate(folder, "hollow") == 4
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    assert "0 circles were solved by both" in lines[0]
    assert "0 circles are solved" in lines[1]
    assert "no rows" in lines[2]
    assert "scores.parquet is not the file that summary.json was made from" in lines[3]


def test_junit_is_written_whatever_goes_wrong(world, capsys, tmp_path):
    folder, _ = world
    for name, baseline, code in (("good", "nosuch.parquet", 2), ("nosuch", "b.parquet", 2)):
        file = tmp_path / f"{name}.xml"
        words = ["gate", str(folder / name), "--baseline", str(folder / baseline), "--junit", str(file)]
        assert main(words) == code
        error = ElementTree.parse(file).getroot().find(".//error")
        assert error.attrib["message"] in capsys.readouterr().err
    (tmp_path / "bent.parquet").write_bytes(b"PAR1")
    words = ["gate", str(folder / "good"), "--baseline", str(tmp_path / "bent.parquet")]
    assert main([*words, "--junit", str(tmp_path / "bent.xml")]) == 4
    assert ElementTree.parse(tmp_path / "bent.xml").getroot().attrib["errors"] == "1"


def test_the_history_of_reasons_is_kept(world, capsys):
    folder, _ = world
    again = ["baseline", "accept", str(folder / "good"), "--baseline", str(folder / "b.parquet")]
    assert main([*again, "--reason", "  the\nsame  again "]) == 0
    assert main([*again, "--reason", " "]) == 2
    assert [entry["reason"] for entry in read_baseline(folder / "b.parquet").accepted] == ["first", "the same again"]
    capsys.readouterr()
    assert main(["baseline", "log", str(folder / "b.parquet")]) == 0
    first, second, about = capsys.readouterr().out.splitlines()
    assert first.endswith(": first")
    assert (second[:2], second.rpartition(": ")[2]) == ("2.", "the same again")
    assert "36 scores of dataset" in about
    assert main(["baseline", "log", str(folder / "nosuch.parquet")]) == 2


def test_whoever_accepts_at_the_same_time_keeps_every_reason(world):
    folder, _ = world
    words = [sys.executable, "-m", "roundel.cli.main", "baseline", "accept", str(folder / "good")]
    file = folder / "many.parquet"
    many = [subprocess.Popen([*words, "--baseline", str(file), "--reason", f"reason {i}"]) for i in range(3)]
    assert [process.wait() for process in many] == [0] * 3
    assert sorted(entry["reason"] for entry in read_baseline(file).accepted) == [f"reason {i}" for i in range(3)]
    assert [path.name for path in folder.iterdir() if path.name.startswith(".")] == []


def test_a_changed_byte_in_report_or_baseline_is_named(world, capsys):
    folder, _ = world
    shutil.copytree(folder / "good", folder / "bent")
    for name in ("summary.json", "scores.parquet"):
        file = folder / "bent" / name
        whole = file.read_bytes()
        for at in range(0, len(whole), max(1, len(whole) // 40)):
            file.write_bytes(whole[:at] + bytes([whole[at] ^ 4]) + whole[at + 1 :])
            assert gate(folder, "bent") == 4, at
            assert name in capsys.readouterr().err
        file.write_bytes(whole)
    assert gate(folder, "bent") == 0
    baseline = folder / "bent.parquet"
    whole = (folder / "b.parquet").read_bytes()
    kept = read_baseline(folder / "b.parquet")
    for at in range(0, len(whole), max(1, len(whole) // 200)):
        baseline.write_bytes(whole[:at] + bytes([whole[at] ^ 4]) + whole[at + 1 :])
        try:
            found = read_baseline(baseline)
        except RoundelError as error:
            assert str(baseline) in str(error)  # noqa: PT017 - some bytes mean nothing
        else:
            # A byte that Parquet pads with, or keeps for readers of parts of a file.
            assert found.rows.equals(kept.rows)
            assert found.accepted == kept.accepted


def test_a_report_of_another_metric_version_is_refused(world, capsys):
    folder, _ = world
    shutil.copytree(folder / "good", folder / "old")
    summary = folder / "old" / "summary.json"
    facts = json.loads(summary.read_text())
    summary.write_bytes(document_of({**facts, "metric_version": 0}))
    capsys.readouterr()
    assert gate(folder, "old") == 3
    assert "metric version 0" in capsys.readouterr().err


def test_the_ready_workflows_use_commands_that_exist():
    commands = []
    for file in sorted((Path(__file__).resolve().parents[3] / "docs" / "ci").iterdir()):
        for line in file.read_text().splitlines():
            words = line.partition(" #")[0].split()
            if "roundel" in words[:-1] and "install" not in words:
                commands.append(words[words.index("roundel") + 1 :])
    assert {words[0] for words in commands} == {"render", "verify", "solve", "validate", "gate"}
    for words in commands:
        build_parser().parse_args(words)


def test_the_shipped_baseline_is_of_the_shipped_benchmark():
    root = Path(__file__).resolve().parents[3]
    baseline = read_baseline(root / "benchmarks" / "baseline.parquet")
    study = load_study(root / "configs" / "benchmark.yaml")
    assert baseline.dataset_id == study.digest()
    assert baseline.metric_version == METRIC_VERSION
    assert baseline.rows.num_rows == total_frames(study)
    assert all(entry["reason"] for entry in baseline.accepted)
    assert (root / "benchmarks" / "baseline.parquet").stat().st_size < 300_000
