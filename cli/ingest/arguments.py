"""Arguments of `import`."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from roundel.cli.arguments import on_disk, positive


def add_import(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """Add the verb to the parser."""
    verb = add(
        "import", "make a dataset from photographs of a printed sheet: a circle, and a board that gives its pose"
    )
    verb.add_argument("photographs", metavar="PHOTOS", help="folder of photographs (JPEG or PNG) of one camera")
    verb.add_argument("out", type=on_disk, metavar="OUT", help="folder of the new dataset")
    verb.add_argument(
        "--sheet",
        required=True,
        metavar="SHEET",
        help="what was printed: a study (a YAML file, or the name of a shipped one), or a kind of marker as in "
        "`roundel marker`, such as disc_with_chessboard",
    )
    verb.add_argument("--group", metavar="GROUP", help="group of the study that has the sheet")
    verb.add_argument("--diameter-m", type=positive, metavar="D", help="with a kind: as in `roundel marker`")
    verb.add_argument("--set", action="append", metavar="KEY=VALUE", help="with a kind: as in `roundel marker`")
    verb.add_argument(
        "--ruler-mm",
        type=positive,
        default=100.0,
        metavar="L",
        help="measured length of the page's ruler of 100 mm; all sizes are multiplied by L / 100 (default 100)",
    )
    verb.add_argument(
        "--camera", metavar="FILE", help="calibrated camera; default: calibrated from the boards in the photographs"
    )
    verb.add_argument("--k3", action="store_true", help="also fit k3, if k1, k2, p1 and p2 do not fit the lens")
    verb.add_argument("--name", metavar="NAME", help="name of the dataset (default: that of the folder)")
    verb.add_argument(
        "--licence", default="NOASSERTION", metavar="SPDX", help="licence of the photographs (default: NOASSERTION)"
    )
