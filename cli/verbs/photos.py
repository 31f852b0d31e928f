"""Verbs for photographs, videos and printed markers."""

from __future__ import annotations

import argparse
import glob
import sys
from pathlib import Path
from typing import Any

from roundel.cli.progress import progress
from roundel.datasets.store.addresses import is_url
from roundel.scenes.errors import UsageError

VIDEO_SUFFIXES = (
    ".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv", ".mjpeg", ".ts", ".3gp",
)  # fmt: skip


def is_dataset(text: str) -> bool:
    """Whether an input is a dataset, finished or not: an address, or a folder that says so."""
    from roundel.datasets.layout.files import MANIFEST, STUDY

    path = Path(text)
    return is_url(text) or (path.is_dir() and any((path / name).exists() for name in (MANIFEST, STUDY)))


def are_photographs(inputs: list[str]) -> bool:
    """Whether the inputs of `solve` are photographs: image files, patterns, or folders of images; else it is a dataset.

    Raises
    ------
    UsageError
        If they mix datasets and photographs, or are several datasets.
    """
    from roundel.solver.photos.photo_inputs import images_in

    datasets = [text for text in inputs if is_dataset(text)]
    if datasets and len(inputs) > 1:
        raise UsageError(f"{datasets[0]}: is a dataset; give a single dataset, or photographs")
    if datasets:
        return False
    if len(inputs) > 1 or not Path(inputs[0]).is_dir():
        # A name that does not exist is taken as a file if it has a suffix, or as a pattern.
        path = Path(inputs[0])
        return len(inputs) > 1 or path.is_file() or bool(path.suffix) or glob.has_magic(inputs[0])
    return bool(images_in(Path(inputs[0])))


def is_video(inputs: list[str]) -> bool:
    """Whether the input of `solve` is a video.

    Raises
    ------
    UsageError
        If it is one of several inputs.
    """
    videos = [
        text
        for text in inputs
        if Path(text).suffix.lower() in VIDEO_SUFFIXES and not (is_url(text) or Path(text).is_dir())
    ]
    if videos and len(inputs) > 1:
        raise UsageError(f"{videos[0]}: is a video; give a single one")
    return bool(videos)


def solve_film(arguments: argparse.Namespace, knowledge: Any) -> int:
    """Track the markers of a video; returns 4 if it ended early."""
    from roundel.solver.photos.video import OVERLAY, solve_video

    out, labels = Path(arguments.out), arguments.intrinsics or ["default"]
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: is a file; the last argument is the folder to write to")
    if arguments.diameter_m is None:
        raise UsageError("a video needs --diameter-m, the outer diameter of the printed circle, for example 0.08")
    if arguments.group or arguments.frames:
        raise UsageError(f"--{'group' if arguments.group else 'frames'}: a video is solved as a whole; leave it out")
    if arguments.jobs > 1:
        raise UsageError("--jobs: the frames of a video are solved one after another; leave it out")
    if len(labels) > 1 or (arguments.method or ["pixels"]) != ["pixels"]:
        raise UsageError("a video is solved by the method pixels with one kind of intrinsics; leave the others out")
    with progress("solve") as show:
        result = solve_video(
            arguments.inputs[0],
            out,
            arguments.diameter_m,
            intrinsics=labels[0],
            knowledge=knowledge,
            curve=arguments.curve or "srgb",
            progress=show,
        )
    if result.problem:
        print(f"roundel: {arguments.inputs[0]}: {result.problem}", file=sys.stderr)
    counts = f"{_some(result.frames, 'frame')}, {_some(result.markers, 'marker')}, measured {result.measured} times"
    print(f"{out}: {counts}, of which {result.settled} with a chosen pose; see {OVERLAY}")
    return 4 if result.problem else 0


def solve_photos(arguments: argparse.Namespace, knowledge: Any) -> int:
    """Estimate poses from photographs; returns 4 if one of them failed."""
    from roundel.solver.methods.roundel_fits import DEFAULT_METHOD
    from roundel.solver.photos.photo_report import caveat_lines, line_of, pose_lines
    from roundel.solver.photos.photographs import solve_photographs

    out = Path(arguments.out)
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: is a file; the last argument is the folder to write to")
    if arguments.group:
        raise UsageError("--group: photographs have no groups")
    if arguments.diameter_m is None:
        raise UsageError("photographs need --diameter-m, the outer diameter of the printed circle, for example 0.08")
    with progress("solve") as show:
        results = solve_photographs(
            arguments.inputs,
            out,
            arguments.diameter_m,
            methods=tuple(arguments.method or [DEFAULT_METHOD]),
            intrinsics=arguments.intrinsics,
            knowledge=knowledge,
            curve=arguments.curve,
            progress=show,
            jobs=arguments.jobs,
        )
    failed = 0
    for result in results:
        if result.status == "failed":
            failed += 1
            print(f"roundel: {line_of(result)}", file=sys.stderr)
        else:
            print("\n    ".join([line_of(result), *pose_lines(result), *caveat_lines(result)]))
    found = sum(result.found for result in results)
    counts = f"{_some(len(results), 'photograph')}, {_some(found, 'circle')}, {failed} failed"
    print(f"{out}: {counts}; see overlays/ for the images, estimates.json and estimates.csv for the numbers")
    return 4 if failed else 0


def _some(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def print_marker(arguments: argparse.Namespace) -> int:
    """Write a marker to scale."""
    from roundel.render.printing import print_page as paper
    from roundel.render.printing.marker_layouts import marker_to_print, parse_set

    section = marker_to_print(arguments.kind, arguments.diameter_m, parse_set(arguments.set or []))
    page = paper.print_marker(section, arguments.out, arguments.paper)
    turned = ", landscape" if page.width_mm > page.height_mm else ""
    print(f"{arguments.out}: {arguments.paper}{turned}; print it at 100 % and measure its ruler: {paper.RULER_MM:g} mm")
    return 0
