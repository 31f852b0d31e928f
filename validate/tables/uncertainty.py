"""The table of stated uncertainties: how often the truth lies in the regions that a run states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from roundel.validate.scores.run_statistics import COVERAGE_LEVELS
from roundel.validate.tables.table import Cell, Column, Table


def uncertainty_table(runs: Sequence[dict[str, Any]]) -> Table:
    """How often the truth lies in the regions that a run states, of the runs that state any."""
    columns = [
        Column("method", "Method"),
        Column("intrinsics", "Intrinsics"),
        Column("poses", "Poses", "with covariance"),
    ]
    for level in COVERAGE_LEVELS:
        name, title = f"within_{100 * level:g}", f"In the {100 * level:g} % region"
        columns += [Column(f"{name}_pct", title, "%"), Column(f"{name}_low_pct", title, "%", "low"),
                    Column(f"{name}_high_pct", title, "%", "high")]  # fmt: skip
    columns += [Column("median_chi2", "Chi-square", "median"), Column("log_score", "Log score", "mean")]
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        found = (run.get("coverage") or {}).get("oracle")
        if found:
            shares = [
                None if entry[end] is None else 100 * entry[end]
                for entry in found["levels"]
                for end in ("rate", "low", "high")
            ]
            head = (run["method"], run["intrinsics"], found["n"])
            rows.append((*head, *shares, found["median_chi2"], found["log_score"]))
    note = (
        "Share of poses whose truth lies in the region that the method states for that probability, with its 95 % "
        "interval in brackets: the same number, if the covariance holds. Of the better candidate, five degrees of "
        "freedom (the normal's two angles and the centre); the median chi-square would be 4.35. Log score: minus the "
        "logarithm of the stated density at the truth, in metres and radians; smaller is better."
    )
    return Table("uncertainty", "Uncertainty", tuple(columns), tuple(rows), note)
