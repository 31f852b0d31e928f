"""Checks of one run against its baseline, paired circle by circle.

There are four kinds of test: growth of an error (RMS of errors over their bounds), shift of an error (mean of a signed
error), loss of circles (a rate), and growth of a score (the logarithmic score of the stated covariances). On the same
images, golden frames show changes that noise would hide from a test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.validate.metrics import metric
from roundel.validate.metrics.metric import Metric
from roundel.validate.metrics.uncertainty import choice_score
from roundel.validate.statistics.paired_tests import (
    PairedTest,
    mcnemar_test,
    mean_growth_test,
    rms_ratio_test,
    shift_test,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ALPHA = 0.005  # chance of any false alarm in the whole family
MIN_CIRCLES = 30  # with fewer there is no verdict
RELATIVE_FLOOR = 0.02
RATE_FLOOR = 0.002
# An error above this multiple of the baseline's median is gross. Gross errors are counted, and clipped to this limit in
# an RMS; otherwise a few of them would mask changes of all the others.
GROSS = 8.0
# Golden frames: an error may grow by half, or by this many bounds, whichever is larger. New noise on the same scene
# stays below that; a bug does not.
GOLDEN = 16
GOLDEN_RELATIVE = 0.5
GOLDEN_BOUNDS = 8.0


@dataclass(frozen=True)
class Quantity:
    """An error that the gate checks, and the smallest loss, in its unit, that counts."""

    metric: Metric
    floor: float

    @property
    def column(self) -> str:
        """Column of scores.parquet."""
        return self.metric.oracle

    @property
    def bound(self) -> str | None:
        """Column of the error's bound; None if the error is in units of its bound, or has no bound."""
        return self.metric.bound or None

    @property
    def title(self) -> str:
        """Name within a sentence."""
        return self.metric.words

    @property
    def unit(self) -> str:
        """Unit of the error."""
        return self.metric.unit


POSE = Quantity(metric.POSE, 0.001)
QUANTITIES = (POSE, Quantity(metric.NORMAL, 0.001), Quantity(metric.POSITION_M, 1e-6), Quantity(metric.CONTOUR, 0.0005))
# The logarithmic score of the stated covariance: a factor of 0.8 or 1.25 on all covariances costs 0.06.
SCORE, CHI2 = "oracle_pose_log_score", "oracle_pose_chi2"
CHOICE = ("likelier_probability", "likelier_correct")
SCORE_FLOOR = 0.02
_MEDIAN_CHI2 = 4.35
# A change of a pose's score beyond this counts as this much, so that a few poses do not outweigh the others.
SCORE_LIMIT = 10.0
SHIFTS = (Quantity(metric.SHIFT_X, 0.002), Quantity(metric.SHIFT_Y, 0.002))


@dataclass(frozen=True)
class Check:
    """One check and its verdict.

    Attributes
    ----------
    run, name : str
    verdict : str
        `same`, `worse`, `better`, or `identical`.
    sentence : str
    p_value : float
        Adjusted for the family; NaN if nothing was tested.
    """

    run: str
    name: str
    verdict: str
    sentence: str
    p_value: float = math.nan


@dataclass(frozen=True)
class Tested:
    """A test of the data: its kind (`growth`, `shift`, `rate`, `score`), its result, and the values for the sentence.

    `was` and `is_now` are an RMS, a mean or a rate; `note` ends the sentence.
    """

    run: str
    kind: str
    title: str
    unit: str
    floor: float
    test: PairedTest
    was: float
    is_now: float
    note: str = ""

    @property
    def could_differ(self) -> bool:
        """Whether the two sides differ at all; if not, the test is not part of the family."""
        return self.test.effect != 0.0 or self.test.standard_error > 0.0


def flags(rows: pa.Table, name: str) -> Flags:
    """A column of booleans; it has no nulls."""
    return np.asarray(rows[name].to_numpy(zero_copy_only=False), dtype=bool)


def floats(rows: pa.Table, name: str) -> Array:
    """A column of numbers; nulls are NaN."""
    return np.asarray(rows[name].to_numpy(zero_copy_only=False), dtype=np.float64)


