"""Solve a video: the markers of all its frames with their identities, into a table and an overlay video."""

from __future__ import annotations

import json
import math
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout.files import check_no_dataset
from roundel.datasets.store.writing import write_failure
from roundel.scenes.errors import DataError, UsageError
from roundel.solver.ambiguity.disambiguation import Knowledge
from roundel.solver.estimates import NOT_FOUND, Estimate
from roundel.solver.intrinsics.specification import parse_intrinsics, uncertain_camera_for
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.roundel_fits import DEFAULT_METHOD
from roundel.solver.methods.solve_image import NO_CIRCLE
from roundel.solver.methods.solved_parts import PARTS, Tally, join_parts, write_part
from roundel.solver.photos.video_file import open_video
from roundel.solver.photos.video_overlay import draw_markers
from roundel.solver.tracking.tracker import TrackedMarker, Tracker

Progress = Callable[[int, int], None]

OVERLAY = "overlay.mp4"
_CODEC = "mp4v"  # MPEG-4 part 2: what OpenCV's wheels can write and every player reads
_PART = 256  # frames whose results are in memory
_BGR = (0.0722, 0.7152, 0.2126)  # Rec. 709 luminance, as for photographs
OUT_OF_SIGHT = "not seen in this frame"


@dataclass(frozen=True)
class VideoResult:
    """A solved video: numbers of frames, identities, and measured markers of all frames, and what was wrong with it."""

    frames: int
    markers: int
    measured: int
    settled: int
    problem: str = ""


def solve_video(
    path: str | Path,
    out_path: str | Path,
    diameter_m: float,
    intrinsics: str = "default",
    knowledge: Knowledge = None,
    curve: str = "srgb",
    progress: Progress | None = None,
) -> VideoResult:
    """Track the circles of a video, see `Tracker`.

    Parameters
    ----------
    path : path
        A video that OpenCV can decode, with 8 bits.
    out_path : path
        Folder for `estimates.parquet` (`frame_id` is the frame's number, `track_id` the identity), `timings.jsonl` and
        `overlay.mp4`.
    diameter_m : float
        Outer diameter of the printed circles.
    intrinsics : str
        See `parse_intrinsics`; for all frames.
    knowledge : str, Evidence, a sequence of them, or None
        See `Tracker`.
    curve : str
        Response curve of the video: see `parse_curve`.
    progress : callable, optional
        Called with (frames done, frames announced).

    Returns
    -------
    VideoResult
        With a `problem` if the video ended early; the frames before are solved.

    Raises
    ------
    UsageError
        If an argument is wrong, or the folder is a dataset.
    DataError
        If the video cannot be decoded at all, or a result cannot be written.
    """
    out = Path(out_path)
    check_no_dataset(out)
    if not (math.isfinite(diameter_m) and diameter_m > 0):
        raise UsageError(f"the diameter must be a positive number of metres, not {diameter_m}")
    spec = parse_intrinsics(intrinsics)
    if spec.kind in ("true", "scaled", "exif"):
        raise UsageError(f"--intrinsics {spec.label}: a video's camera is not known; use default, focal or calibrated")
    video = open_video(path)
    camera = uncertain_camera_for(spec, None, video.width_px, video.height_px)
    tracker = Tracker(diameter_m, camera, curve, knowledge, weights=_BGR)
    footer = _footer(camera, diameter_m)
    parts: list[Path] = []
    estimates, tally, done = [], Tally(), 0
    identities: set[int] = set()
    measured = settled = 0
    try:
        with _overlay(out / OVERLAY, video.rate_hz) as draw:
            for time_s, frame in video:
                if progress:
                    progress(done, max(video.announced or 0, done + 1))
                began = time.perf_counter()
                markers = tracker.update(frame, time_s)
                seconds = round(time.perf_counter() - began, 6)
                rows = _rows(markers, done, spec.label, camera)
                seen = [e for e in rows if e]
                identities.update(m.identity for m in markers if m.confirmed)
                measured, settled = measured + len(seen), settled + sum(e.chosen is not None for e in seen)
                estimates += rows
                _count(tally, seen, rows)
                record = {"frame_id": done, "time_s": round(time_s, 6), "detections": len(seen), "track_s": seconds}
                tally.timings.append(json.dumps(record))
                draw(draw_markers(frame[..., ::-1], markers, camera.camera, diameter_m, footer))
                done += 1
                if done % _PART == 0:
                    parts.append(_written(out, len(parts), estimates, tally))
                    estimates, tally = [], Tally()
        if estimates:
            parts.append(_written(out, len(parts), estimates, tally))
        join_parts(parts, out, None, None)
    finally:
        shutil.rmtree(out / PARTS, ignore_errors=True)
    if progress:
        progress(done, done)
    return VideoResult(done, len(identities), measured, settled, video.problem)


def _rows(markers: Sequence[TrackedMarker], frame_id: int, label: str, camera: UncertainCamera) -> list[Estimate]:
    """A frame's records: measured markers, then those out of sight; one that says so if there are none."""
    rows = [replace(m.estimate, intrinsics=label) for m in markers if m.estimate is not None]
    for marker in markers:
        if marker.estimate is None:
            key = frame_id, len(rows), DEFAULT_METHOD, label
            rows.append(Estimate(*key, "failed", OUT_OF_SIGHT, camera=camera.camera, track_id=marker.identity))
    return rows or [Estimate(frame_id, NOT_FOUND, DEFAULT_METHOD, label, "failed", NO_CIRCLE, camera=camera.camera)]


def _count(tally: Tally, seen: Sequence[Estimate], rows: Sequence[Estimate]) -> None:
    tally.counts["frames"] += 1
    tally.counts["detections"] += len(seen)
    tally.counts["empty_frames"] += not seen
    tally.counts["failed_estimates"] += len(rows) - len(seen)


def _written(out: Path, number: int, estimates: Sequence[Estimate], tally: Tally) -> Path:
    path = out / PARTS / f"{number:07d}.arrow"
    write_part(path, estimates, tally)
    return path


def _footer(camera: UncertainCamera, diameter_m: float) -> str:
    return f"Camera: {camera.basis}. Marker: {1000 * diameter_m:g} mm."


@contextmanager
def _overlay(path: Path, rate_hz: float) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
    """A function that appends an RGB picture to a video, which appears under its name when the block ends."""
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    writers: list[cv2.VideoWriter] = []
    size = (0, 0)

    def draw(picture: NDArray[np.uint8]) -> None:
        nonlocal size
        if not writers:
            # The codec takes even sizes only.
            size = picture.shape[1] // 2 * 2, picture.shape[0] // 2 * 2
            path.parent.mkdir(parents=True, exist_ok=True)
            writers.append(cv2.VideoWriter(str(temporary), cv2.VideoWriter.fourcc(*_CODEC), rate_hz, size))
            if not writers[0].isOpened():
                raise DataError(f"{path}: OpenCV cannot write this video (codec {_CODEC})")
        writers[0].write(np.ascontiguousarray(picture[: size[1], : size[0], ::-1]))

    try:
        yield draw
        for writer in writers:
            writer.release()
        if writers:
            os.replace(temporary, path)
    except OSError as error:
        raise write_failure(path, error) from error
    finally:
        for writer in writers:
            writer.release()
        temporary.unlink(missing_ok=True)
