"""report.html: a self-contained page without scripts or external files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from roundel.datasets.fidelity.summary import fidelity_lines
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.figures.overlays import Overlay
from roundel.validate.figures.svg import Picture
from roundel.validate.report.html import Tables, figures, fill, presentable_summary, shown_table
from roundel.validate.report.summary_text import commands, main_run, sentences
from roundel.validate.scores.stated_uncertainty import ASKED, NARROW, WIDE, region_text
from roundel.validate.scores.summary import Summary, detected_without_pose, number
from roundel.validate.tables.report import fidelity_table, metric_table, pairs_table, report_tables
from roundel.validate.tables.table import Table

# Style of an outcome; the word itself carries the meaning for readers who cannot see colours.
_COLOURS = {"holds": "good", "does not hold": "bad", NARROW: "bad", WIDE: "bad"}


@dataclass(frozen=True)
class Pictures:
    """The report's figures by section; a figure that a verdict names is placed beside that verdict."""

    lead: list[Picture] = field(default_factory=list)
    verdicts: list[Picture] = field(default_factory=list)
    errors: list[Picture] = field(default_factory=list)
    sweeps: list[Picture] = field(default_factory=list)
    matrix: list[Picture] = field(default_factory=list)
    comparison: list[Picture] = field(default_factory=list)
    calibration: list[Picture] = field(default_factory=list)
    uncertainty: list[Picture] = field(default_factory=list)
    reliability: list[Picture] = field(default_factory=list)

    def all(self) -> list[Picture]:
        """Every figure, in the order of the page."""
        return [picture for part in fields(self) for picture in getattr(self, part.name)]


@dataclass(frozen=True)
class Overlays:
    """Pictures of single circles: the largest errors, and the largest beside what was stated."""

    errors: Sequence[Overlay] = ()
    stated: Sequence[Overlay] = ()


def render_report(summary: Summary, pictures: Pictures, overlays: Overlays, more: Sequence[Table] = ()) -> str:
    """The report as HTML.

    Parameters
    ----------
    summary : Summary
        Complete, including its checksums.
    pictures : Pictures
    overlays : Overlays
        Roundel makes their SVG, so it is inserted without escaping; everything else is escaped.
    more : sequence of Table
        Tables that the summary does not contain.
    """
    from markupsafe import Markup

    summary = presentable_summary(summary)
    data, versions, measured = summary.dataset, summary.versions, summary.dataset["fidelity"]
    tables = Tables({**report_tables(summary), **{table.name: table for table in more}})
    verdicts = _verdicts(summary.verdicts, pictures.verdicts)
    reason = (summary.calibration or {}).get("reason")
    chessboard = reason or pictures.calibration or any(tables[n] for n in ("calibrations", "boards"))
    stated = any(tables[name] for name in ("uncertainty", "probabilities"))
    sections = (
        (pictures.lead, "lead", "Calibration"), (verdicts, "verdicts", "Verdicts"),
        (pictures.errors, "figures", "Distance"), (pictures.sweeps, "sweeps", "Levels"),
        (pictures.matrix, "matrix", "Variables"),
        (True, "results", "Results"), (stated, "uncertainty", "Uncertainty"),
        (chessboard or tables["against_chessboard"], "calibration", "Chessboard"), (True, "frames", "Worst frames"),
        (True, "metrics", "Definitions"), (True, "made", "Provenance"),
    )  # fmt: skip
    return fill(
        "report.html.j2",
        data=data,
        groups=_groups(data["groups"]),
        sections=[(name, text) for there, name, text in sections if there],
        diagnoses=[diagnosis["sentence"] for diagnosis in summary.diagnoses],
        sentences=sentences(summary),
        cards=_cards(summary),
        lead=figures(pictures.lead),
        answer=(summary.benefit or {}).get("answer") or [""],
        verdicts=verdicts,
        errors=figures(pictures.errors),
        sweeps=figures(pictures.sweeps),
        matrix=figures(pictures.matrix),
        comparison=figures(pictures.comparison),
        maps=figures(pictures.calibration),
        uncertainty=figures(pictures.uncertainty),
        tables=tables,
        no_calibration=reason,
        regions=_regions(summary),
        asked=ASKED,
        scaled=any(_is_scaled(run["intrinsics"]) for run in summary.runs),
        stated_of_itself=stated,
        reliability=figures(pictures.reliability),
        overlays=[{"title": o.title, "text": o.text, "svg": Markup(o.svg)} for o in overlays.errors],
        stated=[{"title": o.title, "text": o.text, "svg": Markup(o.svg)} for o in overlays.stated],
        definitions=shown_table(metric_table(summary.metrics)),
        commands=commands(summary),
        settings=shown_table(pairs_table("settings", "Settings", ("Setting", "Value"), _facts(summary), "")),
        fidelity=shown_table(fidelity_table(measured)) if (measured or {}).get("circles") else None,
        no_fidelity=f"{fidelity_lines(measured)[0].capitalize()}.",
        versions=shown_table(
            pairs_table("versions", "Versions", ("Package", "Validation", "Rendering"), _versions(versions), "")
        ),
        checksums=shown_table(pairs_table("checksums", "Checksums", ("File", "sha256"), _checksums(summary), "")),
        version=versions["validate"]["roundel"],
    )