def golden(run: str, new: pa.Table, old: pa.Table) -> Check:
    """Check evenly spaced circles that the baseline solved: each error may grow at most by its tolerance.

    Parameters
    ----------
    run : str
    new, old : pyarrow.Table
        Scores of the same circles, from the same images.
    """
    solved = np.flatnonzero(flags(old, "solved"))
    rows = solved[np.unique(np.linspace(0, len(solved) - 1, GOLDEN).astype(int))]
    for row in rows.tolist():
        where = f"frame {old['frame_id'][row].as_py()}, marker {old['marker_id'][row].as_py()}"
        if not flags(new, "solved")[row]:
            return Check(run, "golden frames", "worse", f"{where} is no longer solved")
        for q in QUANTITIES:
            was, is_now = floats(old, q.column)[row], floats(new, q.column)[row]
            bound = floats(old, q.bound)[row] if q.bound else 1.0
            allowed = was + max(GOLDEN_RELATIVE * was, GOLDEN_BOUNDS * bound if math.isfinite(bound) else 0.0, q.floor)
            # An error that is no longer known has not stayed within its tolerance.
            if math.isfinite(was) and not is_now <= allowed:
                sentence = f"{where}: {q.title} {was:.3g} -> {is_now:.3g} {q.unit}, allowed {allowed:.3g}"
                return Check(run, "golden frames", "worse", sentence)
    return Check(run, "golden frames", "same", f"{len(rows)} golden circles are within their tolerances")


def questions(run: str, new: pa.Table, old: pa.Table) -> list[Tested]:
    """All tests that the scores of one run allow.

    Parameters
    ----------
    run : str
    new, old : pyarrow.Table
        Scores of the same circles, row by row.
    """
    both = flags(new, "solved") & flags(old, "solved")
    out: list[Tested] = []
    for q in QUANTITIES:
        a, b, bound = floats(new, q.column), floats(old, q.column), _bound(old, q, both)
        known = both & np.isfinite(b) & np.isfinite(bound)
        keep = known & np.isfinite(a)
        if np.any(known & ~keep):
            out.append(_rate(run, f"{q.title} given", keep[known], np.ones(int(known.sum()))))
        if np.count_nonzero(keep) < MIN_CIRCLES:
            continue
        scale = bound[keep] * _spread(b[keep] / bound[keep], old["group"].filter(pa.array(keep)).to_pylist())
        x, y = a[keep] / scale, b[keep] / scale
        limit = GROSS * float(np.median(y))
        if limit > 0:
            if q is POSE:
                out.append(_rate(run, "pose without gross error", x <= limit, y <= limit))
            x, y = np.minimum(x, limit), np.minimum(y, limit)
        test = rms_ratio_test(x, y, alpha=ALPHA)
        out.append(Tested(run, "growth", q.title, q.unit, q.floor, test, _rms(b[keep]), _rms(a[keep])))
    for q in SHIFTS:
        a, b = floats(new, q.column), floats(old, q.column)
        keep = both & np.isfinite(a) & np.isfinite(b)
        if np.count_nonzero(keep) >= MIN_CIRCLES:
            test = shift_test(a[keep], b[keep], alpha=ALPHA)
            floor = max(q.floor, RELATIVE_FLOOR * _rms(b[keep]))
            out.append(Tested(run, "shift", q.title, q.unit, floor, test, float(b[keep].mean()), float(a[keep].mean())))
    out += [*_uncertainty(run, new, old, both), *_choice(run, new, old, both)]
    out.append(_rate(run, "solved", flags(new, "solved"), flags(old, "solved")))
    right = [np.array([np.nan if v is None else float(v) for v in t["branch_correct"].to_pylist()]) for t in (new, old)]
    known = np.isfinite(right[0]) & np.isfinite(right[1])
    if np.count_nonzero(known) >= MIN_CIRCLES:
        out.append(_rate(run, "right candidate", right[0][known], right[1][known]))
    return out


def _uncertainty(run: str, new: pa.Table, old: pa.Table, both: Flags) -> list[Tested]:
    """Whether poses still have covariances, and whether these hold as well as before."""
    if not all(name in t.column_names for t in (new, old) for name in (SCORE, CHI2)):
        return []  # a baseline of an older version
    chi2 = [floats(t, CHI2) for t in (new, old)]
    known = both & np.isfinite(chi2[1])
    keep = known & np.isfinite(chi2[0])
    if np.count_nonzero(known) < MIN_CIRCLES:
        return []
    out = [_rate(run, "covariance given", keep[known], np.ones(int(known.sum())))] if np.any(known & ~keep) else []
    if np.count_nonzero(keep) < MIN_CIRCLES:
        return out
    was, is_now = floats(old, SCORE)[keep], floats(new, SCORE)[keep]
    change = np.clip(is_now - was, -SCORE_LIMIT, SCORE_LIMIT)
    middles = [float(np.median(x[keep])) for x in chi2]
    way = "larger" if middles[0] > max(middles[1], _MEDIAN_CHI2) else "smaller"
    note = f"; median chi-square {middles[1]:.3g} -> {middles[0]:.3g}, {_MEDIAN_CHI2} if it holds"
    note += f": errors are {way} than stated" if middles[0] != middles[1] else ""
    test = mean_growth_test(change, np.zeros(len(change)), alpha=ALPHA)
    mean = float(was.mean())
    return [
        *out, Tested(run, "score", "stated uncertainty", "", SCORE_FLOOR, test, mean, mean + test.effect, note)
    ]  # fmt: skip


