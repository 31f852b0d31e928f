"""report.html: one file that stands alone, loads nothing and runs nothing."""

from __future__ import annotations

from importlib import resources
from typing import Any

import numpy as np

from roundel.datasets.fidelity_summary import fidelity_lines
from roundel.validate.drawing import Picture
from roundel.validate.narrative import commands, intrinsics_in_words, main_run, sentences
from roundel.validate.overlays import Overlay
from roundel.validate.reference import METHOD as CHESSBOARD
from roundel.validate.summary import number


def signed(value: float | None) -> str:
    """A number with its sign, a dash for none."""
    if value is None or not np.isfinite(value):
        return "-"
    text = number(abs(value))
    # What rounds to nothing has no sign.
    if not text.strip("0."):
        return text
    return ("+" if value > 0 else "\N{MINUS SIGN}") + text


def render_report(summary: dict[str, Any], pictures: list[Picture], overlays: list[Overlay]) -> str:
    """The report as HTML.

    Parameters
    ----------
    summary : dict
        From `summarise`, with its checksums.
    pictures, overlays : list
        Their SVG is ours and goes in as it is; everything else is escaped.
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(number=number, signed=signed)
    room = resources.files("roundel.validate")
    template = environment.from_string((room / "report.html.j2").read_text(encoding="utf-8"))
    runs = summary["runs"]
    truth_runs = [r for r in runs if r["reference"] == "truth" and r["method"] != CHESSBOARD]
    versions = summary["versions"]
    html = template.render(
        css=Markup((room / "report.css").read_text(encoding="utf-8")),
        data=summary["dataset"],
        settings=summary["settings"],
        sentences=sentences(summary),
        cards=_cards(summary),
        truth_runs=truth_runs,
        board_runs=[r for r in runs if r["reference"] == "chessboard"],
        boards=[r for r in runs if r["method"] == CHESSBOARD],
        groups=[g for g in summary["groups"] if g["reference"] == "truth" and g["method"] != CHESSBOARD],
        any_chosen=any(r["branch_chosen"] for r in truth_runs),
        failures=_failures(summary["failures"]),
        facts=_facts(summary),
        fidelity=_fidelity(summary),
        fidelity_lines=fidelity_lines(summary["dataset"]["fidelity"]),
        cells=summary["cells"],
        calibration=summary["calibration"],
        metrics=summary["metrics"],
        versions=versions,
        packages=sorted(set(versions["validate"]) | set(versions["render"] or {})),
        checksums=summary["checksums"],
        commands=commands(summary),
        pictures=[{"caption": p.caption, "svg": Markup(p.svg)} for p in pictures],
        overlays=[{"title": o.title, "text": o.text, "svg": Markup(o.svg)} for o in overlays],
    )
    return html.strip() + "\n"


def _cards(summary: dict[str, Any]) -> list[dict[str, str]]:
    """The few numbers that everybody asks for, of the run that the report leads with."""
    run = main_run(summary)
    oracle, label = run["oracle"], intrinsics_in_words(run["intrinsics"])
    share = "-" if not run["n"] else f"{100 * run['solved'] / run['n']:.4g} %"
    return [
        {"value": share, "label": f"of {run['n']} circles solved"},
        {
            "value": f"{number(oracle['normal_error_deg']['median'])}\N{DEGREE SIGN}",
            "label": f"normal, median, with {label}",
        },
        {"value": f"{number(oracle['position_error_pct']['median'])} %", "label": "position, of the distance, median"},
        {
            "value": f"{number(oracle['reprojection_error_px']['median'])} px",
            "label": "reprojection around the marker, median",
        },
    ]


def _failures(failures: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Failures with the intrinsics that share them in one row: detection comes before intrinsics, so most do."""
    rows: dict[tuple[Any, ...], list[str]] = {}
    for f in failures:
        rows.setdefault((f["method"], f["reference"], f["reason"], f["count"]), []).append(f["intrinsics"])
    names = ("method", "reference", "reason", "count")
    return [{**dict(zip(names, key, strict=True)), "intrinsics": ", ".join(labels)} for key, labels in rows.items()]


def _facts(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Settings as lines of text."""
    flat: list[tuple[str, Any]] = []
    for key, value in summary["settings"].items():
        flat.extend((f"{key}: {k}", v) for k, v in value.items()) if isinstance(value, dict) else flat.append(
            (key, value)
        )
    return [(key, _plain(value)) for key, value in flat]


def _fidelity(summary: dict[str, Any]) -> list[dict[str, Any]]:
    """Rows of the table of fidelity: over all circles, then by effect if there are several."""
    measured = summary["dataset"]["fidelity"] or {}
    if not measured.get("circles"):
        return []
    effects = measured.get("by_effect", {})
    rows = [{"effect": "every one" if len(effects) > 1 else next(iter(effects), "every one"), **measured}]
    rows += [{"effect": name, **figures} for name, figures in effects.items()] if len(effects) > 1 else []
    return [{**row, "effect": row["effect"].replace("_", " ")} for row in rows]


def _plain(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, float):
        return number(value, 4)
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