def _verdicts(verdicts: list[dict[str, Any]], pictures: list[Picture]) -> list[dict[str, Any]]:
    """Verdicts with their figures; each figure is shown once, beside the first verdict that names it."""
    left = {shown["name"]: shown for shown in figures(pictures)}
    keys = ("claim", "outcome", "qualifier", "sentence", "condition")
    rows = [
        {
            **{k: v.get(k) for k in keys},
            "settings": v.get("settings") or [],
            "colour": _COLOURS.get(v.get("outcome", ""), ""),
            "figure": left.pop(v.get("picture"), None),
        }
        for v in verdicts
    ]
    # Figures that no verdict names come last, without text, so that the list contains only claims.
    return [*rows, *({**dict.fromkeys(keys), "settings": [], "colour": "", "figure": shown} for shown in left.values())]


def _is_scaled(label: str) -> bool:
    its = IntrinsicsLabel.of(label)
    return its.kind == "scaled" and not its.is_right


def _regions(summary: Summary) -> list[dict[str, str]]:
    """Whether the 95 % regions of each run hold the truth."""
    return [
        {
            "run": f"{run['method']}, {run['intrinsics']}",
            "outcome": found["verdict"],
            "colour": _COLOURS.get(found["verdict"], ""),
            "text": f"{region_text(found)}.".capitalize(),
        }
        for run in summary.runs
        if (found := (run.get("coverage") or {}).get("oracle"))
    ]


def _groups(groups: dict[str, int], most: int = 8) -> str:
    """Groups with their numbers of frames; empty for a single group."""
    if len(groups) < 2:
        return ""
    named = ", ".join(f"{name}: {count}" for name, count in list(groups.items())[:most])
    return named + (f" and {len(groups) - most} more groups" if len(groups) > most else "")


def _cards(summary: Summary) -> list[dict[str, str]]:
    """The headline numbers of the main run, each with the method's name."""
    run = main_run(summary)
    method = run["method"]
    oracle, label = run["oracle"], IntrinsicsLabel.of(run["intrinsics"]).phrase
    share = "-" if not run["n"] else f"{100 * run['solved'] / run['n']:.4g} %"
    bare = detected_without_pose(run)
    if bare and not run["solved"]:
        off = oracle["centre_image_error_px"]["median"], run["ellipse"]["ellipse_centre_error_px"]["median"]
        return [
            {
                "value": f"{100 * bare / run['n']:.4g} %",
                "label": f"of {run['n']} circles found by {method}, without a pose",
            },
            {"value": f"{number(off[0])} px", "label": f"{method}: to the image of the circle's centre, median"},
            {"value": f"{number(off[1])} px", "label": f"{method}: to the centre of the ellipse, median"},
        ]
    normal, position, around = (
        number(oracle[f"{name}_error_{unit}"]["median"])
        for name, unit in (("normal", "deg"), ("position", "pct"), ("reprojection", "px"))
    )
    return [
        {"value": share, "label": f"of {run['n']} circles solved by {method}"},
        {"value": f"{normal}\N{DEGREE SIGN}", "label": f"{method}: normal, median, with {label}"},
        {"value": f"{position} %", "label": f"{method}: position, of the distance, median"},
        {"value": f"{around} px", "label": f"{method}: reprojection around the marker, median"},
    ]


def _facts(summary: Summary) -> list[tuple[str, str]]:
    """Settings as lines of text."""
    flat: list[tuple[str, Any]] = []
    for key, value in summary.settings.items():
        flat += [(f"{key}: {k}", v) for k, v in value.items()] if isinstance(value, dict) else [(key, value)]
    return [(key, _plain(value)) for key, value in flat]


def _plain(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, float):
        return number(value, 4)
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _versions(versions: dict[str, Any]) -> list[tuple[str, str, str]]:
    validation, rendering = versions["validate"], versions["render"] or {}
    names = sorted(set(validation) | set(rendering))
    return [(name, str(validation.get(name, "-")), str(rendering.get(name) or "-")) for name in names]


def _checksums(summary: Summary) -> list[tuple[str, str]]:
    return [("dataset_id", summary.dataset["dataset_id"]), *((k, str(v)) for k, v in summary.checksums.items())]
