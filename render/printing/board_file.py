"""The description of a board, written into the print itself, and read from it.

A print that is photographed for a calibration has to be described once more then. `roundel marker` writes the section
of the marker into the PDF or SVG, so that the file that was printed says which board it is.
"""

from __future__ import annotations

import html
import json
import re
import textwrap
from pathlib import Path
from typing import Any

from roundel.render.printing.marker_layouts import RENDERED, marker_to_print
from roundel.scenes.errors import DataError, UsageError

# PDF and SVG hold it as a keyword; neither needs to be parsed to find it.
MARK = "roundel-marker "
_MOST_BYTES = 20_000_000
# What `roundel calibrate` calibrates from, among the kinds of marker.
CALIBRATION_KINDS = ("chessboard", "charuco", "circle_grid", "disc_with_chessboard", "disc_with_charuco")
_FOUND = re.compile(re.escape(MARK) + r"(\{[^()<>]*?\})(?=[)<])")


def keyword_of(section: Any) -> str:
    """The keyword that describes a marker: its section, without the keys that apply to rendering alone."""
    keys = section.model_dump(mode="json", exclude_defaults=True)
    # ASCII without brackets, so that PDF and SVG store it as it is.
    return MARK + json.dumps({"kind": section.kind, **keys}, separators=(",", ":"))


def calibrate_lines(section: Any, width: int) -> list[str]:
    """The command that calibrates from photographs of a board, in lines of at most `width` characters; none for others.

    It names the kind and every size that is not the default one.
    """
    if section.kind not in CALIBRATION_KINDS:
        return []
    usual = marker_to_print(section.kind, None, {}).model_dump(mode="json")
    given = {key: value for key, value in section.model_dump(mode="json").items() if value != usual[key]}
    flat = [
        (f"{key}.{inner}" if inner else key, one)
        for key, value in given.items()
        for inner, one in (value.items() if isinstance(value, dict) else [("", value)])
    ]
    options = [f"--set {key}={value}" for key, value in flat if key not in ("margin_m", *RENDERED)]
    # A space within an option is no place to break the line.
    words = ["roundel calibrate PHOTOS CAMERA", f"--board {section.kind}", *options]
    lines = textwrap.wrap(" ".join(word.replace(" ", "\0") for word in words), width, break_long_words=False)
    return [line.replace("\0", " ") for line in lines]


def described_marker(path: str | Path) -> dict[str, Any]:
    """The keys of the marker that a file printed by `roundel marker` shows.

    Raises
    ------
    UsageError
        If there is no such file.
    DataError
        If it has no description: another program's file, or an older print.
    """
    path = Path(path)
    try:
        data = path.read_bytes()[:_MOST_BYTES]
    except FileNotFoundError as error:
        raise UsageError(f"{path}: no such file; give the file that `roundel marker` wrote, or a kind of board") from (
            error
        )
    except OSError as error:
        raise DataError(f"{path}: cannot read: {error.strerror or error}") from error
    found = _FOUND.search(html.unescape(data.decode("latin-1")))
    try:
        keys = json.loads(found[1]) if found else None
    except ValueError:
        keys = None
    if not isinstance(keys, dict):
        raise DataError(
            f"{path}: does not say which board it is; name its kind and sizes instead, for example "
            "--board chessboard --set columns=8 --set rows=5 --set square_m=0.02"
        )
    return keys
