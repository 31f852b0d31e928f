"""Copies the figures and tables of a league into docs/league: `python docs/league/make.py out/league/league`."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
FIGURES = ("league-true", "league-default", "league-focal")
TABLES = ("overall", "focal", "winners")


def main(league: Path) -> None:
    """Copy what the page shows, and its numbers in one file."""
    for name in FIGURES:
        (HERE / f"{name}.svg").write_text((league / "figures" / f"{name}.svg").read_text(encoding="utf-8"))
    for name in TABLES:
        text = (league / "tables" / f"{name}.md").read_text(encoding="utf-8")
        # The page has its own headings.
        (HERE / f"{name}.md").write_text(re.sub(r"\A\*\*.*?\*\*\n\n", "", text))
    (HERE / "conditions.csv").write_text((league / "tables" / "conditions.csv").read_text(encoding="utf-8"))
    record = json.loads((league / "league.json").read_text(encoding="utf-8"))
    dataset = record["dataset"]
    sys.stdout.write(
        f"dataset {dataset['dataset_id'][:12]}, {dataset['frames']} frames; left out: {record['left_out']}\n"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
