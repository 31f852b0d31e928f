"""What a run states of itself, held against the truth: regions of its poses, and probabilities of two kinds."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from roundel.validate.metrics.rows import Rows, column, in_memory
from roundel.validate.metrics.uncertainty import brier_score, choice_score, percentile_of
from roundel.validate.scores.run_statistics import rate

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

# Regions of a pose that should hold the truth this often.
COVERAGE_LEVELS = (0.5, 0.9, 0.95, 0.99)
_PERCENTILE_BINS = 20
# Of the probability of the likelier candidate; the last bin has those that are certain.
_CHOICE_EDGES = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.01)

_CONFIDENCE_EDGES = (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99, 1.01)

# The region that is judged, and the shares of truths between which it is as large as it says.
JUDGED = 0.95
LEAST, MOST = 0.90, 0.98
ASKED = f"{100 * LEAST:g} to {100 * MOST:g} %"
HOLDS, NARROW, WIDE, OPEN = "holds", "too narrow", "too wide", "cannot be decided from these frames"


def stated_statistics(part: Rows, false: pa.Table) -> dict[str, Any]:
    """Coverage of the stated regions, and reliability of the stated probabilities, of one run.

    Parameters
    ----------
    part : Rows
        Its rows of scores.parquet.
    false : pyarrow.Table
        Its rows of false_positives.parquet; none against another reference than the truth.

    Returns
    -------
    dict
        Plain values.
    """
    return {
        "choice": choice(part),
        "confidence": confidence(part, false),
        "coverage": {"oracle": coverage(part, "oracle_"), "chosen": coverage(part, "")},
    }


def coverage(part: Rows, prefix: str) -> dict[str, Any] | None:
    """How often the truth lies in the regions that a method states; None if it states none.

    Parameters
    ----------
    part : Rows
    prefix : {"oracle_", ""}
        Of the better candidate, or of the chosen one.

    Returns
    -------
    dict or None
        `n` poses with a covariance, the share of truths within the regions of `COVERAGE_LEVELS` with Wilson's interval
        over frames, the `verdict` of `region_verdict`, the counts of the chi-square's percentile in even bins (alike if
        covariances hold), the median chi-square (4.35 then) and the mean logarithmic score.
    """
    chi2 = column(part, f"{prefix}pose_chi2")
    known = np.isfinite(chi2)
    if not known.any():
        return None
    percentile, frame = percentile_of(chi2[known]), part["frame_id"].to_numpy()[known]
    counts, _ = np.histogram(percentile, bins=_PERCENTILE_BINS, range=(0.0, 1.0))
    levels = [{"level": level, **rate(percentile <= level, frame)} for level in COVERAGE_LEVELS]
    return {
        "n": int(known.sum()),
        "levels": levels,
        "verdict": region_verdict(levels[COVERAGE_LEVELS.index(JUDGED)]),
        "percentiles": counts.tolist(),
        "median_chi2": float(np.median(chi2[known])),
        "log_score": float(np.mean(column(part, f"{prefix}pose_log_score")[known])),
    }


def region_verdict(share: dict[str, Any]) -> str:
    """Whether the regions of 95 % hold the truth: by the whole interval of their share of truths.

    Parameters
    ----------
    share : dict
        `rate`, and the ends `low` and `high` of its 95 % interval.

    Returns
    -------
    str
        `HOLDS` if it is within 90 to 98 %, `NARROW` if it is below, `WIDE` if it is above, else `OPEN`.

    Examples
    --------
    >>> region_verdict({"rate": 0.71, "low": 0.65, "high": 0.77})
    'too narrow'
    """
    low, high = share["low"], share["high"]
    if low is None or high is None:
        return OPEN
    if high < LEAST:
        return NARROW
    if low > MOST:
        return WIDE
    return HOLDS if low >= LEAST and high <= MOST else OPEN


def region_text(found: dict[str, Any]) -> str:
    """The share of truths in the judged region of a run's coverage, as a clause."""
    share = next(entry for entry in found["levels"] if entry["level"] == JUDGED)
    of = "1 pose" if found["n"] == 1 else f"{found['n']} poses"
    interval = "" if share["low"] is None else f" [{100 * share['low']:.1f}, {100 * share['high']:.1f}]"
    return f"they hold the truth of {100 * share['rate']:.1f} %{interval} of {of}"


def worst_stated(part: Rows, count: int) -> list[dict[str, Any]]:
    """The circles of a run with the largest chi-square of the better candidate: rows of scores, largest first."""
    order = [("oracle_pose_chi2", "descending"), ("frame_id", "ascending"), ("marker_id", "ascending")]
    known = part.filter(part["oracle_pose_chi2"].is_valid())
    keys = pa.table({name: known[name] for name, _ in order})
    rows: list[dict[str, Any]] = in_memory(known, pc.sort_indices(keys, sort_keys=order)[:count]).to_pylist()
    return rows


def choice(part: Rows) -> dict[str, Any] | None:
    """How often the likelier of two candidates is right, by its stated probability; None if none is likelier.

    Returns
    -------
    dict or None
        Of `reliability`.
    """
    stated = column(part, "likelier_probability")
    known = np.isfinite(stated)
    right = column(part, "likelier_correct")[known] > 0
    return reliability(stated[known], right, part["frame_id"].to_numpy()[known], _CHOICE_EDGES)


def confidence(part: Rows, false: pa.Table) -> dict[str, Any] | None:
    """How often a detection is a marker's, by its stated confidence; None if none is stated.

    Parameters
    ----------
    part, false
        As in `stated_statistics`.

    Returns
    -------
    dict or None
        Of `reliability`.
    """
    tables = (part, false)
    stated = np.concatenate([column(rows, "confidence") for rows in tables])
    frame = np.concatenate([rows["frame_id"].to_numpy() for rows in tables])
    right = np.arange(len(stated)) < part.num_rows
    known = np.isfinite(stated)
    return reliability(stated[known], right[known], frame[known], _CONFIDENCE_EDGES)


def reliability(
    stated: Array, right: NDArray[np.bool_], frame: Labels, edges: Sequence[float]
) -> dict[str, Any] | None:
    """How often statements are right, by the probability that they were given.

    Parameters
    ----------
    stated : (n,) array
        Stated probabilities, 0 to 1.
    right : (n,) array of bool
    frame : (n,) array of int
        Frame of each, for intervals over frames.
    edges : sequence of float
        Of the bins of stated probability, the lower one inside.

    Returns
    -------
    dict or None
        `n`, the mean `stated` probability, the `right` rate with Wilson's interval over frames, the mean `log_score`
        and `brier` score, the Brier score `brier_constant` of a single probability for all, and the `bins` that have
        any: their mean stated probability, and the rate. None without statements.

    Notes
    -----
    A. H. Murphy, A new vector partition of the probability score, J. Appl. Meteorology 12 (1973): a constant that is
    right on average scores the variance of the outcome, and less is resolution.
    """
    if not len(stated):
        return None
    bins = []
    for low, high in pairwise(edges):
        here = (stated >= low) & (stated < high)
        if here.any():
            bins.append({"stated": float(stated[here].mean()), **rate(right[here], frame[here])})
    share = float(right.mean())
    return {
        "n": len(stated),
        "stated": float(stated.mean()),
        "right": rate(right, frame),
        "log_score": float(choice_score(stated, right).mean()),
        "brier": float(brier_score(stated, right).mean()),
        "brier_constant": share * (1 - share),
        "bins": bins,
    }
