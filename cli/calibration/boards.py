"""The board that was photographed: a kind with its sizes, a print of `roundel marker`, a YAML file, or --grid."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roundel.scenes.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from roundel.scenes.markers.marker import Part
    from roundel.solver.calibration.grid_layout import GridLayout
    from roundel.validate.photo_calibration.record import Board

_PRINTS, _YAML = (".pdf", ".svg"), (".yaml", ".yml")
_BOARDS = ("chessboard", "charuco", "circle_grid")
_NEEDED = (
    "photographs need --board: the file that `roundel marker` printed, such as --board board.pdf, or its kind and "
    "sizes, such as --board chessboard --set columns=8 --set rows=5 --set square_m=0.02 (inner corners, metres)"
)


@dataclass(frozen=True, eq=False)
class Photographed:
    """A board: the part of the sheet that a corner finder looks for, or the layout of a circle grid."""

    board: Board
    part: Part
    layout: GridLayout | None = None


def photographed_board(arguments: argparse.Namespace) -> Photographed:
    """The board that the arguments of `calibrate` describe.

    Raises
    ------
    UsageError
        If they describe none, or it is no board.
    """
    from roundel.render.printing.board_file import CALIBRATION_KINDS
    from roundel.render.printing.marker_layouts import marker_to_print
    from roundel.scenes.world.sheets import sheet_of

    keys = _keys(arguments)
    kind = str(keys.pop("kind", ""))
    if kind not in CALIBRATION_KINDS:
        hint = did_you_mean(kind, CALIBRATION_KINDS) or f"use one of {', '.join(CALIBRATION_KINDS)}"
        raise UsageError(f"--board {arguments.board}: {f'a {kind} is' if kind else 'it names'} no board to calibrate "
                         f"from; {hint}")  # fmt: skip
    diameter_m = keys.pop("diameter_m", None) if kind.startswith("disc_") else None
    section = marker_to_print(kind, diameter_m, keys)
    try:
        sheet = sheet_of(section)
    except ValueError as error:
        raise UsageError(f"--board {kind}: {str(error).removeprefix('marker.')}") from error
    part = next((part for part in sheet.parts if part.kind in _BOARDS), None)
    if part is None:  # the dots of a circle grid are one part, too
        raise UsageError(f"--board {kind}: has no board")
    return _described(part)


def _keys(arguments: argparse.Namespace) -> dict[str, Any]:
    """The keys of the board's marker section."""
    from roundel.render.printing.board_file import described_marker
    from roundel.render.printing.marker_layouts import parse_set
    from roundel.scenes.study.marker_section import KINDS

    given = parse_set(arguments.set or [])
    if arguments.grid or arguments.spacing_m:
        if arguments.board:
            raise UsageError("--grid and --spacing-m describe a circle grid by themselves; leave them or --board out")
        return _circle_grid(arguments) | given
    if not arguments.board:
        raise UsageError(_NEEDED)
    if arguments.asymmetric:
        raise UsageError("--asymmetric: goes with --grid; use --set layout=asymmetric with --board circle_grid")
    text = str(arguments.board)
    if text in KINDS:
        keys: dict[str, Any] = {"kind": text} if arguments.diameter_m is None else {
            "kind": text, "diameter_m": arguments.diameter_m
        }  # fmt: skip
        return keys | given
    if arguments.diameter_m is not None:
        raise UsageError("--diameter-m: the file says what was printed; use --set diameter_m=... to correct it")
    suffix = Path(text).suffix.lower()
    if suffix in _PRINTS:
        return described_marker(text) | given
    if suffix in _YAML:
        return _of_yaml(Path(text)) | given
    hint = did_you_mean(text, KINDS) or "use chessboard, charuco or circle_grid, or a file that `roundel marker` wrote"
    raise UsageError(f"--board {text}: unknown; {hint}")


def _circle_grid(arguments: argparse.Namespace) -> dict[str, Any]:
    for name in ("grid", "spacing_m", "diameter_m"):
        if not getattr(arguments, name):
            raise UsageError(
                "a circle grid needs --grid COLUMNSxROWS, --spacing-m and --diameter-m, or --board circle_grid"
            )
    columns, rows = arguments.grid
    return {
        "kind": "circle_grid",
        "columns": columns,
        "rows": rows,
        "spacing_m": arguments.spacing_m,
        "diameter_m": arguments.diameter_m,
        "layout": "asymmetric" if arguments.asymmetric else "symmetric",
    }


def _of_yaml(path: Path) -> dict[str, Any]:
    """The marker section of a file: alone, or under `marker` as in a study."""
    from roundel.scenes.study.yaml_reader import read_yaml

    if not path.exists():
        raise UsageError(f"--board {path}: no such file")
    raw, _ = read_yaml(path)
    section = raw.get("marker", raw) if isinstance(raw, dict) else None
    if not isinstance(section, dict) or "kind" not in section:
        raise UsageError(f"{path}: is not a marker; it needs kind: chessboard (or charuco, circle_grid) and its sizes")
    return dict(section)


def _described(part: Part) -> Photographed:
    import numpy as np

    from roundel.scenes.markers.circle_grid import circle_grid_centres_m
    from roundel.validate.photo_calibration.record import Board

    keys = part.layout
    columns, rows = int(keys["columns"]), int(keys["rows"])
    if part.kind == "circle_grid":
        from roundel.solver.calibration.grid_layout import layout_of as grid_layout_of
        from roundel.solver.calibration.grid_layout import layout_problem

        layout = grid_layout_of(keys)
        problem = layout_problem(layout)
        if problem:
            raise UsageError(f"the circle grid {problem}")
        flat = circle_grid_centres_m(columns, rows, layout.spacing_m, layout.asymmetric)
        title = (
            f"{'asymmetric ' * layout.asymmetric}circle grid of {columns} by {rows} dots of {layout.diameter_m:g} m, "
            f"every {layout.spacing_m:g} m"
        )
    else:
        layout, side = None, float(keys["square_m"])
        if part.kind == "chessboard":
            inner, title = (columns, rows), f"chessboard of {columns} by {rows} inner corners, squares of {side:g} m"
        else:
            inner, tags = (columns - 1, rows - 1), f"tags {keys['family']} of {keys['tag_m']:g} m"
            title = f"ChArUco board of {columns} by {rows} squares of {side:g} m, {tags}"
        column, row = (axis.ravel() for axis in np.meshgrid(np.arange(inner[0]), np.arange(inner[1])))
        flat = np.stack([(column - (inner[0] - 1) / 2) * side, ((inner[1] - 1) / 2 - row) * side], axis=-1)
    points = np.column_stack([flat, np.zeros(len(flat))])
    return Photographed(Board(part.kind, title, points, part.half_size_m(), part.kind == "chessboard"), part, layout)
