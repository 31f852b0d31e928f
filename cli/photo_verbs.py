"""Verbs for photographs and for printed markers."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from roundel.cli.progress import progress
from roundel.scenes.errors import UsageError

_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".heic")


def are_photographs(inputs: list[str]) -> bool:
    """Whether the inputs of `solve` are image files; a single folder is a dataset.

    Raises
    ------
    UsageError
        If they mix datasets and photographs, or are several datasets or a folder of photographs.
    """
    folders = [text for text in inputs if Path(text).is_dir()]
    if folders and len(inputs) > 1:
        raise UsageError(f"{folders[0]}: is a folder; give a single dataset, or the photographs in it by name")
    if folders and not (Path(folders[0]) / "manifest.json").exists():
        image = next((p for p in sorted(Path(folders[0]).iterdir()) if p.suffix.lower() in _SUFFIXES), None)
        if image is not None:
            raise UsageError(
                f"{folders[0]}: not a dataset but a folder of images; give the images by name, for example {image}"
            )
    # A name that does not exist is taken as a file if it has a suffix.
    return not folders and (len(inputs) > 1 or Path(inputs[0]).is_file() or bool(Path(inputs[0]).suffix))


def solve_photos(arguments: argparse.Namespace, knowledge: Any) -> int:
    """Estimate poses from photographs; returns 4 if one of them failed."""
    from roundel.solver.methods.roundel_fits import DEFAULT_METHOD
    from roundel.solver.photos.photo_report import caveat_lines, line_of
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
            print("\n    ".join([line_of(result), *caveat_lines(result)]))
    found = sum(result.found for result in results)
    counts = f"{_some(len(results), 'photograph')}, {_some(found, 'circle')}, {failed} failed"
    print(f"{out}: {counts}; see overlays/ for the images and estimates.json for the numbers")
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
