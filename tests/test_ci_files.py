"""The CI files and the commands of docs/gate.md, run as they are written on a clean runner: green, then red."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import junitparser
import pytest
import yaml
from helpers_runner import Job, Runner, github, gitlab

HOUSE = Path(__file__).resolve().parents[1]
CI = HOUSE / "docs" / "ci"
GITHUB, GITLAB = ((CI / name).read_text(encoding="utf-8") for name in ("github-actions.yml", "gitlab-ci.yml"))

# It stands in for `benchmark`, which takes ten minutes: the same gate with 48 frames. The files say that STUDY is the
# user's, and this file is what they name as an example.
MINE = {"STUDY": "accuracy/benchmark.yaml"}
STUDY = """schema: 1
name: small
seed: 3
camera: {width_px: 160, height_px: 120, focal_px: 640}
marker: {kind: disc, diameter_m: 0.08}
pose:
  distance_D: {uniform: [8, 20]}
  tilt_deg: {uniform: [15, 60]}
  azimuth_deg: {uniform: [-180, 180]}
sensor: {full_well_e: 10000, read_noise_e: 5}
frames: 24
groups:
  sharp: {}
  noise: {sensor: {full_well_e: 600, read_noise_e: 10}}
"""
RIGHT, WRONG = "normal=poses.normal,", "normal=poses.normal * [-1.0, 1.0, 1.0],"


def blocks(page: str) -> list[str]:
    """The indented blocks of commands of a page, without their comments."""
    found = re.findall(r"(?:^    .*\n)+", page, flags=re.M)
    return ["".join(line[4:].split("  #")[0].rstrip() + "\n" for line in block.splitlines()) for block in found]


@pytest.fixture(scope="module")
def accuracy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The user's folder: the wheel that the files name, a study, and a baseline made as docs/gate.md says."""
    runner = Runner(tmp_path_factory.mktemp("mine"))
    folder = runner.checkout / "accuracy"
    folder.mkdir()
    (folder / "benchmark.yaml").write_text(STUDY, encoding="utf-8")
    # pip builds in a copy of what git knows: what lies about in a checkout gets into no wheel.
    source = tmp_path_factory.mktemp("source")
    listed = subprocess.run(["git", "-C", HOUSE, "ls-files", "-z"], check=True, capture_output=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(HOUSE / name, source / name)
    wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, source]
    subprocess.run(wheel, check=True)
    first, again = blocks((HOUSE / "docs" / "gate.md").read_text(encoding="utf-8"))[:2]
    assert first.count(" benchmark ") == 1
    script = first.replace(" benchmark ", f" {MINE['STUDY']} ") + again
    ended = runner.bash(f"git init --quiet .\nset -e\n{script}", {})
    assert ended.returncode == 0, ended.stdout
    assert "gate: passed" in ended.stdout
    return folder


def fresh(folder: Path, accuracy: Path) -> Runner:
    runner = Runner(folder)
    shutil.copytree(accuracy, runner.checkout / "accuracy")
    return runner


def next_job(runner: Runner) -> None:
    """Nothing is left of the last job but what the service keeps, and the environment with what pip installed."""
    shutil.rmtree(runner.checkout / "out")


def plant_a_bug(runner: Runner) -> None:
    """Flip the sign of the normal's x in the installed solver."""
    file = runner.site_packages / "roundel" / "solver" / "methods" / "pose_estimate.py"
    text = file.read_text(encoding="utf-8")
    assert text.count(RIGHT) == 1
    file.write_text(text.replace(RIGHT, WRONG), encoding="utf-8")


def junit_of(runner: Runner) -> junitparser.JUnitXml:
    return junitparser.JUnitXml.fromfile(str(runner.checkout / "out" / "gate.xml"))


def is_green(job: Job, runner: Runner) -> None:
    assert job.failed is None, job.output
    assert "gate: passed" in job.output
    seen = junit_of(runner)
    assert seen.tests > 0  # one, where images and scores are the same to the last digit
    assert (seen.failures, seen.errors) == (0, 0)


def is_red(job: Job, runner: Runner, at: str) -> None:
    assert at in (job.failed or ""), job.output
    assert job.status == 1
    seen = junit_of(runner)
    assert seen.failures > 0
    assert seen.errors == 0
    names = {
        case.name for suite in seen for case in suite if any(isinstance(r, junitparser.Failure) for r in case.result)
    }
    assert any("normal" in name for name in names), names


@pytest.mark.slow
def test_the_github_file_as_it_is_written(tmp_path: Path, accuracy: Path) -> None:
    runner = fresh(tmp_path, accuracy)
    is_green(github(runner, GITHUB, "gate", MINE), runner)
    (key,) = (path.name for path in runner.kept.iterdir())
    assert key.startswith("roundel-0.2.0-")
    images = images_of(runner.checkout / "out" / "dataset")
    next_job(runner)
    plant_a_bug(runner)
    job = github(runner, GITHUB, "gate", MINE)
    is_red(job, runner, "Gate")
    assert "actions/cache/save@v4" in job.skipped
    assert images_of(runner.checkout / "out" / "dataset") == images  # nothing was rendered again
    assert "**worse**" in (tmp_path / "GITHUB_STEP_SUMMARY").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_gitlab_file_as_it_is_written(tmp_path: Path, accuracy: Path) -> None:
    runner = fresh(tmp_path, accuracy)
    (runner.kept / "roundel" / "roundel-0.1.0-stale").mkdir(parents=True)
    is_green(gitlab(runner, GITLAB, MINE), runner)
    (kept,) = (runner.kept / "roundel").iterdir()  # the older version's is gone
    images = images_of(kept)
    next_job(runner)
    plant_a_bug(runner)
    is_red(gitlab(runner, GITLAB, MINE), runner, "roundel gate")
    assert images_of(runner.checkout / "out" / "datasets" / kept.name) == images


def images_of(dataset: Path) -> dict[str, int]:
    """Images and when they were written."""
    found = {path.name: path.stat().st_mtime_ns for path in (dataset / "images").iterdir()}
    assert len(found) == 48
    return found


def test_both_files_run_the_same_commands() -> None:
    steps = yaml.safe_load(GITHUB)["jobs"]["gate"]["steps"]
    one = [line for step in steps for line in step.get("run", "").splitlines()]
    (job,) = yaml.safe_load(GITLAB).values()
    verbs = [re.findall(r"roundel (\w+)", "\n".join(lines)) for lines in (one, job["script"])]
    assert verbs[0] == [*verbs[1]]
    assert verbs[0] == ["check", "render", "verify", "solve", "validate", "gate"]
