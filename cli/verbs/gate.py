"""`roundel gate`, `roundel baseline` and `roundel compare`: reports held against each other."""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

from roundel.scenes.errors import DataError, RoundelError


def compare(arguments: argparse.Namespace) -> int:
    """Compare a report with a baseline; returns 1 if the report is worse."""
    from roundel.datasets.store.writing import write_file
    from roundel.solver.methods.registry import installed_methods
    from roundel.validate.gate.baseline import baseline_of_report, read_baseline
    from roundel.validate.gate.gate import gate
    from roundel.validate.gate.output import junit_xml, lines, markdown, refused_markdown, refused_xml

    def tell(junit: bytes, summary: str) -> None:
        if arguments.junit:
            write_file(arguments.junit, junit)
        step = os.environ.get("GITHUB_STEP_SUMMARY")
        if step:
            _append(Path(step), summary)

    try:
        result = gate(baseline_of_report(arguments.report), read_baseline(arguments.baseline))
    except RoundelError as error:
        # CI shows the contents of these files: a refused comparison must not look like a gate that did not run.
        tell(refused_xml(str(error)), refused_markdown(str(error)))
        raise
    result = replace(result, solvable=frozenset(method.name for method in installed_methods()))
    tell(junit_xml(result), markdown(result))
    print("\n".join(lines(result)))
    return 0 if result.passed else 1


def accept_baseline(arguments: argparse.Namespace) -> int:
    """Make the scores of a report the baseline."""
    from roundel.validate.gate.baseline import accept

    accepted = accept(arguments.report, arguments.baseline, arguments.reason)
    print(f"{arguments.baseline}: {accepted.rows.num_rows} scores accepted; commit the file")
    return 0


def print_history(arguments: argparse.Namespace) -> int:
    """The reasons for which a baseline was accepted."""
    from roundel.validate.gate.baseline import read_baseline

    baseline = read_baseline(arguments.baseline)
    for number, entry in enumerate(baseline.accepted, start=1):
        print(f"{number}. Roundel {entry['roundel']}: {entry['reason']}")
    print(f"{baseline.rows.num_rows} scores of dataset {baseline.dataset_id[:12]}, metrics {baseline.metric_version}")
    return 0


def _append(path: Path, text: str) -> None:
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise DataError(f"{path}: cannot write the step summary: {error.strerror}") from error


def compare_reports(arguments: argparse.Namespace) -> int:
    """One page over several reports."""
    from roundel.validate.report import compare as pages

    out = Path(arguments.out)
    print("\n".join(pages.compare_reports(arguments.reports, out)))
    print(f"comparison: {out / pages.PAGE}")
    return 0
