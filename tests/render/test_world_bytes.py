"""Datasets in a world: bytes do not depend on threads, jobs, order, a process's earlier frames, or interruptions."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helpers_studies import digests, finished_frames, small_study

from roundel.datasets.layout import files
from roundel.render.run import render_study
from roundel.scenes.study.study import Study

LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}\n"

# Two groups, so that a process changes between the variants without and with colours.
GROUPS = "groups: {indoors: {world: tabletop}, outdoors: {world: outdoor, frames: 2}}\n"


def world_study(folder: Path) -> Study:
    """Frames of 96x72 on a table and outdoors, in few rays."""
    return small_study(
        folder,
        ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 96, height_px: 72, focal_px: 192"),
        ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: {uniform: [-12, 12]}"),
        ("band_samples: 256", "target_error: 0.1, background_error: 0.3"),
        (LIGHT, GROUPS),
    )


def render_in_a_process(folder: Path, *options: str) -> None:
    """`roundel render` in a process of its own, which has rendered nothing before."""
    command = [sys.executable, "-m", "roundel.cli.main", "render", str(folder / "study.yaml"), str(folder / "ds")]
    subprocess.run([*command, *options], check=True, capture_output=True, timeout=300)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory) -> Path:
    """The study, rendered at one go with two threads."""
    folder = tmp_path_factory.mktemp("rendered")
    render_study(world_study(folder), folder / "ds", threads=2)
    return folder


def test_one_thread_gives_the_same_bytes(rendered: Path, tmp_path: Path) -> None:
    render_study(world_study(tmp_path), tmp_path / "ds", threads=1)
    assert digests(tmp_path / "ds") == digests(rendered / "ds")


@pytest.mark.slow
def test_two_processes_give_the_same_bytes(rendered: Path, tmp_path: Path) -> None:
    render_study(world_study(tmp_path), tmp_path / "ds", jobs=2, threads=1)
    assert digests(tmp_path / "ds") == digests(rendered / "ds")


@pytest.mark.slow
def test_a_frame_is_the_same_first_and_last_in_a_process(rendered: Path, tmp_path: Path) -> None:
    world_study(tmp_path)
    # Frames 3 and 5 come last in their groups; here each is the first of its process.
    for part in ("5:6", "3:5", "0:3"):
        render_in_a_process(tmp_path, "--frames", part)
    assert digests(tmp_path / "ds") == digests(rendered / "ds")


@pytest.mark.slow
def test_killed_and_resumed_gives_the_same_bytes(rendered: Path, tmp_path: Path) -> None:
    study = world_study(tmp_path)
    command = [sys.executable, "-m", "roundel.cli.main", "render", str(tmp_path / "study.yaml"), str(tmp_path / "ds")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and len(finished_frames(tmp_path / "ds", study)) < 1 and process.poll() is None:
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    # A frame takes half a second: the kill comes in time.
    assert 1 <= len(finished_frames(tmp_path / "ds", study)) < 6, "the process was to be killed in the middle"
    kept = (tmp_path / "ds" / files.image_name(0)).stat().st_mtime_ns
    render_in_a_process(tmp_path)
    assert digests(tmp_path / "ds") == digests(rendered / "ds")
    assert (tmp_path / "ds" / files.image_name(0)).stat().st_mtime_ns == kept
