"""Make the figures of results.md and claims.md, and the table of verdicts with a column for each study.

    python docs/verdicts/make.py PICTURES RUN...

RUN is an output folder of `roundel run`, with `dataset` and `report` in it. The report's figures are copied to PICTURES
as `verdict-STUDY-CLAIM.svg` and `benefit-STUDY.svg`; the table is written to standard output.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path
from typing import Any

from roundel.datasets.dataset import open_dataset
from roundel.validate.figures.writers import FOLDER
from roundel.validate.scores.summary import number

_INTERVAL = ("value", "low", "high")


def copy_figures(run: Path, pictures: Path) -> tuple[str, dict[str, dict[str, Any]]]:
    """Copy a study's figures; return its name and its verdicts by claim."""
    study = open_dataset(run / "dataset").study["name"]
    summary = json.loads((run / "report" / "summary.json").read_text(encoding="utf-8"))
    figures = run / "report" / FOLDER
    for verdict in summary["verdicts"]:
        shutil.copyfile(figures / f"verdict-{verdict['key']}.svg", pictures / f"verdict-{study}-{verdict['key']}.svg")
    if summary["benefit"]:
        shutil.copyfile(figures / "benefit.svg", pictures / f"benefit-{study}.svg")
    return study, {v["key"]: v for v in summary["verdicts"]}


def cell(study: str, verdict: dict[str, Any] | None, pictures: Path) -> str:
    """Format the outcome with a link, the number of the paper's setting, and those with another outcome."""
    if verdict is None:
        return "-"
    own = verdict["sides"][0]
    others = [s for s in verdict["sides"][1:] if s["main"] and s["holds"] not in (None, own["holds"])]
    several = len({side["where"] for side in verdict["sides"]}) > 1
    numbers = [f"{side['where']} {amount(side)}" if several else amount(side) for side in (own, *others)]
    figure = pictures / f"verdict-{study}-{verdict['key']}.svg"
    return f"[{verdict['outcome']}]({figure.as_posix()}): {'; '.join(numbers)}"


def amount(side: dict[str, Any]) -> str:
    """Format a number with its interval."""
    if side["value"] is None:
        return str(side["reason"])
    value, low, high = (number(v) if abs(v) >= 10 else f"{round(v, 2) + 0.0:.2f}" for v in map(side.get, _INTERVAL))
    return f"{value} [{low}, {high}]"


def markdown(studies: dict[str, dict[str, dict[str, Any]]], pictures: Path) -> str:
    """Format the table: one row per claim, one column per study."""
    claims: dict[str, dict[str, Any]] = {}
    for verdicts in studies.values():
        for key, verdict in verdicts.items():
            claims.setdefault(key, verdict)
    lines = [f"| the paper's claim | statistic and region | {' | '.join(studies)} |", "|---" * (len(studies) + 2) + "|"]
    for key, verdict in claims.items():
        cells = [cell(name, verdicts.get(key), pictures) for name, verdicts in studies.items()]
        # Remove the labels and distances, which differ between studies.
        statistic = re.sub(r" \([^)]*\)$| at \S+ D\b", "", verdict["statistic"])
        lines.append(f"| {verdict['claim']} | {statistic}: {verdict['sides'][0]['region']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Copy the figures and write the table for the runs on the command line."""
    pictures, runs = Path(sys.argv[1]), [Path(run) for run in sys.argv[2:]]
    sys.stdout.write(markdown(dict(copy_figures(run, pictures) for run in runs), pictures) + "\n")


if __name__ == "__main__":
    main()
