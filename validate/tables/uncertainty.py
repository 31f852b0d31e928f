"""Tables of what a run states of itself: the regions of its poses, the probabilities of its candidates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from roundel.validate.metrics.rows import Rows
from roundel.validate.metrics.uncertainty import tail_of
from roundel.validate.scores.stated_uncertainty import ASKED, COVERAGE_LEVELS, worst_stated
from roundel.validate.scores.summary import CHESSBOARD, run_keys, run_rows
from roundel.validate.tables.table import Cell, Column, Table

# Circles of a run in the table of the worst, and runs.
_WORST, _MAX_RUNS = 3, 12


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
    columns += [Column("median_chi2", "Chi-square", "median"), Column("log_score", "Log score", "mean"),
                Column("verdict", "95 % regions hold the truth", role="file")]  # fmt: skip
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
            rows.append((*head, *shares, found["median_chi2"], found["log_score"], found["verdict"]))
    note = (
        "Share of poses whose truth lies in the region that the method states for that probability, with its 95 % "
        "interval in brackets: the same number, if the covariance holds. Of the better candidate, five degrees of "
        "freedom (the normal's two angles and the centre); the median chi-square would be 4.35. Log score: minus the "
        "logarithm of the stated density at the truth, in metres and radians; smaller is better. Verdict: by the "
        f"interval of the 95 % region's share, all of which is within {ASKED}, below it (too narrow) or above it (too "
        "wide)."
    )
    return Table("uncertainty", "Uncertainty", tuple(columns), tuple(rows), note)


# What is stated with a probability, by its key in a run of the summary.
_STATEMENTS = {"choice": "which candidate", "confidence": "is it a marker"}


def probability_tables(runs: Sequence[dict[str, Any]]) -> list[Table]:
    """How often what is stated with a probability is right: of each run that states any, and by probability."""
    head = [
        Column("statement", "Statement"), Column("method", "Method"), Column("intrinsics", "Intrinsics"),
        Column("n", "Stated", "count"), Column("stated_pct", "Stated", "%"), Column("right_pct", "Right", "%"),
        Column("right_low_pct", "", "%", "low"), Column("right_high_pct", "", "%", "high"),
    ]  # fmt: skip
    scores = [
        Column("log_score", "Log score", "mean"), Column("brier", "Brier score", "mean"),
        Column("brier_constant", "Of a constant", role="tail"),
    ]  # fmt: skip
    whole: list[tuple[Cell, ...]] = []
    bins: list[tuple[Cell, ...]] = []
    for key, statement in _STATEMENTS.items():
        for method, labels, found in _stated(runs, key):
            names = (statement, method, labels)
            own = (found["log_score"], found["brier"], found["brier_constant"])
            whole.append((*names, *_share({**found["right"], "stated": found["stated"]}), *own))
            bins += [(*names, *_share(entry)) for entry in found["bins"]]
    note = (
        "Which candidate: poses of which the method holds one candidate for likelier; right if it is the one nearer to "
        "the truth. Is it a marker: detections with a stated confidence; right if it matches a marker, so that another "
        "circle counts as wrong. The mean stated probability, and how often it is right, with its 95 % interval in "
        "brackets. Log score: minus the logarithm of the probability stated for what came true; 0.693 says nothing. "
        "Brier score: mean square of the stated probability minus the outcome, 0 or 1; after the slash that of the one "
        "constant that is right on average. Smaller is better in both."
    )
    by = "By stated probability. Statements, intervals and what counts as right as in the table above."
    return [
        Table("probabilities", "Stated probabilities", (*head, *scores), tuple(whole), note),
        Table("probability_bins", "Stated probabilities, by probability", tuple(head), tuple(bins), by),
    ]


def _stated(runs: Sequence[dict[str, Any]], key: str) -> list[tuple[str, str, dict[str, Any]]]:
    """Method, intrinsics and reliability of the runs that state it; intrinsics that share all numbers are together."""
    shared: dict[str, tuple[str, list[str], dict[str, Any]]] = {}
    for run in runs:
        if found := run.get(key):
            shared.setdefault(f"{run['method']} {found}", (run["method"], [], found))[1].append(run["intrinsics"])
    return [(method, ", ".join(labels), found) for method, labels, found in shared.values()]


def _share(entry: dict[str, Any]) -> tuple[Cell, ...]:
    shares = (None if entry[end] is None else 100 * entry[end] for end in ("rate", "low", "high"))
    return (entry["n"], 100 * entry["stated"], *shares)


def worst_stated_table(table: Rows) -> Table:
    """The circles whose truth is farthest outside of what was stated for them, of each run against the truth."""
    columns = (
        Column("method", "Method"), Column("intrinsics", "Intrinsics"), Column("frame_id", "Frame"),
        Column("marker_id", "Marker"), Column("distance_D", "Distance", "D"), Column("tilt_deg", "Tilt", "deg"),
        Column("pose_chi2", "Chi-square"), Column("p", "p"),
        Column("normal_error_deg", "Normal", "deg"), Column("normal_in_sigma", "Normal", "sigmas"),
        Column("position_error_pct", "Position", "%"), Column("position_in_sigma", "Position", "sigmas"),
        Column("depth_in_sigma", "Depth", "sigmas", signed=True),
    )  # fmt: skip
    keys = [key for key in run_keys(table) if key[2] == "truth" and key[0] != CHESSBOARD][:_MAX_RUNS]
    rows = []
    for key in keys:
        for row in worst_stated(run_rows(table, key), _WORST):
            o = {name.removeprefix("oracle_"): value for name, value in row.items() if name.startswith("oracle_")}
            own = _over(o["position_error_m"], o["position_sigma_m"]), _over(o["along_ray_m"], o["depth_sigma_m"])
            rows.append(
                (*key[:2], row["frame_id"], row["marker_id"], row["distance_D"], row["tilt_deg"], o["pose_chi2"],
                 float(tail_of(o["pose_chi2"])), o["normal_error_deg"],
                 _over(o["normal_error_deg"], o["normal_sigma_deg"]), o["position_error_pct"], *own)
            )  # fmt: skip
    note = (
        f"The {_WORST} circles of each run with the largest chi-square of the better candidate, and its errors in "
        "units of their stated standard deviations. p: the probability of a larger chi-square, if the covariance "
        "holds; the smallest of n circles is about 1 / n then. The pictures show those of the most accurate intrinsics."
    )
    return Table("worst_stated", "Farthest outside of what was stated", columns, tuple(rows), note)


def _over(error: float | None, sigma: float | None) -> float | None:
    return None if error is None or not sigma else error / sigma
