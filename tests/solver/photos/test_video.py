"""Videos from file to table and overlay, and videos that end early or are none."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_video import CAMERA, HEIGHT, WIDTH, encoded, image_of, pose, write_video

import roundel
from roundel.cli.main import main
from roundel.scenes.errors import DataError, UsageError
from roundel.solver.photos import video as module
from roundel.solver.photos.video import solve_video
from roundel.solver.photos.video_file import open_video

COUNT = 36
FOCAL = "focal:300"


def at(i: int) -> np.ndarray:
    return pose([0.05 * np.sin(1.8 * i / 30) - 0.02, 0.01, 0.55], 40, 30)


@pytest.fixture(scope="module")
def frames():
    return [encoded(image_of([at(i)], seed=i)) for i in range(COUNT)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, frames):
    """The same frames as several files."""
    path = tmp_path_factory.mktemp("videos")
    write_video(path / "good.avi", frames)
    write_video(path / "good.mp4", frames, "mp4v")
    write_video(path / "good.mkv", frames, "FFV1")
    good = (path / "good.avi").read_bytes()
    (path / "cut.avi").write_bytes(good[: len(good) * 6 // 10])
    (path / "codec.avi").write_bytes(good.replace(b"MJPG", b"ZZZZ"))
    (path / "cut.mp4").write_bytes((path / "good.mp4").read_bytes()[:-400])
    (path / "empty.mp4").write_bytes(b"")
    (path / "noise.mp4").write_bytes(np.random.default_rng(0).integers(0, 256, 4000, dtype=np.uint8).tobytes())
    small = [cv2.resize(frame, (160, 120)) for frame in frames]
    jpeg = [cv2.imencode(".jpg", f)[1].tobytes() for f in (*frames[:20], *small[20:])]
    (path / "sizes.mjpeg").write_bytes(b"".join(jpeg))
    cv2.VideoWriter(str(path / "none.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (WIDTH, HEIGHT)).release()
    deep = [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U, cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    writer = cv2.VideoWriter(
        str(path / "deep.mkv"), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 30.0, (WIDTH, HEIGHT), deep
    )
    if writer.isOpened():
        for frame in frames[:3]:
            writer.write(frame[..., 0].astype(np.uint16) * 257)
        writer.release()
    return path


def test_a_video_becomes_a_table_and_an_overlay(folder, tmp_path):
    seen = []
    result = solve_video(folder / "good.mkv", tmp_path, 0.08, FOCAL, progress=lambda *now: seen.append(now))
    assert (result.frames, result.markers, result.measured, result.problem) == (COUNT, 1, COUNT, "")
    assert seen[0] == (0, COUNT)
    assert seen[-1] == (COUNT, COUNT)
    rows = pq.read_table(tmp_path / "estimates.parquet").to_pylist()
    assert [r["frame_id"] for r in rows] == [i for i in range(COUNT) for _ in (0, 1)]
    assert {r["track_id"] for r in rows} == {0}
    assert {(r["method"], r["intrinsics"], r["status"]) for r in rows} == {("pixels", "focal:300", "ok")}
    # FFV1 loses nothing: the poses are those of the sequence, to its noise.
    for row in (r for r in rows if r["chosen"] and r["frame_id"] >= 30):
        true = at(row["frame_id"])
        normal = np.array([row["normal_x"], row["normal_y"], row["normal_z"]])
        assert roundel.normal_error_deg(normal, true[:3, 2]) < 1.0
        centre = np.array([row["centre_x_m"], row["centre_y_m"], row["centre_z_m"]])
        assert np.linalg.norm(centre - true[:3, 3]) < 0.003
    assert sum(r["chosen"] for r in rows if r["frame_id"] >= 30) == COUNT - 30
    timings = [json.loads(line) for line in (tmp_path / "timings.jsonl").read_text().splitlines()]
    assert [t["frame_id"] for t in timings] == list(range(COUNT))
    assert timings[-1]["time_s"] == pytest.approx((COUNT - 1) / 30, abs=1e-3)  # Matroska's times are milliseconds
    pictures = [picture for _, picture in open_video(tmp_path / "overlay.mp4")]
    assert len(pictures) == COUNT
    # Enlarged three times, with the contour's green on it and a strip below.
    assert pictures[0].shape[1] == 3 * WIDTH
    assert pictures[0].shape[0] > 3 * HEIGHT
    green = np.all(np.abs(pictures[-1].astype(int) - np.array([190, 224, 0])) < 40, axis=2)
    assert np.count_nonzero(green) > 200
    assert sorted(p.name for p in tmp_path.iterdir()) == ["estimates.parquet", "overlay.mp4", "timings.jsonl"]


def test_results_do_not_depend_on_the_size_of_the_parts(folder, tmp_path, monkeypatch):
    solve_video(folder / "good.avi", tmp_path / "one", 0.08, FOCAL)
    monkeypatch.setattr(module, "_PART", 7)
    solve_video(folder / "good.avi", tmp_path / "many", 0.08, FOCAL)
    one, many = ((tmp_path / name / "estimates.parquet").read_bytes() for name in ("one", "many"))
    assert one == many


def test_a_marker_out_of_sight_and_a_frame_without_any_have_rows(tmp_path, frames):
    blank = encoded(image_of([]))
    write_video(tmp_path / "v.avi", [blank, *frames[:8], blank])
    solve_video(tmp_path / "v.avi", tmp_path / "out", 0.08)
    rows = pq.read_table(tmp_path / "out" / "estimates.parquet").to_pylist()
    told = [(r["frame_id"], r["detection_id"], r["track_id"], r["reason"]) for r in rows if r["status"] == "failed"]
    assert told == [(0, -1, None, "no circle found"), (9, 0, 0, "not seen in this frame")]


@pytest.mark.parametrize(
    ("name", "used", "sentence"),
    [
        ("cut.avi", None, r"cut short: only \d+ of 36 frames can be decoded, and were used"),
        ("sizes.mjpeg", 20, "frame 20 has 160x120 px, but the video began with 320x240; only the 20 frames before it"),
    ],
)
def test_a_video_that_ends_early_is_used_to_its_end(folder, tmp_path, capsys, name, used, sentence):
    status = main(["solve", str(folder / name), str(tmp_path), "--diameter-m", "0.08"])
    said = capsys.readouterr()
    assert status == 4
    lines = [line for line in said.err.splitlines() if line.startswith("roundel:")]
    assert len(lines) == 1
    assert re.search(sentence, lines[0])
    frames_used = int(said.out.split(": ")[1].split()[0])
    assert 15 <= frames_used < COUNT
    assert used in (None, frames_used)
    ids = pq.read_table(tmp_path / "estimates.parquet")["frame_id"].to_pylist()
    assert set(ids) == set(range(frames_used))
    assert len(list(open_video(tmp_path / "overlay.mp4"))) == frames_used


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("cut.mp4", r"cut short: the index at the end of this video \(moov\) is missing"),
        ("codec.avi", "it lacks the codec ZZZZ"),
        ("empty.mp4", "this file is empty"),
        ("noise.mp4", "this is not a video"),
        ("none.avi", "no frame of this video can be decoded"),
        ("missing.mp4", "cannot read: No such file"),
        ("deep.mkv", "16-bit pixels, which OpenCV's decoder cuts to 8 bits"),
    ],
)
def test_what_cannot_be_decoded_is_one_line(folder, tmp_path, capfd, name, sentence):
    if name == "deep.mkv" and not (folder / name).exists():
        pytest.skip("this OpenCV cannot write 16-bit video")
    with pytest.raises(DataError, match=sentence) as caught:
        solve_video(folder / name, tmp_path / "out", 0.08)
    assert "\n" not in str(caught.value)
    assert str(folder / name) in str(caught.value)
    assert capfd.readouterr().err == ""
    assert list(tmp_path.rglob("*.*")) == []


def test_neither_opencv_nor_ffmpeg_writes_lines_of_its_own(folder, tmp_path):
    environment = {k: v for k, v in os.environ.items() if k != "OPENCV_FFMPEG_LOGLEVEL"}
    command = [Path(sys.executable).parent / "roundel", "solve", folder / "cut.mp4", tmp_path, "--diameter-m", "0.08"]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, env=environment)
    assert run.returncode == 4
    assert run.stderr.startswith(f"roundel: {folder / 'cut.mp4'}: cut short")
    assert run.stderr.count("\n") == 1


def test_a_killed_overlay_leaves_nothing(folder, tmp_path):
    def stop(done: int, total: int) -> None:
        if done == 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve_video(folder / "good.avi", tmp_path / "out", 0.08, progress=stop)
    assert list((tmp_path / "out").iterdir()) == []


def test_wrong_arguments(folder, tmp_path, capsys):
    video = str(folder / "good.avi")
    with pytest.raises(UsageError, match="positive number of metres"):
        solve_video(video, tmp_path, -1.0)
    with pytest.raises(UsageError, match="a video's camera is not known"):
        solve_video(video, tmp_path, 0.08, "true")
    for options, sentence in (
        ([], "a video needs --diameter-m"),
        (["--diameter-m", "0.08", "--jobs", "2"], "--jobs: the frames of a video are solved one after another"),
        (["--diameter-m", "0.08", "--group", "a"], "--group: a video is solved as a whole"),
        (["--diameter-m", "0.08", "--method", "ml"], "solved by the method pixels"),
    ):
        assert main(["solve", video, str(tmp_path), *options]) == 2
        assert sentence in capsys.readouterr().err
    assert main(["solve", video, video, str(tmp_path), "--diameter-m", "0.08"]) == 2
    assert "is a video; give a single one" in capsys.readouterr().err


def test_the_camera_of_the_table_is_the_given_one(folder, tmp_path):
    solve_video(folder / "good.mp4", tmp_path, 0.08, FOCAL)
    rows = pq.read_table(tmp_path / "estimates.parquet").to_pylist()
    assert {(r["fx_px"], r["cx_px"]) for r in rows} == {(CAMERA.K[0, 0], CAMERA.K[0, 2])}
