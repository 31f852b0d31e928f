"""Datasets on disk: bytes do not depend on threads, order or interruptions; no finished frame is lost."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from helpers_light import write_map
from helpers_studies import SMALL, digests, finished_frames, small_study

from roundel.datasets.dataset import open_dataset
from roundel.datasets.layout import files
from roundel.datasets.layout.images import open_images
from roundel.render.run import render_study
from roundel.scenes.errors import DataError, UsageError


@pytest.fixture(scope="module")
def rendered(tmp_path_factory) -> Path:
    """The small study, rendered at one go with two threads."""
    folder = tmp_path_factory.mktemp("rendered")
    render_study(small_study(folder), folder / "ds", threads=2)
    return folder


def test_a_dataset_is_complete_and_verifies(rendered: Path) -> None:
    dataset = open_dataset(rendered / "ds")
    assert len(dataset) == 4
    assert dataset.truth.num_rows == 4
    assert dataset.verify(full=True) == []
    flags = {"saturated": 0, "dark": 0, "occluded": 0}
    counts = {"frames": 4, "images": 4, "markers": 4, "groups": {"main": 4}, "flags": flags}
    assert dataset.manifest["counts"] == counts
    assert dataset.manifest["fidelity"]["circles"] == 4
    assert all(v > 50 for v in dataset.truth["edge_contrast_dn"].to_pylist())
    assert str(rendered) not in (rendered / "ds" / files.MANIFEST).read_text()


def test_what_a_solver_opens_holds_no_truth(rendered: Path) -> None:
    images = open_images(rendered / "ds")
    assert images.image(0).shape == (120, 160)
    assert images.camera(0).K[0, 0] == 320
    assert images.markers(0) == [{"marker_id": 0, "kind": "disc", "diameter_m": 0.08, "layout": {}}]
    text = (rendered / "ds" / files.CAMERAS).read_text()
    assert not [word for word in ("normal", "tilt", "distance") if word in text]


def test_one_thread_gives_the_same_bytes(rendered: Path, tmp_path: Path) -> None:
    render_study(small_study(tmp_path), tmp_path / "ds", threads=1)
    assert digests(tmp_path / "ds") == digests(rendered / "ds")


def test_another_order_gives_the_same_bytes(rendered: Path, tmp_path: Path) -> None:
    study = small_study(tmp_path)
    assert render_study(study, tmp_path / "ds", frames=range(2, 4)) is None
    with pytest.raises(DataError, match="not finished"):
        open_images(tmp_path / "ds")
    assert render_study(study, tmp_path / "ds", frames=range(2)) is not None
    assert digests(tmp_path / "ds") == digests(rendered / "ds")


def test_one_thread_reads_a_map(tmp_path: Path) -> None:
    # In a process of its own, which may be killed: with one thread, Mitsuba 3.9.1 waits forever for an EXR file.
    write_map(tmp_path / "map.exr", np.ones((8, 16, 3)))
    lamp = "environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]"
    study = small_study(tmp_path, (lamp, "map: {file: map.exr}"))
    command = [sys.executable, "-m", "roundel.cli.main", "render", str(study.path), str(tmp_path / "ds")]
    subprocess.run([*command, "--threads", "1", "--frames", "0:1"], check=True, capture_output=True, timeout=120)


def test_two_processes_give_the_same_bytes(rendered: Path, tmp_path: Path) -> None:
    render_study(small_study(tmp_path), tmp_path / "ds", jobs=2, threads=1)
    assert digests(tmp_path / "ds") == digests(rendered / "ds")


def test_killed_and_resumed_gives_the_same_bytes(tmp_path: Path) -> None:
    # Enough frames that the kill comes in time even where the renderer leaves little of the processor to this test.
    study = small_study(tmp_path, ("frames: 4", "frames: 30"))
    render_study(study, tmp_path / "whole")
    command = [sys.executable, "-m", "roundel.cli.main", "render", str(tmp_path / "study.yaml"), str(tmp_path / "ds")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and len(finished_frames(tmp_path / "ds", study)) < 1 and process.poll() is None:
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    done = len(finished_frames(tmp_path / "ds", study))
    assert 1 <= done < 30, "the process was to be killed in the middle"
    # As a crash may leave it: a half-written temporary file, and a journal line cut short.
    (tmp_path / "ds" / "images" / ".000009.png.x.part").write_bytes(b"half")
    (log,) = (tmp_path / "ds" / "log").iterdir()
    with log.open("ab") as file:
        file.write(b'{"entry":{"frame_id":9,"fi')
    kept = (tmp_path / "ds" / files.image_name(0)).stat().st_mtime_ns
    subprocess.run(command, check=True, capture_output=True)
    assert digests(tmp_path / "ds") == digests(tmp_path / "whole")
    assert (tmp_path / "ds" / files.image_name(0)).stat().st_mtime_ns == kept


def test_a_damaged_frame_is_found_and_made_again(rendered: Path, tmp_path: Path) -> None:
    study = small_study(tmp_path)
    dataset = render_study(study, tmp_path / "ds")
    image, radiance = (tmp_path / "ds" / name(1) for name in (files.image_name, files.radiance_name))
    image.write_bytes(image.read_bytes()[:-50])
    data = bytearray(radiance.read_bytes())
    data[len(data) // 2] ^= 0xFF
    radiance.write_bytes(bytes(data))
    assert [f.name for f in dataset.verify()] == ["images/000001.png"]
    assert [f.name for f in dataset.verify(full=True)] == ["images/000001.png", "radiance/000001.exr"]
    with pytest.raises(DataError, match=r"bytes, but .* were recorded"):
        dataset.images.image(1)
    radiance.unlink()
    render_study(study, tmp_path / "ds")
    assert digests(tmp_path / "ds") == digests(rendered / "ds")


def test_another_study_is_refused_and_nothing_touched(rendered: Path, tmp_path: Path) -> None:
    before = digests(rendered / "ds")
    changed = small_study(tmp_path, ("seed: 3", "seed: 4"))
    with pytest.raises(UsageError, match="another study"):
        render_study(changed, rendered / "ds")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "holiday.jpg").write_bytes(b"x")
    with pytest.raises(UsageError, match="is not empty"):
        render_study(small_study(tmp_path), tmp_path / "full")
    with pytest.raises(UsageError, match="is a file"):
        render_study(small_study(tmp_path), tmp_path / "study.yaml")
    assert digests(rendered / "ds") == before


def test_a_corrupt_journal_or_manifest_is_said(rendered: Path, tmp_path: Path) -> None:
    study = small_study(tmp_path)
    render_study(study, tmp_path / "ds")
    (tmp_path / "ds" / files.MANIFEST).write_text("{")
    with pytest.raises(DataError, match="manifest is corrupt"):
        open_dataset(tmp_path / "ds")
    (tmp_path / "ds" / files.JOURNAL).write_text("rubbish\n")
    said: list[str] = []
    assert render_study(study, tmp_path / "ds", on_warning=said.append) is not None
    assert "1 damaged lines are left out; their frames are rendered again" in said[0]
    assert digests(tmp_path / "ds") == digests(rendered / "ds")


def test_a_full_disk_is_one_line_and_keeps_what_is_finished(tmp_path: Path) -> None:
    # Only root can mount a disk that is too small: a limit on the size of files fails the same writes.
    (tmp_path / "study.yaml").write_text(SMALL)
    script = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000));"
        "import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "from roundel.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", script, "render", str(tmp_path / "study.yaml"), str(tmp_path / "ds")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 4
    assert "Traceback" not in done.stderr
    assert done.stderr.strip().splitlines()[-1].startswith("roundel: ")
    assert "cannot write" in done.stderr or "disk is full" in done.stderr
    assert not list((tmp_path / "ds").rglob("*.part"))


def test_points_mode_needs_no_renderer(tmp_path: Path) -> None:
    study = small_study(tmp_path, ("frames: 4", "frames: 4\nmode: points\npoints: {sigma_px: 0.5}"))
    script = (
        "import sys; sys.modules['mitsuba'] = None;"
        "from roundel.render.run import render_study; render_study(*sys.argv[1:])"
    )
    subprocess.run([sys.executable, "-c", script, str(study.path), str(tmp_path / "ds")], check=True, timeout=300)
    dataset = open_dataset(tmp_path / "ds")
    points = dataset.images.points(0)[0]
    row = dataset.truth.to_pylist()[0]
    assert dataset.images.mode(0) == "points"
    assert len(points) == pytest.approx(2 * 3.1416 * (row["ellipse_a_px"] * row["ellipse_b_px"]) ** 0.5, rel=0.05)
    assert json.loads((tmp_path / "ds" / files.MANIFEST).read_text())["counts"]["images"] == 0
    assert dataset.verify(full=True) == []
