"""Make the figures and tables of docs/method.md: `python docs/method/make.py [figures] [tables]`.

Tables are written into the page, between `<!-- table: NAME -->` and `<!-- end -->`. Seeds are fixed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import ambiguity
import figures
import focal
import precision

PAGE = Path(__file__).parents[1] / "method.md"

TABLES: dict[str, Callable[[], str]] = {
    "digits": ambiguity.digits,
    "candidates": ambiguity.candidates_table,
    "propositions": ambiguity.propositions_table,
    "frequencies": ambiguity.frequencies,
    "reliability": ambiguity.reliability,
    "shrinkage": precision.shrinkage_table,
    "eccentricity": precision.eccentricity_table,
    "bound": precision.bound_table,
    "breakdown": precision.breakdown_table,
    "prior": precision.prior_table,
    "defaults": focal.defaults_table,
    "wrong_focal": focal.study_table,
    "closed_form": focal.closed_form_table,
}


def tables() -> None:
    """Write every table into the page."""
    page = PAGE.read_text(encoding="utf-8")
    for name, made in TABLES.items():
        pattern = rf"(<!-- table: {name} -->\n).*?(<!-- end -->)"
        text = made()
        page, places = re.subn(pattern, lambda m, text=text: f"{m[1]}\n{text}\n\n{m[2]}", page, flags=re.DOTALL)
        if places != 1:
            raise SystemExit(f"{PAGE.name} has {places} places for the table {name}; expected one")
        sys.stderr.write(f"{name}\n")
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    for what in sys.argv[1:] or ["figures", "tables"]:
        {"figures": figures.main, "tables": tables}[what]()
