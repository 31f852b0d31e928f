"""The tables of `ambiguity.py`, as Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from scores import DECIDED, Score, Stated, score_of

PAGE = Path(__file__).with_name("ambiguity.md")

# Edges of the classes in which each kind is shown.
CLASSES = {
    "distance_D": (6.0, 11.0, 21.0, 40.0),
    "tilt_deg": (5.0, 20.0, 45.0, 70.0),
    "offset_px": (0.0, 80.0, 160.0, 280.0),
}
NAMES = {"distance_D": "distance, D", "tilt_deg": "tilt from the line of sight, deg", "offset_px": "off the axis, px"}

HEAD = """# How often the ambiguity is resolved

`python benchmarks/ambiguity/ambiguity.py --page` renders [ambiguity.yaml](ambiguity.yaml) ({frames} frames of
640x480), observes each circle with the method `pixels`, and declares what a user would ([declared.py](declared.py)).
What it means is on [a page of its own](../../docs/ambiguity.md).

*Decided*: the share whose likelier pose has a stated probability of at least 95 %, and how many of these are right.
*Right*: of all, with one half where both are equally likely; *stated* is the mean probability of the likelier pose,
what *right* should be, and *excess* their difference in standard deviations of chance. *Brier* and *log* are the
proper scores (0.25 and 0.693 without knowledge), *error* is the expected calibration error.

"""


def write_page(stated: Sequence[Stated], frames: int) -> None:
    """Write `ambiguity.md`."""
    parts = [HEAD.format(frames=frames)]
    for intrinsics in dict.fromkeys(s.intrinsics for s in stated):
        mine = [s for s in stated if s.intrinsics == intrinsics]
        parts += [f"## Intrinsics `{intrinsics}`\n\n", overall(mine), "\n"]
        parts += ["Share decided, and of these right, by class:\n\n", by_class(mine), "\n"]
    PAGE.write_text("".join(parts).rstrip("\n") + "\n", encoding="utf-8")


def overall(stated: Sequence[Stated]) -> str:
    """A line for each kind."""
    head = ("knowledge", "circles", "decided", "of these right", "right", "stated", "excess", "Brier", "log", "error")
    return _table(head, [(s.kind, *_cells(score_of(s.probability))) for s in stated])


def by_class(stated: Sequence[Stated]) -> str:
    """A line for each kind, a column for each class."""
    head = ["knowledge"]
    for name, edges in CLASSES.items():
        head += [f"{NAMES[name]}: {a:g} to {b:g}" for a, b in pairwise(edges)]
    rows = []
    for s in stated:
        cells = [s.kind]
        for name, edges in CLASSES.items():
            values = getattr(s, name)
            for a, b in pairwise(edges):
                score = score_of(s.probability[(values >= a) & (values < b)])
                right = "" if math.isnan(score.right_decided) else f", {_percent(score.right_decided)}"
                cells.append(f"{_percent(score.decided)}{right}")
        rows.append(tuple(cells))
    return _table(head, rows)


def _cells(score: Score) -> tuple[str, ...]:
    shares = (score.decided, score.right_decided, score.right, score.stated)
    numbers = f"{score.excess:+.1f}", f"{score.brier:.3f}", f"{score.log_score:.3f}", f"{score.calibration_error:.3f}"
    return str(score.circles), *map(_percent, shares), *numbers


def _percent(share: float) -> str:
    return "" if math.isnan(share) else f"{100 * share:.1f} %"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


__all__ = ["DECIDED", "PAGE", "write_page"]
