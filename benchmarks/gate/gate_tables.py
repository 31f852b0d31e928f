"""Comparisons counted: how many fail the gate, and by which checks."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable

from roundel.validate.gate.baseline import Baseline
from roundel.validate.gate.gate import GateResult, gate
from roundel.validate.statistics.intervals import wilson_interval

HEAD = ["| comparisons | number | failed | rate (Wilson, 95 %) | by |", "|---|---|---|---|---|"]
_MOST = 6  # checks that a row names


def worse(result: GateResult) -> list[str]:
    """Names of the failed checks."""
    return [check.name for check in result.checks if check.verdict == "worse"]


def any_check(result: GateResult) -> bool:
    """Whether the gate fails."""
    return not result.passed


def row(title: str, pairs: Iterable[tuple[Baseline, Baseline]], found: Callable[[GateResult], bool] = any_check) -> str:
    """A row of a table: comparisons, how many are found (by default: fail), and the checks that failed.

    Checks of a group are counted together, under the name without the group.
    """
    n = hits = 0
    names: Counter[str] = Counter()
    for new, old in pairs:
        result = gate(new, old)
        n, hits = n + 1, hits + found(result)
        names.update({re.sub(r" in .*", " in a group", name) for name in worse(result)})
    if n == 0:
        return f"| {title} | 0 | | | |"
    interval = wilson_interval(hits, n)
    low, high = (100 * (v or 0.0) for v in (interval.low, interval.high))
    by = ", ".join(f"{name} {count}" for name, count in names.most_common(_MOST))
    return f"| {title} | {n} | {hits} | {100 * hits / n:.1f} % ({low:.1f} to {high:.1f}) | {by} |"
