"""Make the figures and the tables of docs/robustness.md: `python docs/robustness/make.py OUT`.

OUT contains a folder for each study, written by `roundel run configs/STUDY.yaml OUT/STUDY`. A family of studies is left
as it is on the page if OUT lacks one of them.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from roundel.validate.figures.robustness import draw_sweep, title_of
from roundel.validate.figures.svg import CURVES, INK, Picture, draw_svg, standalone_svg
from roundel.validate.scores.summary import number

# Nuisances of a scene and its camera, and steps of the imaging chain: a table and a figure each.
FAMILIES = {
    "robustness": (
        "noise",
        "defocus",
        "motion",
        "rolling_shutter",
        "occlusion",
        "lighting",
        "jpeg",
        "distortion",
        "off_axis",
    ),
    "imaging": ("saturation", "soft_ink", "gloss", "grain", "vignetting", "mosaic", "phone"),
}
PAGE = Path(__file__).parents[1] / "robustness.md"
COLUMNS = 3
WANTED = (0.90, 0.98)  # coverage of the 95 % region
OF_COVERAGE = "true"  # the intrinsics whose covariances are asked for here


def sweep_of(out: Path, study: str) -> dict[str, Any]:
    """Read the sweep of a finished study."""
    summary = json.loads((out / study / "report" / "summary.json").read_text(encoding="utf-8"))
    (sweep,) = summary["sweeps"]
    return dict(sweep)


def figure(family: str, sweeps: dict[str, dict[str, Any]]) -> str:
    """Draw all sweeps: for each a panel of its normal error, and below it one of its coverage."""

    def draw(page: Figure) -> None:
        rows = -(-len(sweeps) // COLUMNS)
        grid = page.subplots(2 * rows, COLUMNS, squeeze=False, height_ratios=[2.2, 1.0] * rows)
        for axes in (*grid[0::2].ravel()[len(sweeps) :], *grid[1::2].ravel()[len(sweeps) :]):
            axes.set_axis_off()
        for (study, sweep), upper, lower in zip(sweeps.items(), grid[0::2].ravel(), grid[1::2].ravel(), strict=False):
            draw_sweep(upper, sweep)
            upper.set_title(study.replace("_", " "))
            upper.set_xlabel("")
            draw_coverage(lower, sweep)
        page.supylabel(
            "normal error / bound at the mildest level; below, truths in the stated 95 % region [%]", fontsize=9
        )
        page.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)

    size = 9.5, 4.2 * -(-len(sweeps) // COLUMNS)
    title = f"Normal error and coverage over {len(sweeps)} nuisances"
    return standalone_svg(Picture(family, "", draw_svg(family, title, size, draw)))


def draw_coverage(axes: Axes, sweep: dict[str, Any]) -> None:
    """Draw how often the truth lies in the stated 95 % region; levels are evenly spaced, from mild to harsh."""
    axes.axhspan(100 * WANTED[0], 100 * WANTED[1], color=INK, alpha=0.08, lw=0)
    levels = sweep["levels"]
    order = sorted(range(len(levels)), key=lambda i: levels[i], reverse=levels[0] > levels[-1])
    found = coverage_of(curve_of(sweep))
    for place, i in enumerate(order):
        rate, low, high = found[i]
        if rate is not None:
            axes.plot([place, place], [100 * low, 100 * high], color=CURVES[0], lw=1.2)
            axes.plot(place, 100 * rate, "o", color=CURVES[0], ms=3.5)
    axes.set_xticks(range(len(levels)), [f"{levels[i]:g}" for i in order])
    axes.set_ylim(-5, 105)
    axes.set_xlabel(title_of(sweep))


def curve_of(sweep: dict[str, Any]) -> dict[str, Any]:
    """The curve with the true camera."""
    (curve,) = (c for c in sweep["curves"] if c["intrinsics"] == OF_COVERAGE)
    return dict(curve)


def coverage_of(curve: dict[str, Any]) -> list[tuple[Any, Any, Any]]:
    """Coverage at each level with its interval."""
    return list(zip(curve["coverage"], curve["coverage_low"], curve["coverage_high"], strict=True))


def coverage_text(rate: float | None, low: float, high: float) -> str:
    """Coverage in words; it is called too small or too large only if its interval excludes what is wanted."""
    if rate is None:
        return "no covariance"
    verdict = ", **too small**" if high < WANTED[0] else ", **too large**" if low > WANTED[1] else ""
    return f"{100 * rate:.0f} % ({100 * low:.0f} to {100 * high:.0f}){verdict}"


def table(sweeps: dict[str, dict[str, Any]]) -> str:
    """Format one row for each nuisance and kind of intrinsics."""
    ends = "normal error at the mildest level", "at the harshest level"
    regions = "in the 95 % region at the mildest level", "at the harshest level"
    head = ("nuisance", "levels", "intrinsics", *ends, "doubles at", "solved", *regions)
    rows = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
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
            covered = coverage_of(curve) if curve["intrinsics"] == OF_COVERAGE else None
            cells = (
                name,
                f"{levels[0]:g} to {levels[-1]:g}" if i == 0 else "",
                curve["intrinsics"],
                f"{number(deg[mild])} deg",
                "not solved" if deg[harsh] is None else f"{number(deg[harsh])} deg",
                doubled,
                f"{sum(curve['solved'])} of {sum(curve['frames'])}",
                *(coverage_text(*covered[k]) if covered else "" for k in (mild, harsh)),
            )
            rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows)


def main(out: Path) -> None:
    """Write the figures next to this script, and the tables into the page."""
    for family, studies in FAMILIES.items():
        missing = [s for s in studies if not (out / s / "report" / "summary.json").is_file()]
        if missing:
            sys.stderr.write(f"{family}: left as it is, because {out} lacks {', '.join(missing)}\n")
            continue
        sweeps = {study: sweep_of(out, study) for study in studies}
        Path(__file__).with_name(f"{family}.svg").write_text(figure(family, sweeps), encoding="utf-8")
        page = PAGE.read_text(encoding="utf-8")
        page, places = re.subn(
            rf"(<!-- {family} -->\n).*?(<!-- end -->)",
            lambda m, sweeps=sweeps: f"{m[1]}\n{table(sweeps)}\n\n{m[2]}",
            page,
            flags=re.DOTALL,
        )
        if places != 1:
            raise SystemExit(f"{PAGE.name} has {places} places for the table of {family}; expected one")
        PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