def _choice(run: str, new: pa.Table, old: pa.Table, both: Flags) -> list[Tested]:
    """Whether the stated probabilities of the two candidates hold as before."""
    if not all(name in t.column_names for t in (new, old) for name in CHOICE):
        return []
    stated, right = ([floats(t, name) for t in (new, old)] for name in CHOICE)
    known = both & np.isfinite(stated[0]) & np.isfinite(stated[1])
    if np.count_nonzero(known) < MIN_CIRCLES:
        return []
    is_now, was = (choice_score(p[known], r[known] > 0) for p, r in zip(stated, right, strict=True))
    test = mean_growth_test(is_now, was, alpha=ALPHA)
    means = [f"{100 * p[known].mean():.1f} % stated, {100 * np.mean(r[known]):.1f} % right"
             for p, r in zip(stated, right, strict=True)]  # fmt: skip
    note = f"; {means[1]} -> {means[0]}"
    title = "probability of the likelier candidate"
    return [Tested(run, "score", title, "", SCORE_FLOOR, test, float(was.mean()), float(is_now.mean()), note)]


def _bound(old: pa.Table, q: Quantity, both: Flags) -> Array:
    """Divisor of each error: its bound, or 1 for all if most circles have no bound (images without noise)."""
    one = np.ones(old.num_rows)
    if q.bound is None:
        return one
    bound = floats(old, q.bound)
    bound = np.where(bound > 0, bound, np.nan)
    return bound if np.count_nonzero(both & np.isfinite(bound)) * 2 > np.count_nonzero(both) else one


def _spread(errors: Array, groups: list[str]) -> Array:
    """RMS of the group of each error, so that a group far from its bounds does not outweigh the others."""
    names, index = np.unique(np.array(groups), return_inverse=True)
    count = np.bincount(index, minlength=len(names))
    power = np.bincount(index, errors**2, minlength=len(names)) / count
    # A group with few circles or without error gives no useful scale.
    power = np.where((count >= MIN_CIRCLES) & (power > 0), power, np.mean(errors**2))
    return np.sqrt(np.where(power > 0, power, 1.0))[index]


def _rate(run: str, title: str, new: Flags | Array, old: Flags | Array) -> Tested:
    test = mcnemar_test(new, old, alpha=ALPHA)
    return Tested(run, "rate", title, "", RATE_FLOOR, test, float(np.mean(old)), float(np.mean(new)))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def answer(tested: Tested, p: float) -> Check:
    """The verdict of one test; `p` is adjusted for the family."""
    t, test = tested, tested.test
    if t.kind == "rate":
        sure = p < ALPHA and test.effect > t.floor
        better = not sure and test.effect < -t.floor and test.effect < -3.0 * test.standard_error
        sentence = f"{t.title}: {100 * t.was:.2f} % -> {100 * t.is_now:.2f} % of {test.n}, p = {p:.2g}"
        return Check(t.run, t.title, "worse" if sure else "better" if better else "same", sentence, p)
    if t.kind == "shift":
        sure = p < ALPHA and test.effect > t.floor
        away = abs(t.is_now) >= abs(t.was)
        sentence = f"{t.title}: mean {t.was:+.4f} -> {t.is_now:+.4f} {t.unit}, p = {p:.2g}"
        return Check(t.run, t.title, ("worse" if away else "better") if sure else "same", sentence, p)
    if t.kind == "score":
        sure = p < ALPHA and test.effect > t.floor
        better = test.effect < -t.floor and test.effect < -3.0 * test.standard_error
        sentence = f"{t.title}: log score {t.was:.3f} -> {t.is_now:.3f}{t.note}, p = {p:.2g}"
        return Check(t.run, t.title, "worse" if sure else "better" if better else "same", sentence, p)
    change, margin = math.expm1(test.effect), 1.96 * test.standard_error
    low, high = math.expm1(test.effect - margin), math.expm1(test.effect + margin)
    sentence = (
        f"{t.title}: RMS {t.was:.4g} -> {t.is_now:.4g} {t.unit}; over bound and group {100 * change:+.1f} % "
        f"({100 * low:+.1f} to {100 * high:+.1f}), p = {p:.2g}"
    )
    matters = change > RELATIVE_FLOOR and change * t.was > t.floor
    verdict = "worse" if p < ALPHA and matters else "better" if high < 0 and -change > RELATIVE_FLOOR else "same"
    return Check(t.run, t.title, verdict, sentence, p)
