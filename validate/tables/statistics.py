"""Tables of recall at thresholds, comparisons with the main run, and statistical power."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from roundel.validate.scores.run_statistics import BOUNDED
from roundel.validate.scores.summary import Summary
from roundel.validate.tables.table import Cell, Column, Table

_RUN = (Column("method", "Method"), Column("intrinsics", "Intrinsics"))


def statistics_tables(summary: Summary, runs: Sequence[dict[str, Any]]) -> list[Table]:
    """The tables of the runs against the truth that are not empty."""
    found = [
        efficiency_table(runs),
        recall_table(runs),
        main_table(summary.comparisons),
        power_table(summary),
    ]
    return [table for table in found if table.rows]


def efficiency_table(runs: Sequence[dict[str, Any]]) -> Table:
    """Errors divided by the Cramer-Rao bounds of their own frames."""
    columns = list(_RUN)
    errors = [metric.name for metric in BOUNDED]
    for key, metric in zip(errors, BOUNDED, strict=True):
        columns += [Column(f"{key}_rms_over_bound", metric.title, "RMS / bound")]
        columns += [Column(f"{key}_{end}", "", role=end) for end in ("low", "high")]
        columns += [Column(f"{key}_circles", "", role="file")]
    rows = []
    for run in runs:
        found = run.get("efficiency") or {}
        cells = [(found.get(key) or {}).get(k) for key in errors for k in ("rms", "rms_low", "rms_high", "n")]
        if any(cells):
            rows.append((run["method"], run["intrinsics"], *cells))
    note = (
        "RMS over the circles of each error divided by the Cramer-Rao bound of its own frame, with its 95 % interval "
        "in brackets. About 1 is the best that an unbiased method can do with these pixels; wrong intrinsics, and an "
        "image with less information than the bound assumes, increase it. Oracle: the candidate nearer to the truth. "
        "The units cancel."
    )
    return Table("efficiency", "Errors over their Cramer-Rao bounds", tuple(columns), tuple(rows), note)


def recall_table(runs: Sequence[dict[str, Any]]) -> Table:
    """Share of the circles whose error is below a threshold; unsolved circles are never below it."""
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        for which, errors in (run.get("recall") or {}).items():
            for error in (errors or {}).values():
                for level in error.get("levels", ()):
                    shares = (None if level[k] is None else 100 * level[k] for k in ("rate", "low", "high"))
                    head = (run["method"], run["intrinsics"], which, error["title"], error["unit"])
                    rows.append((*head, level["threshold"], *shares, level["n"]))
    columns = (
        *_RUN,
        Column("candidate", "Candidate"),
        Column("error", "Error"),
        Column("unit", "Unit"),
        Column("threshold", "At most"),
        Column("recall_pct", "Recall", "%"),
        Column("recall_low_pct", "", "%", "low"),
        Column("recall_high_pct", "", "%", "high"),
        Column("circles", "Circles", "count"),
    )
    note = (
        "Share of all circles, solved or not, whose error is at most the threshold, with its 95 % Wilson interval in "
        "brackets. Oracle: the candidate whose normal is nearer to the truth. Errors are defined below."
    )
    return Table("recall", "Recall at thresholds", columns, tuple(rows), note)


def main_table(comparisons: Sequence[dict[str, Any]]) -> Table:
    """Every other run compared with the main run."""
    columns = (
        *_RUN,
        Column("error", "Error"),
        Column("circles", "Circles", "both solved"),
        Column("ratio_rms", "RMS over the main run's"),
        Column("ratio_low", "", role="low"),
        Column("ratio_high", "", role="high"),
        Column("p_holm", "p", "Holm"),
        Column("verdict", "Verdict"),
    )
    rows = tuple(
        (c["method"], c["intrinsics"], c["metric"], c["n"], c["ratio"], c["low"], c["high"], c["p_holm"], c["verdict"])
        for c in comparisons
        if c["reference"] == "truth"
    )
    note = (
        "Paired by circle. Ratio of the RMS errors, with its 95 % interval by bootstrap over frames in brackets; p: "
        "Holm-corrected over the report. Units cancel; columns of scores.parquet."
    )
    return Table("against_main", "Runs compared with the main run", columns, rows, note)


def power_table(summary: Summary) -> Table:
    """The change of an error that these frames can detect."""
    columns = (
        *_RUN,
        Column("error", "Error"),
        Column("frames", "Frames", "count"),
        Column("change_pct", "Detectable change", "%"),
    )
    rows = tuple(
        (p["method"], p["intrinsics"], p["error"].replace("_", " "), p["frames"],
         None if p["change"] is None else 100 * p["change"])
        for p in summary.power
        if p["reference"] == "truth"
    )  # fmt: skip
    return Table("power", "Statistical power", columns, rows, summary.power_note)
