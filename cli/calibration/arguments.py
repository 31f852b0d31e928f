"""Arguments of `calibrate`. Only argparse is imported, so that `roundel --help` is fast."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from roundel.cli.arguments import bend, grid, on_disk, positive, views


def add_calibrate(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """Add the verb; `add` takes its name and its line of help, and returns its parser."""
    calibrate = add(
        "calibrate",
        "calibrate a camera from photographs of a printed board (chessboard, ChArUco, circle grid), or from the boards "
        "of a dataset",
    )
    calibrate.add_argument("inputs", metavar="INPUT", nargs="+", help="photographs, folders of them, or a dataset")
    calibrate.add_argument("camera", metavar="CAMERA", help="camera file to write, .yaml or .json")
    calibrate.add_argument(
        "--board",
        metavar="BOARD",
        help="for photographs: the file that `roundel marker` printed (.pdf, .svg), a YAML file with the marker's "
        "keys, or its kind: chessboard, charuco, circle_grid",
    )
    calibrate.add_argument(
        "--set",
        action="append",
        metavar="KEY=VALUE",
        help="for photographs: a key of the board as for `roundel marker`, for example square_m=0.0203 as measured",
    )
    calibrate.add_argument(
        "--page", type=on_disk, metavar="FILE", help="for photographs: the page to write (default: CAMERA with .html)"
    )
    calibrate.add_argument("--group", metavar="GROUP", help="for a dataset: group of boards (default: the first one)")
    calibrate.add_argument("--views", type=views, metavar="N", help="only the first N views (default: all)")
    calibrate.add_argument("--k3", action="store_true", help="also fit k3, if k1, k2, p1 and p2 do not fit the lens")
    calibrate.add_argument(
        "--bend",
        type=bend,
        default=0,
        metavar="ORDER",
        help="for circle grids: fit the bend of the board, the same in all views, by a polynomial of order 2 to 6",
    )
    calibrate.add_argument(
        "--grid", type=grid, metavar="COLSxROWS", help="short for a circle grid: dots in a row, and rows"
    )
    calibrate.add_argument(
        "--spacing-m", type=positive, metavar="S", help="with --grid: between rows (marker key spacing_m)"
    )
    calibrate.add_argument("--diameter-m", type=positive, metavar="D", help="with --grid: diameter of a dot")
    calibrate.add_argument("--asymmetric", action="store_true", help="with --grid: an asymmetric circle grid")
    calibrate.add_argument("--curve", metavar="CURVE", help="for photographs: response curve, as in `roundel solve`")
