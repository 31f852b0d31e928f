"""Make the figure and the table of docs/robustness.md: `python docs/robustness/make.py OUT`.

OUT contains a folder for each study, written by `roundel run configs/STUDY.yaml OUT/STUDY`.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from roundel.validate.figures.robustness import draw_sweep, title_of
from roundel.validate.figures.svg import Picture, draw_svg, standalone_svg
from roundel.validate.scores.summary import number

STUDIES = (
    "noise",
    "defocus",
    "motion",
    "rolling_shutter",
    "occlusion",
    "lighting",
    "jpeg",
    "distortion",
    "off_axis",
)
PAGE = Path(__file__).parents[1] / "robustness.md"
COLUMNS = 3


def sweep_of(out: Path, study: str) -> dict[str, Any]:
    """Read the sweep of a finished study."""
    summary = json.loads((out / study / "report" / "summary.json").read_text(encoding="utf-8"))
    (sweep,) = summary["sweeps"]
    return dict(sweep)


def figure(sweeps: dict[str, dict[str, Any]]) -> str:
    """Draw all sweeps, one panel each."""

    def draw(page: Figure) -> None:
        panels = page.subplots(-(-len(sweeps) // COLUMNS), COLUMNS, squeeze=False)
        for i, (study, sweep) in enumerate(sweeps.items()):
            axes = panels[divmod(i, COLUMNS)]
            draw_sweep(axes, sweep)
            axes.set_title(study.replace("_", " "))
        page.supylabel("normal error / bound at the mildest level", fontsize=9)
        page.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)

    title = "Normal error over nine nuisances"
    return standalone_svg(Picture("robustness", "", draw_svg("robustness", title, (9.5, 8.2), draw)))


def table(sweeps: dict[str, dict[str, Any]]) -> str:
    """Format one row for each nuisance and kind of intrinsics."""
    head = ("nuisance", "levels", "intrinsics", "normal error, mildest level", "harshest level", "doubles at", "solved")
    rows = ["| " + " | ".join(head) + " |", "|---|---|---|---|---|---|---|"]
    for study, sweep in sweeps.items():
        levels = sweep["levels"]
        mild = levels.index(sweep["reference"])
        harsh = max(range(len(levels)), key=lambda i: abs(i - mild))
        for i, curve in enumerate(sweep["curves"]):
            at = curve["doubling"]
            low, high = ("beyond" if v is None else number(v) for v in (at["low"], at["high"]))
            doubled = "not within the levels" if at["level"] is None else f"{number(at['level'])} ({low} to {high})"
            deg = curve["normal_median_deg"]
            name = f"[{study}](../configs/{study}.yaml): {title_of(sweep)}" if i == 0 else ""
            cells = (
                name,
                f"{levels[0]:g} to {levels[-1]:g}" if i == 0 else "",
                curve["intrinsics"],
                f"{number(deg[mild])} deg",
                "not solved" if deg[harsh] is None else f"{number(deg[harsh])} deg",
                doubled,
                f"{sum(curve['solved'])} of {sum(curve['frames'])}",
            )
            rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows)


def main(out: Path) -> None:
    """Write the figure next to this script, and the table into the page."""
    sweeps = {study: sweep_of(out, study) for study in STUDIES}
    Path(__file__).with_name("robustness.svg").write_text(figure(sweeps), encoding="utf-8")
    page = PAGE.read_text(encoding="utf-8")
    page, places = re.subn(
        r"(<!-- table -->\n).*?(<!-- end -->)",
        lambda m: f"{m[1]}\n{table(sweeps)}\n\n{m[2]}",
        page,
        flags=re.DOTALL,
    )
    if places != 1:
        raise SystemExit(f"{PAGE.name} has {places} places for the table; expected one")
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
