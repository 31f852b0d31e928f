"""Statistics of a run: errors with intervals over frames, rates, recall, errors over their bounds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow.compute as pc
from numpy.typing import NDArray

from roundel.validate.metrics.metric import (
    ELLIPSE_CENTRE,
    ELLIPSE_METRICS,
    IMAGE_METRICS,
    MSPD,
    MSSD,
    NORMAL,
    POSE_METRICS,
    POSITION,
    POSITION_M,
    Metric,
)
from roundel.validate.metrics.rows import Rows, column, flag_column
from roundel.validate.statistics.intervals import (
    LEVEL,
    MIN_SAMPLES,
    Interval,
    bootstrap_intervals,
    frame_numbers,
    rate_interval,
    resampled_sums,
    units_of,
)

Array = NDArray[np.float64]
Labels = NDArray[np.int64]
Statistics = dict[str, Any]

# Errors over their bounds, by the metric's name.
BOUNDED = (NORMAL, POSITION_M, ELLIPSE_CENTRE)


@dataclass(frozen=True)
class Recall:
    """A family of thresholds: the share of circles whose error is below each.

    BOP's ten thresholds of MSSD are fractions of the object's diameter, its ten of MSPD are pixels of an image 640 px
    wide, so these two have their own unit.
    """

    metric: Metric
    thresholds: tuple[float, ...]
    unit_of_thresholds: str = ""

    @property
    def unit(self) -> str:
        """Unit of the thresholds."""
        return self.unit_of_thresholds or self.metric.unit


RECALLS = (
    Recall(NORMAL, (0.1, 0.5, 1.0, 2.0, 5.0)),
    Recall(POSITION, (0.1, 0.5, 1.0, 2.0, 5.0)),
    Recall(MSSD, tuple(round(0.05 * i, 2) for i in range(1, 11)), "diameters"),
    Recall(MSPD, tuple(5.0 * i for i in range(1, 11)), "px of an image 640 px wide"),
)


def statistics(values: Array, frame: Labels | None = None) -> Statistics:
    """Count, mean, median, 95th percentile and RMS of the finite values; the percentile is of magnitudes.

    Parameters
    ----------
    values : (n,) array
    frame : (n,) int array, optional
        Frame of each value, for intervals over frames: `median_low`, `median_high` and so on, None if there are too few
        frames, and their method in `interval`.

    Examples
    --------
    >>> statistics(np.array([1.0, float("nan"), 3.0]))["mean"]
    2.0
    """
    return statistics_of([("", values)], frame)[""]


def statistics_of(columns: Iterable[tuple[str, Array]], frame: Labels | None = None) -> dict[str, Statistics]:
    """`statistics` of several columns of the same rows, by name; they are used one after another and not kept."""
    out: dict[str, Statistics] = {}

    def described() -> Iterator[Array]:
        for name, values in columns:
            out[name] = _described(values)
            yield values

    if frame is None:
        for _ in described():
            pass
        return out
    for name, intervals in zip(out, bootstrap_intervals(described(), clusters=frame), strict=True):
        out[name]["interval"] = {"level": LEVEL, "frames": intervals["median"].n}
        for statistic in MIN_SAMPLES:
            low, high = _ends(intervals[statistic])
            out[name] |= {f"{statistic}_low": low, f"{statistic}_high": high}
            out[name]["interval"][statistic] = intervals[statistic].method
    return out


def _described(values: Array) -> Statistics:
    known = values[np.isfinite(values)]
    some = len(known) > 0
    return {
        "n": len(known),
        "mean": float(known.mean()) if some else None,
        "median": float(np.median(known)) if some else None,
        "p95": float(np.percentile(np.abs(known), 95)) if some else None,
        "rms": float(np.sqrt((known**2).mean())) if some else None,
    }


def _ends(interval: Interval) -> tuple[float | None, float | None]:
    """Rounded ends of an interval: the tenth digit of a resampled number depends on the number of threads."""
    low, high = (None if v is None else float(f"{v:.9g}") for v in (interval.low, interval.high))
    return low, high


def rate(success: NDArray[np.bool_], frame: Labels) -> dict[str, Any]:
    """A rate with Wilson's interval over frames."""
    found = rate_interval(success, frame)
    low, high = _ends(found)
    return {"rate": found.value, "low": low, "high": high, "n": len(success), "frames": found.n}


