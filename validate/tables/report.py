"""Tables of a report, made from its summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from roundel.datasets.fidelity.summary import fidelity_lines
from roundel.validate.metrics.metric import (
    ALONG_RAY,
    CENTRE_IMAGE,
    CONTOUR,
    ELLIPSE_CENTRE,
    FOCAL,
    FUSED_FOCAL,
    NORMAL,
    POSITION,
    POSITION_D,
    REPROJECTION,
    Metric,
)
from roundel.validate.scores.summary import CHESSBOARD, Summary, detected_without_pose
from roundel.validate.tables.calibration import calibration_tables
from roundel.validate.tables.calibration_benefit import benefit_table
from roundel.validate.tables.statistics import statistics_tables
from roundel.validate.tables.table import Cell, Column, Table
from roundel.validate.tables.uncertainty import probability_tables, uncertainty_table

Run = dict[str, Any]

NAMES = (
    "benefit", "verdicts", "results", "centres", "chosen", "readings", "uncertainty", "probabilities",
    "probability_bins", "worst_stated", "groups", "failures", "caveats", "comparisons", "solved_by_one",
    "stated_pairs", "level_comparisons", "level_solved_by_one", "efficiency", "power", "against_main", "recall",
    "cells", "calibrations", "calibration_errors", "boards", "against_chessboard",
)  # fmt: skip

_FRAME = (
    "Camera frame (x right, y down, z forward), pixels of the delivered image with (0, 0) at the centre of the "
    "top-left one. D: outer diameter. Along the ray: positive is too far."
)
_STATISTIC = "Median over the solved circles, with its 95 % interval in brackets; after the slash the 95th percentile."
_ORACLE = "Oracle: the candidate pose whose normal is nearer to the truth, used in every column."

# The errors that a table of runs shows.
_ERRORS = (NORMAL, POSITION, POSITION_D, ALONG_RAY, REPROJECTION)
_CENTRES = (("oracle", CENTRE_IMAGE, "To the circle's"), ("ellipse", ELLIPSE_CENTRE, "To the ellipse's"))


def report_tables(summary: Summary) -> dict[str, Table]:
    """Every table of a report that is not empty, by name."""
    runs = summary.runs
    grid = _grid(summary)
    mine = [r for r in runs if r["reference"] == "truth" and r["method"] != CHESSBOARD]
    note = f"{_STATISTIC} {_ORACLE} {_FRAME} {grid}"
    board_note = (
        f"{_STATISTIC} The board's pose by solvePnP; a board has no diameter. {_FRAME} Reprojection: a 3x3 grid of "
        "half the board's longer side."
    )
    against = (
        f"{_STATISTIC} The reference is the board's pose by solvePnP, transferred to the circle by the layout of the "
        f"target sheet; errors are those of the candidate whose normal is nearer to the reference. {_FRAME} {grid}"
    )
    chosen_note = (
        f"{_STATISTIC} The candidate that the solver chose; circles without a choice are left out. {_FRAME} {grid}"
    )
    groups = [g for g in summary.groups if g["reference"] == "truth" and g["method"] != CHESSBOARD]
    found = [
        benefit_table(summary.benefit),
        verdict_table(summary.verdicts),
        result_table(mine, summary),
        centre_table(mine),
        run_table("chosen", "Errors of the chosen candidate", [r for r in mine if r["branch_chosen"]], "chosen",
                  chosen_note),
        reading_table(mine),
        run_table("groups", "Errors by group", groups, "oracle", note),
        uncertainty_table(mine),
        *probability_tables(mine),
        failure_table(summary),
        caveat_table(summary),
        *statistics_tables(summary, mine),
        cell_table(summary.cells),
        *calibration_tables(summary),
        run_table("boards", "Chessboard poses against the truth",
                  [r for r in runs if r["method"] == CHESSBOARD], "oracle", board_note),
        run_table("against_chessboard", "Estimates against the chessboard poses",
                  [r for r in runs if r["reference"] == "chessboard"], "oracle", against),
    ]  # fmt: skip
    return {table.name: table for table in found if table.rows}


def reading_table(runs: Sequence[Run]) -> Table:
    """Focal lengths and identities, of the runs that read them."""
    columns = [Column("method", "Method"), Column("intrinsics", "Intrinsics")]
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        focal = [run["image"][m.column] for m in (FOCAL, FUSED_FOCAL)]
        if focal[0]["n"] or run["identities_read"]:
            errors = [one.get(key) for one in focal for key in ("median", "median_low", "median_high")]
            wrong = run["identities_read"] - run["identities_correct"] if run["identities_read"] else None
            rows.append(
                (run["method"], run["intrinsics"], focal[0]["n"], *errors, wrong, run["identities_read"] or None)
            )
    columns.append(Column("focal_lengths", "Focal lengths"))
    for metric, title in ((FOCAL, "From the image alone"), (FUSED_FOCAL, "Fused with the default prior")):
        low, high = (Column(f"{metric.column}_{end}", title, metric.unit, end) for end in ("low", "high"))
        columns += [Column(metric.column, title, metric.unit), low, high]
    columns += [Column("identities_wrong", "Wrong identities"), Column("identities_read", "", role="of")]
    note = (
        "Medians of the magnitude of the relative error, with 95 % intervals in brackets. The prior is the default "
        "phone's, with a standard deviation of 11.5 %."
    )
    return Table("readings", "Focal length and identity", tuple(columns), tuple(rows), note)


def _grid(summary: Summary) -> str:
    extent = f"{summary.settings['reprojection_extent_D']:g}"
    return f"Reprojection: mean of a 3x3 grid of \N{PLUS-MINUS SIGN}{extent} D around the marker."


def _pooled(summary: Summary) -> str:
    keys = dict.fromkeys((summary.dataset.get("sweeps") or {}).values())
    return f" All levels of {' and of '.join(keys)} are pooled." if keys else ""


def result_table(runs: Sequence[Run], summary: Summary, first: Sequence[str] = ()) -> Table:
    """Runs against the truth, of one report or of several with the settings of `summary`."""
    note = f"{_STATISTIC} {_ORACLE} {_FRAME} {_grid(summary)}{_pooled(summary)}"
    return run_table("results", "Errors of the better candidate", runs, "oracle", note, first)


def run_table(name: str, title: str, runs: Sequence[Run], which: str, note: str, first: Sequence[str] = ()) -> Table:
    """Runs and their errors; `first` names keys of the runs that precede the method."""
    names = [*first] + ["method", "intrinsics"] + ["group"] * any("group" in r for r in runs)
    errors = [_errors(runs, "ellipse" if e.of == "ellipse" else which, e) for e in (*_ERRORS, CONTOUR)]
    # A page is not wide enough for all columns: errors in diameters are only in the files.
    errors = [
        ([replace(c, role="file") for c in more] if more and more[0].unit == POSITION_D.unit else more, cells)
        for more, cells in errors
    ]
    columns: list[Column] = [Column(n, n.capitalize()) for n in names]
    columns += [
        Column("solved", "Solved"),
        Column("circles", "", role="of"),
        Column("solved_low_pct", "", "%", "low"),
        Column("solved_high_pct", "", "%", "high"),
    ]
    rows: list[list[Cell]] = [
        [*(r[n] for n in names), r["solved"], r["n"], _percent(r, "low"), _percent(r, "high")] for r in runs
    ]
    for more, cells in errors:
        if not more or (more[0].title == CONTOUR.title and which == "chosen"):
            continue
        columns += more
        for row, cell in zip(rows, cells, strict=True):
            row += cell
    if which == "oracle" and any(r.get("false_detections") is not None for r in runs):
        columns += [Column("false_detections", "False positives", "count")]
        for row, run in zip(rows, runs, strict=True):
            row.append(run.get("false_detections"))
    if which == "chosen":
        columns += [Column("branch_correct", "Right", "of chosen"), Column("branch_chosen", "", role="of")]
        for row, run in zip(rows, runs, strict=True):
            row += [run["branch_correct"], run["branch_chosen"]]
    if any(c.key == "false_detections" for c in columns):
        note += " False positives: detections that match no marker."
    return Table(name, title, tuple(columns), tuple(map(tuple, rows)), note)


def centre_table(runs: Sequence[Run]) -> Table:
    """Centre errors of all runs; empty unless a run found circles without giving a pose."""
    columns = [Column("method", "Method"), Column("intrinsics", "Intrinsics"), Column("found", "Found"),
               Column("circles", "", role="of")]  # fmt: skip
    rows: list[list[Cell]] = [[r["method"], r["intrinsics"], r.get("detected"), r["n"]] for r in runs]
    for which, error, title in _CENTRES:
        more, cells = _errors(runs, which, error, title)
        columns += more
        for row, cell in zip(rows, cells or [[]] * len(rows), strict=True):  # without this error there are no columns
            row += cell
    note = (
        f"{_STATISTIC.replace('solved', 'found')} Distance to the image of the circle's centre, and to the centre of "
        "its ellipse; perspective separates the two. Judge a method by the column of the point that it estimates. "
        "Delivered image."
    )
    shown = tuple(map(tuple, rows)) if any(map(detected_without_pose, runs)) else ()
    return Table("centres", "Centre errors, with and without a pose", tuple(columns), shown, note)


def _percent(run: Run, end: str) -> float | None:
    value = (run.get("solved_interval") or {}).get(end)
    return None if value is None else 100 * value


def _errors(runs: Sequence[Run], which: str, error: Metric, title: str = "") -> tuple[list[Column], list[list[Cell]]]:
    """Columns and cells of one error, with its own title by default; empty if no run has it."""
    title, sign = title or error.title, error.signed
    found = [run[which].get(error.column) or {"n": 0} for run in runs]
    if not any(s["n"] for s in found):
        return [], []
    # A 95th percentile of magnitudes would hide the sign of an error along the ray.
    kinds = [("median", ""), ("median_low", "low"), ("median_high", "high"), ("p95", "file" if sign else "tail")]
    kinds += [(name, "file") for name in ("p95_low", "p95_high", "rms", "rms_low", "rms_high", "n")]
    kinds = [k for k in kinds if any(s.get(k[0]) is not None for s in found)]
    columns = [Column(f"{error.table_column}_{name}", title, error.table_unit, role, sign) for name, role in kinds]

    def cell(s: dict[str, Any], name: str) -> Cell:
        value = s.get(name)
        return value if value is None or name == "n" else error.shown_scale * value

    return columns, [[cell(s, name) for name, _ in kinds] for s in found]


def verdict_table(verdicts: Sequence[dict[str, Any]]) -> Table:
    """The claims and their outcomes."""
    columns = (
        Column("claim", "Claim"), Column("outcome", "Outcome"), Column("qualifier", "Qualifier"),
        Column("sentence", "Finding"),
        Column("condition", "Condition"), Column("statistic", "Statistic"),
    )  # fmt: skip
    rows = tuple(tuple(_text(v.get(c.key)) for c in columns) for v in verdicts)
    return Table("verdicts", "Verdicts", columns, rows, "Each sentence gives the statistic and its unit.")


def _text(value: Any) -> Cell:
    if isinstance(value, dict):
        return "; ".join(f"{k}: {_text(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(str(_text(v)) for v in value)
    return value if value is None or isinstance(value, (str, int, float)) else str(value)


def failure_table(summary: Summary) -> Table:
    """Failures; intrinsics that share them are in one row, as most do because detection does not use intrinsics."""
    grouped: dict[tuple[Any, ...], list[str]] = {}
    for f in summary.failures:
        grouped.setdefault((f["method"], f["reference"], f["reason"], f["count"]), []).append(f["intrinsics"])
    columns = (
        Column("method", "Method"), Column("intrinsics", "Intrinsics"), Column("reference", "Against"),
        Column("reason", "Reason"), Column("circles", "Circles", "count"),
    )  # fmt: skip
    rows = tuple((m, ", ".join(labels), ref, why, n) for (m, ref, why, n), labels in grouped.items())
    settings = summary.settings
    note = (
        "Circles without an error, by reason. A detection matches a circle if the mean distance of their contours in "
        f"the delivered image is within {settings['gate_px']:g} px or "
        f"{100 * settings['gate_fraction_of_minor_semi_axis']:g} % of the minor semi-axis."
    )
    return Table("failures", "Failures", columns, rows, note)


def caveat_table(summary: Summary) -> Table:
    """Detections by kind of caveat; intrinsics that share a count are in one row."""
    grouped: dict[tuple[Any, ...], list[str]] = {}
    for c in summary.caveats:
        grouped.setdefault((c["method"], c["caveat"], c["count"], c["of"]), []).append(c["intrinsics"])
    columns = (
        Column("method", "Method"), Column("intrinsics", "Intrinsics"), Column("caveat", "Caveat"),
        Column("count", "Detections", "count"), Column("of", "Of", "count"),
    )  # fmt: skip
    rows = tuple((m, ", ".join(labels), what, n, of) for (m, what, n, of), labels in grouped.items())
    note = (
        "What the methods' models did not hold for, by their own account; the sentences of each detection are in the "
        "column caveats of the estimates."
    )
    return Table("caveats", "Caveats", columns, rows, note)


def cell_table(cells: Sequence[Run]) -> Table:
    """The numbers behind the figures over a grid."""
    texts = ("method", "intrinsics", "reference", "group")
    errors = [metric for metric in _ERRORS if not metric.signed]
    columns = (
        *(Column(n, "Against" if n == "reference" else n.capitalize()) for n in texts),
        Column("tilt_deg", "Tilt", "deg"), Column("distance_D", "Distance", "D"),
        Column("solved", "Solved"), Column("circles", "", role="of"),
        *(Column(f"{e.column}_mean", e.title, e.unit) for e in errors),
    )  # fmt: skip
    rows = tuple(
        (*(c[n] for n in texts), c["tilt_deg"], c["distance_D"], c["solved"], c["n"],
         *(c["oracle"][e.column]["mean"] for e in errors))
        for c in cells
    )  # fmt: skip
    note = f"Means of the better candidate over the solved circles of a cell. {_FRAME}"
    return Table("cells", "Mean errors by cell of the grid", columns, rows, note)


def metric_table(metrics: Sequence[dict[str, Any]]) -> Table:
    """Definitions of the errors."""
    columns = (
        Column("title", "Error"), Column("unit", "Unit"), Column("frame", "Frame"), Column("definition", "Definition"),
        *([Column("source", "Source")] if any(m.get("source") for m in metrics) else []), Column("column", "Column"),
    )  # fmt: skip
    note = (
        "Camera frame: x right, y down, z forward, metres. The normal points out of the printed face, toward the "
        "camera. The centre of the top-left pixel is (0, 0). Columns are those of scores.parquet; the prefix oracle_ "
        "marks the better candidate."
    )
    return Table(
        "definitions", "Definitions", columns, tuple(tuple(m.get(c.key) for c in columns) for m in metrics), note
    )


def pairs_table(name: str, title: str, heads: tuple[str, ...], rows: Sequence[tuple[Any, ...]], note: str) -> Table:
    """A table of plain text: settings, versions, checksums."""
    columns = tuple(Column(head.lower().replace(" ", "_"), head) for head in heads)
    return Table(name, title, columns, tuple(rows), note)


def fidelity_table(measured: dict[str, Any] | None) -> Table:
    """Differences of the images from a prediction: over all circles, then by effect if there are several."""
    measured = measured or {}
    effects = measured.get("by_effect", {}) if measured.get("circles") else {}
    every = [("all" if len(effects) != 1 else next(iter(effects)), measured)] if measured.get("circles") else []
    rows = every + (list(effects.items()) if len(effects) > 1 else [])
    shifts = (("shift_x_px", "Shift x"), ("shift_y_px", "Shift y"), ("scale_px", "Size"))
    columns = [Column("effect", "Effect at the edge"), Column("circles", "Circles", "count")]
    for key, title in shifts:
        columns += [Column(key, title, "px", signed=True), Column(f"{key}_low", "", "px", "low", True),
                    Column(f"{key}_high", "", "px", "high", True)]  # fmt: skip
    columns += [
        Column("residual_pct", "Residual", "% of contrast"),
        Column("monte_carlo_pct", "Monte-Carlo", "% of contrast"),
        Column("pixel_test_passed", "Pixel test", "passed"),
    ]
    cells = []
    for name, f in rows:
        means = [v for key, _ in shifts for v in (f[key]["mean"], f[key]["mean"] - f[key]["ci95"],
                                                  f[key]["mean"] + f[key]["ci95"])]  # fmt: skip
        passed = f"{f['z_passed']}" + ("" if f["z_consistent"] else " (too few)")
        cells.append(
            (name.replace("_", " "), f["circles"], *means, 100 * f["residual"], 100 * f["monte_carlo"], passed)
        )
    note = (
        "Image against a float64 prediction that shares only the camera's forward projection with the renderer, "
        "measured when the dataset was made, in pixels of the delivered image: mean over the circles with its 95 % "
        "interval, residual at the edge, and the number of circles whose pixels differ from the prediction by their "
        "Monte-Carlo error alone (level 1 %)."
    )
    last = fidelity_lines(measured or None)[-1]
    if last.startswith("  not"):
        note += f" {last.strip().capitalize()}."
    return Table("fidelity", "Fidelity", tuple(columns), tuple(cells), note)
