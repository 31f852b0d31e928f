"""Paired comparisons of runs on the same circles, and the statistical power of a set of frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy import stats

from roundel.validate.metrics.metric import ELLIPSE_CENTRE, HEADLINE, Metric
from roundel.validate.metrics.rows import Rows, circle_keys, column, shared, those
from roundel.validate.scores.run_statistics import BOUNDED
from roundel.validate.scores.stated_uncertainty import coverage
from roundel.validate.statistics.intervals import (
    LEVEL,
    MIN_SAMPLES,
    frame_numbers,
    holm,
    resampled_sums,
    units_of,
)
from roundel.validate.statistics.paired_tests import detectable_effect
from roundel.validate.statistics.trends import mean_of

Array = NDArray[np.float64]
Labels = NDArray[np.int64]
Key = tuple[str, str, str]

COMPARED = (*HEADLINE, ELLIPSE_CENTRE)
ALPHA = 0.05  # chance of any wrong statement in the whole family of comparisons
POWER_ALPHA = 0.01
POWER = 0.95
POWER_NOTE = (
    "The relative growth of the RMS error that these frames show in 95 of 100 cases at a level of 1 %, one-sided, if "
    "the other side's errors have the same standard deviation and are independent. On the same images errors are "
    "correlated, and a paired test detects smaller changes."
)


def comparisons(tables: Mapping[Key, Rows], main: Key) -> list[dict[str, Any]]:
    """Compare the main run with every other run that has the same reference.

    Parameters
    ----------
    tables : dict
        Rows of scores.parquet by (method, intrinsics, reference).
    main : (method, intrinsics, reference)

    Returns
    -------
    list of dict
        For each other run and error: `ratio` of its RMS to the main run's over the circles that both solved, with its
        interval `low`, `high` (bootstrap over frames, of the ratio's logarithm), the two-sided `p_value`, `p_holm`
        adjusted for the whole list, and `verdict`: `larger`, `smaller` (significant), `same` (identical) or
        `undecided`.
    """
    out = []
    for key, table in tables.items():
        if key == main or key[2] != main[2]:
            continue
        ours, theirs = shared_rows(tables[main], table)
        for metric in COMPARED:
            found = _compared(ours, theirs, metric)
            if found is not None:
                label = dict(zip(("method", "intrinsics", "reference"), key, strict=True))
                out.append({**label, "metric": metric.oracle, **found})
    adjusted = holm([entry["p_value"] for entry in out]) if out else np.zeros(0)
    for entry, p in zip(out, adjusted.tolist(), strict=True):
        entry["p_holm"] = p
        sure = p < ALPHA and entry["low"] is not None
        entry["verdict"] = (
            ("larger" if entry["ratio"] > 1 else "smaller") if sure else "same" if entry["same"] else "undecided"
        )
    return out


def shared_rows(a: Rows, b: Rows) -> tuple[Rows, Rows]:
    """The rows of the shared circles, in the order of frames and markers."""
    i, j = shared(circle_keys(a), circle_keys(b))
    return a.take(pa.array(i)), b.take(pa.array(j))


def _compared(ours: Rows, theirs: Rows, metric: Metric) -> dict[str, Any] | None:
    a, b = metric.values(ours), metric.values(theirs)
    both = np.isfinite(a) & np.isfinite(b)
    if not both.any():
        return None
    frame = frame_numbers(ours["frame_id"].to_numpy()[both])
    powers = np.stack([np.bincount(units_of(frame), v[both] ** 2) for v in (a, b)], axis=1).astype(np.float64)
    rms = np.sqrt(powers.sum(axis=0) / int(both.sum()))
    facts: dict[str, Any] = {
        "n": int(both.sum()),
        "frames": int(frame.max()) + 1,
        "main_rms": float(rms[0]),
        "other_rms": float(rms[1]),
        "same": bool(np.array_equal(a[both], b[both])),
    }
    if rms.min() == 0 or facts["same"]:
        equal = float(rms[0] == rms[1])
        return {**facts, "ratio": 1.0 if equal else None, "low": None, "high": None, "p_value": 1.0}
    effect = math.log(rms[1] / rms[0])
    facts["ratio"] = math.exp(effect)
    if len(powers) < MIN_SAMPLES["rms"]:
        return {**facts, "low": None, "high": None, "p_value": 1.0}
    draws = resampled_sums(powers)
    # The logarithm of the ratio is close to normal, so only its standard deviation is bootstrapped.
    error = float(np.std(0.5 * np.log(draws[:, 1] / draws[:, 0]), ddof=1))
    margin = float(stats.norm.ppf((1 + LEVEL) / 2)) * error
    low, high = (float(f"{math.exp(effect + s * margin):.9g}") for s in (-1, 1))
    p = 2 * float(stats.norm.sf(abs(effect) / error)) if error > 0 else 0.0
    return {**facts, "low": low, "high": high, "p_value": float(f"{p:.6g}")}


def stated_difference(a: Rows, b: Rows) -> dict[str, Any] | None:
    """Compare the stated covariances of two runs on the circles for which both state one.

    Parameters
    ----------
    a, b : Rows
        Rows of scores of the same circles, in the same order.

    Returns
    -------
    dict or None
        `n` circles; `a` and `b`, the coverage of each (see `coverage`); `difference` of the mean logarithmic scores, b
        minus a, in nats, with its 95 % interval `low`, `high` over frames (Student's t), the two-sided `p_value`, and
        whether all scores are the `same`. None with fewer than two such frames.
    """
    name = "oracle_pose_log_score"
    if not all(name in rows.column_names for rows in (a, b)):
        return None
    scores = [column(rows, name) for rows in (a, b)]
    both = np.isfinite(scores[0]) & np.isfinite(scores[1])
    frame = frame_numbers(a["frame_id"].to_numpy()[both]) if both.any() else np.zeros(0, dtype=np.int64)
    mean = mean_of((scores[1] - scores[0])[both], frame)
    if mean is None:
        return None
    found = {key: coverage(those(rows, both), "oracle_") for key, rows in (("a", a), ("b", b))}
    low, high = mean.interval()
    p = 2 * float(stats.t.sf(abs(mean.value) / mean.error, mean.df)) if mean.error > 0 else float(mean.value == 0)
    same = bool(np.array_equal(scores[0][both], scores[1][both]))
    return {"n": mean.n, **found, "difference": mean.value, "low": low, "high": high, "p_value": p, "same": same}


def power_of(tables: Mapping[Key, Rows]) -> list[dict[str, Any]]:
    """The change of each run's main errors that these frames can detect (see `POWER_NOTE` for the assumptions).

    Returns
    -------
    list of dict
        `change` is a fraction of the RMS, None if there are too few frames; `over_bound` tells whether errors were
        divided by their frame's own bound, as in the gate.
    """
    out = []
    for key, table in tables.items():
        label = dict(zip(("method", "intrinsics", "reference"), key, strict=True))
        frame = table["frame_id"].to_numpy()
        for metric in BOUNDED:
            value, limit = metric.values(table), metric.bounds(table)
            known = np.isfinite(value)
            if not known.any():
                continue
            bounded = bool((np.isfinite(limit) & (limit > 0))[known].all())
            ratio = value[known] / limit[known] if bounded else value[known]
            out.append(
                {
                    **label,
                    "error": metric.name,
                    "metric": metric.oracle,
                    "over_bound": bounded,
                    "alpha": POWER_ALPHA,
                    "power": POWER,
                    **_detectable(ratio, frame[known]),
                }
            )
    return out


def _detectable(values: Array, frame: Labels) -> dict[str, Any]:
    number = frame_numbers(frame)
    power, count = np.bincount(number, values**2), np.bincount(number)
    frames, total = len(power), float(power.sum())
    if frames < MIN_SAMPLES["rms"] or total == 0:
        return {"frames": frames, "change": None}
    # The linearised standard deviation of log RMS between frames, times sqrt 2 for the other side.
    residual = power - total / count.sum() * count
    error = 0.5 * math.sqrt(frames / (frames - 1) * float(np.sum(residual**2))) / total
    change = math.expm1(detectable_effect(math.sqrt(2) * error, POWER_ALPHA))
    return {"frames": frames, "change": float(f"{change:.9g}")}
