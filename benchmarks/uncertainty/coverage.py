"""How often does the truth lie in the regions that the solver states? Group by group, and level by level of a nuisance.

    python benchmarks/uncertainty/coverage.py REPORT... [--intrinsics true] [--markdown FILE]

REPORT is the report of a study, such as out/benchmark/report or out/robustness/noise/report. For each of its groups, or
for each level of a swept group, the table has the share of poses whose truth lies in the stated regions of 50, 90, 95
and 99 %, with Wilson's interval, and the median chi-square of the pose's five degrees of freedom (4.35 if covariances
hold). Of the two candidates, the one nearer to the truth counts. A pose without a covariance is not counted.

The 95 % region should hold between 90 and 98 % of the truths. Where its share lies outside that range, the last column
says so: `may be chance` if the interval reaches into the range. All levels of a study together have the narrowest
interval; their frames are the same, so that frames and not poses are counted. `--markdown` replaces the table in FILE
between two comments, and leaves the text around it.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from roundel.validate.metrics.rows import column, text_column, where_text
from roundel.validate.metrics.uncertainty import percentile_of
from roundel.validate.scores.stated_uncertainty import COVERAGE_LEVELS, JUDGED, LEAST, MOST
from roundel.validate.statistics.intervals import Interval, rate_interval

CHI2 = "oracle_pose_chi2"
HEAD = (
    *("study", "group or level", "frames", "with covariance"),
    *(f"in {100 * level:g} %" for level in COVERAGE_LEVELS),
    *("median chi-square", f"in {100 * JUDGED:g} % within {100 * LEAST:g} to {100 * MOST:g} %"),
)


def parts(scores: pa.Table) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Groups of a report, or the levels of its sweeps, and all together: name and rows."""
    groups, level = text_column(scores, "group"), column(scores, "sweep_level")
    names = list(dict.fromkeys(groups.tolist()))
    for name in names:
        swept = np.unique(level[(groups == name) & np.isfinite(level)])
        title = "" if len(names) == 1 else f"{name} "
        for value in swept:
            yield f"{title}{value:g}", (groups == name) & (level == value)
        if not len(swept):
            yield name, groups == name
    yield "all", np.ones(scores.num_rows, dtype=bool)


def share_text(found: Interval) -> str:
    """A share with its interval, in per cent."""
    if found.value is None or found.low is None or found.high is None:
        return ""
    return f"{100 * found.value:.1f} ({100 * found.low:.1f} to {100 * found.high:.1f})"


def verdict(found: Interval) -> str:
    """Whether a share of the 95 % region is within what is wanted; by chance it may not seem so."""
    if found.value is None or found.low is None or found.high is None:
        return ""
    if LEAST <= found.value <= MOST:
        return "yes"
    way = "too few" if found.value < LEAST else "too many"
    sure = found.high < LEAST or found.low > MOST
    return f"**{way}**" if sure else f"{way}; may be chance"


def rows_of(study: str, scores: pa.Table) -> Iterator[tuple[str, ...]]:
    """Lines of the table for one report.

    Parameters
    ----------
    study : str
        Its name.
    scores : pyarrow.Table
        Of one run against the truth.
    """
    percentile = percentile_of(column(scores, CHI2))
    swept = column(scores, "sweep_frame")
    frames = np.where(np.isfinite(swept), swept, column(scores, "frame_id"))
    for name, rows in parts(scores):
        known = rows & np.isfinite(percentile)
        found = {level: rate_interval(percentile[known] <= level, frames[known]) for level in COVERAGE_LEVELS}
        median = f"{np.median(column(scores, CHI2)[known]):.2f}" if known.any() else ""
        shares = (share_text(found[level]) for level in COVERAGE_LEVELS)
        counts = str(int(rows.sum())), str(int(known.sum()))
        yield study, name, *counts, *shares, median, verdict(found[JUDGED])


def read_scores(report: Path, intrinsics: str) -> tuple[str, pa.Table]:
    """Name of a report's study, and its scores against the truth with one kind of intrinsics."""
    summary: dict[str, Any] = json.loads((report / "summary.json").read_text(encoding="utf-8"))
    scores = pq.read_table(report / "scores.parquet")
    kept = where_text(scores, reference="truth", intrinsics=intrinsics)
    return str(summary["dataset"]["name"]), scores.filter(pa.array(kept))


def table_of(rows: list[tuple[str, ...]]) -> str:
    """The table in Markdown; a study is named in its first line."""
    lines = ["| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|"]
    for i, (study, *cells) in enumerate(rows):
        first = i == 0 or rows[i - 1][0] != study
        lines.append("| " + " | ".join((study if first else "", *cells)) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("reports", nargs="+", type=Path, metavar="REPORT")
    parser.add_argument("--intrinsics", default="true", help="kind of intrinsics (default: true)")
    parser.add_argument("--markdown", type=Path, help="put the table into this page")
    arguments = parser.parse_args()
    rows = [line for report in arguments.reports for line in rows_of(*read_scores(report, arguments.intrinsics))]
    table = table_of(rows)
    print(table)
    if arguments.markdown:
        page = arguments.markdown.read_text(encoding="utf-8")
        page, places = re.subn(
            r"(<!-- table -->\n).*?(<!-- end -->)", lambda m: f"{m[1]}\n{table}\n\n{m[2]}", page, flags=re.DOTALL
        )
        if places != 1:
            raise SystemExit(f"{arguments.markdown} has {places} places for the table; expected one")
        arguments.markdown.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
