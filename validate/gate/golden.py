"""Golden frames: circles that are compared one by one on the same images, where a test would see only noise."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa

from roundel.validate.gate.checks import Check
from roundel.validate.gate.quantities import QUANTITIES, beside_truth, flags, floats

# An error may grow by half, or by this many bounds, whichever is larger. New noise on the same scene stays below that;
# a bug does not.
GOLDEN = 16
GOLDEN_RELATIVE = 0.5
GOLDEN_BOUNDS = 8.0


def golden(run: str, new: pa.Table, old: pa.Table) -> Check:
    """Check evenly spaced circles that the baseline solved: each error may grow at most by its tolerance.

    A pose beside the circle's second solution is compared by its rate alone.

    Parameters
    ----------
    run : str
    new, old : pyarrow.Table
        Scores of the same circles, from the same images.
    """
    now_solved, now_right = flags(new, "solved"), beside_truth(new)
    solved = np.flatnonzero(flags(old, "solved") & beside_truth(old))
    rows = solved[np.unique(np.linspace(0, len(solved) - 1, GOLDEN).astype(int))] if len(solved) else solved
    for row in rows.tolist():
        where = f"frame {old['frame_id'][row].as_py()}, marker {old['marker_id'][row].as_py()}"
        if not now_solved[row]:
            return Check(run, "golden frames", "worse", f"{where} is no longer solved")
        for q in QUANTITIES:
            if q.of_pose and not now_right[row]:
                continue
            was, is_now = floats(old, q.column)[row], floats(new, q.column)[row]
            bound = floats(old, q.bound)[row] if q.bound else 1.0
            allowed = was + max(GOLDEN_RELATIVE * was, GOLDEN_BOUNDS * bound if math.isfinite(bound) else 0.0, q.floor)
            # An error that is no longer known has not stayed within its tolerance.
            if math.isfinite(was) and not is_now <= allowed:
                sentence = f"{where}: {q.title} {was:.3g} -> {is_now:.3g} {q.unit}, allowed {allowed:.3g}"
                return Check(run, "golden frames", "worse", sentence)
    return Check(run, "golden frames", "same", f"{len(rows)} golden circles are within their tolerances")
