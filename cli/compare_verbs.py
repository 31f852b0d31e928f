"""`roundel compare`."""

from __future__ import annotations

import argparse
from pathlib import Path


def compare(arguments: argparse.Namespace) -> int:
    """One page over several reports."""
    from roundel.validate.report.compare import PAGE, compare_reports

    out = Path(arguments.out)
    print("\n".join(compare_reports(arguments.reports, out)))
    print(f"comparison: {out / PAGE}")
    return 0