def run_statistics(part: Rows, width_px: Array) -> dict[str, Any]:
    """All numbers of one run.

    Parameters
    ----------
    part : Rows
        Its rows of scores.parquet.
    width_px : (n,) array
        Width of each row's image, for BOP's thresholds.

    Returns
    -------
    dict
        Plain values.
    """
    frame = part["frame_id"].to_numpy()
    solved = flag_column(part, "solved")
    correct = column(part, "branch_correct")
    decided = np.isfinite(correct)
    kinds: dict[str, dict[str, Statistics]] = {"oracle": {}, "chosen": {}, "ellipse": {}, "image": {}, "efficiency": {}}
    for name, found in statistics_of(_errors(part), frame).items():
        kind, _, metric = name.partition(" ")
        kinds[kind][metric] = found
    return {
        "n": part.num_rows,
        "detected": int(np.sum(flag_column(part, "detected"))),
        "solved": int(solved.sum()),
        "solved_rate": float(solved.mean()) if len(solved) else None,
        "solved_interval": rate(solved, frame),
        "branch_chosen": int(decided.sum()),
        "branch_correct": int(np.nansum(correct)),
        "branch_interval": rate(correct[decided] > 0, frame[decided]),
        **kinds,
        "identities_read": int(pc.count(part["identity_correct"]).as_py()),
        "identities_correct": int(pc.sum(part["identity_correct"]).as_py() or 0),
        "recall": recalls(part, width_px),
    }


def _errors(part: Rows) -> Iterator[tuple[str, Array]]:
    """Every column of errors, with the kind of its statistics before its name."""
    for name in POSE_METRICS:
        yield f"oracle {name}", column(part, f"oracle_{name}")
    for kind, names in {"chosen": POSE_METRICS, "ellipse": ELLIPSE_METRICS, "image": IMAGE_METRICS}.items():
        for name in names:
            yield f"{kind} {name}", column(part, name)
    for metric in BOUNDED:
        yield f"efficiency {metric.name}", metric.over_bound(part)


def recalls(part: Rows, width_px: Array) -> dict[str, Any]:
    """Recall at thresholds, by the better candidate and by the chosen one.

    A circle that was not found, or without a chosen candidate, is a miss. Only circles that were found but have no
    reference are left out. `chosen` is None if a run never chooses.
    """
    judged = ~flag_column(part, "solved")
    judged |= np.isfinite(NORMAL.values(part))
    chooses = bool(np.isfinite(NORMAL.values(part, "chosen")).any())
    frame = part["frame_id"].to_numpy()[judged]
    diameter = column(part, "distance_m") / column(part, "distance_D")
    scale = {"mssd": 1 / diameter, "mspd": 640.0 / width_px}
    out: dict[str, Any] = {}
    for kind in ("oracle", "chosen"):
        if kind == "chosen" and not chooses:
            out[kind] = None
            continue
        families, means = {}, {}
        for family in RECALLS:
            name = family.metric.name
            error = (family.metric.values(part, kind) * scale.get(name, 1.0))[judged]
            # NaN is never below a threshold.
            means[name] = sum((error < t for t in family.thresholds), np.zeros(len(error))) / len(family.thresholds)
            families[name] = {
                "title": family.metric.title,
                "unit": family.unit,
                "levels": [{"threshold": t, **rate(error < t, frame)} for t in family.thresholds],
                "average": _average(means[name], frame),
            }
        # BOP averages three errors; the first, VSD, needs depth images.
        out[kind] = {**families, "average_recall": _average((means["mssd"] + means["mspd"]) / 2, frame)}
    return out


def _average(share: Array, frame: Labels) -> dict[str, Any]:
    """Mean of a share over circles, with the bootstrap's percentiles over frames."""
    if not len(share):
        return {"value": None, "low": None, "high": None, "n": 0}
    unit = units_of(frame_numbers(frame))
    value, count = float(share.mean()), np.bincount(unit)
    if len(count) < MIN_SAMPLES["rms"]:
        return {"value": value, "low": None, "high": None, "n": len(share)}
    sums = resampled_sums(np.stack([np.bincount(unit, share), count], axis=1))
    low, high = np.quantile(sums[:, 0] / sums[:, 1], [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return {"value": value, "low": float(f"{low:.9g}"), "high": float(f"{high:.9g}"), "n": len(share)}
