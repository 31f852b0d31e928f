"""All questions that the scores of one run allow."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from roundel.validate.gate.accuracy import accuracy_questions
from roundel.validate.gate.checks import Check, Tested, rate
from roundel.validate.gate.detection import detection_questions
from roundel.validate.gate.quantities import BRANCH, MIN_CIRCLES, flags, floats
from roundel.validate.gate.uncertainty import uncertainty_questions

RIGHT_CANDIDATE = "right candidate"


def questions(
    run: str, new: pa.Table, old: pa.Table, false_new: pa.Table | None = None, false_old: pa.Table | None = None
) -> tuple[list[Tested], list[Check], list[str]]:
    """All tests that the scores of one run allow, checks that need no test, and notes on what is not compared.

    Parameters
    ----------
    run : str
    new, old : pyarrow.Table
        Scores of the same circles, row by row.
    false_new, false_old : pyarrow.Table or None
        False positives of the run; None if a side is of an older version.
    """
    accuracy, notes = accuracy_questions(run, new, old)
    detection, checks = detection_questions(run, new, old, false_new, false_old)
    out = [*accuracy, *uncertainty_questions(run, new, old), *detection]
    out.append(rate(run, "solved", flags(new, "solved"), flags(old, "solved")))
    return [*out, *_branch(run, new, old)], checks, notes


def _branch(run: str, new: pa.Table, old: pa.Table) -> list[Tested]:
    """Whether the right one of the two solutions is returned, or chosen, as often as before, and given at all."""
    right = [floats(t, BRANCH) for t in (new, old)]
    asked = np.isfinite(right[1]) & flags(new, "solved")
    known = asked & np.isfinite(right[0])
    if np.count_nonzero(asked) < MIN_CIRCLES:
        return []
    out = [rate(run, "candidate chosen", known[asked], np.ones(int(asked.sum())))] if np.any(asked & ~known) else []
    if np.count_nonzero(known) >= MIN_CIRCLES:
        out.append(rate(run, RIGHT_CANDIDATE, right[0][known], right[1][known]))
    return out
