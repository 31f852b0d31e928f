"""Kills at random moments: the same command goes on, ends with the same bytes, and leaves neither file nor process."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helpers_studies import digests, small_study

TINY = (
    ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 64, height_px: 48, focal_px: 128"),
    ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: {uniform: [-5, 5]}"),
    ("band_samples: 256", "band_samples: 64"),
    ("frames: 4", "frames: 40"),
)
# Kills of each command; `test_faults` has every single call.
KILLS = {"render": 60, "render, two jobs": 40, "develop": 30, "merge": 20, "solve": 30, "validate": 20}


def command(name: str, folder: Path, out: Path) -> list[str]:
    words = {
        "render": ["render", "study.yaml", out],
        "render, two jobs": ["render", "study.yaml", out, "--jobs", "2"],
        "develop": ["develop", "made", out, "--sensor", "sensor.yaml"],
        "merge": ["merge", "one", "two", out],
        "solve": ["solve", "made", out, "--intrinsics", "true", "--intrinsics", "default"],
        "validate": ["validate", "made", "estimates", "--out", out],
    }[name]
    return [sys.executable, "-m", "roundel.cli.main", *map(str, words)]


def run(words: list[str], folder: Path) -> None:
    done = subprocess.run(words, cwd=folder, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    small_study(folder, *TINY)
    (folder / "sensor.yaml").write_text("sweep: {key: sensor.full_well_e, levels: [4000, 400]}\n")
    for words in (["made"], ["one", "--slice", "1/2"], ["two", "--slice", "2/2"]):
        run([sys.executable, "-m", "roundel.cli.main", "render", "study.yaml", *words], folder)
    run(command("solve", folder, folder / "estimates"), folder)
    return folder


def of_group(group: int) -> list[str]:
    """Living processes of a process group."""
    listed = subprocess.run(["ps", "-eo", "pgid,stat,args"], check=True, capture_output=True, text=True).stdout
    rows = [line.split(None, 2) for line in listed.splitlines()[1:]]
    return [row[2] for row in rows if row[0] == str(group) and not row[1].startswith("Z")]


@pytest.mark.slow
@pytest.mark.parametrize("name", list(KILLS))
def test_killed_at_random_moments(made: Path, tmp_path: Path, name: str) -> None:
    chance = random.Random(name)
    words = command(name, made, tmp_path / "out")
    began = time.monotonic()
    run(words, made)
    longest = time.monotonic() - began
    right = digests(tmp_path / "out")
    killed = 0
    while killed < KILLS[name]:
        # A group of its own, so that what is left of it can be found.
        process = subprocess.Popen(
            words, cwd=made, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True, text=True
        )
        try:
            _, said = process.communicate(timeout=chance.uniform(0.3, 1.1) * longest)
        except subprocess.TimeoutExpired:
            os.kill(process.pid, signal.SIGKILL)
            process.communicate()
            killed += 1
        else:
            assert process.returncode == 0, said
            assert digests(tmp_path / "out") == right
            shutil.rmtree(tmp_path / "out")
        until = time.monotonic() + 5
        while of_group(process.pid) and time.monotonic() < until:
            time.sleep(0.02)
        assert of_group(process.pid) == []
    run(words, made)
    assert digests(tmp_path / "out") == right


@pytest.mark.slow
def test_sixteen_slices_started_and_killed_at_random(made: Path, tmp_path: Path) -> None:
    chance = random.Random(16)
    small_study(tmp_path, *TINY)
    words = [sys.executable, "-m", "roundel.cli.main", "render", "study.yaml", "ds", "--threads", "1", "--slice"]

    def started(number: int) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [*words, f"{number}/16"], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )

    left = {number: started(number) for number in range(1, 17)}
    for _ in range(24):
        time.sleep(chance.uniform(0.1, 1.5))
        running = [number for number, process in left.items() if process.poll() is None]
        if running:
            number = chance.choice(running)
            left[number].kill()
            left[number].communicate()
            left[number] = started(number)
    for process in left.values():
        _, said = process.communicate(timeout=300)
        assert process.returncode == 0, said
    assert (tmp_path / "ds" / "manifest.json").exists(), "whoever was last finished it"
    run(command("render", made, tmp_path / "alone"), made)
    assert digests(tmp_path / "ds") == digests(tmp_path / "alone")
