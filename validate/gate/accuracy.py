"""Questions of accuracy: growth and shift of errors, over all circles of a run and in each of its groups.

A pose beside the circle's second solution has no error of this kind: which solution a method returns is a rate of its
own. Gross errors are another: they are counted, and left out of the RMS, which they would fill with themselves.
"""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.validate.gate.checks import Tested, rate
from roundel.validate.gate.quantities import (
    ALPHA,
    MIN_CIRCLES,
    QUANTITIES,
    RELATIVE_FLOOR,
    SHIFTS,
    Array,
    Flags,
    Quantity,
    beside_truth,
    flags,
    floats,
    groups_of,
)
from roundel.validate.statistics.paired_tests import rms_ratio_test, shift_test

# An error above this multiple of the lower quartile of its group in the baseline is gross. Three quarters of a group
# would have to be gross to move the limit. Of normal errors it is 5 (one component) to 12 (five) times their RMS.
GROSS = 16.0


def accuracy_questions(run: str, new: pa.Table, old: pa.Table) -> tuple[list[Tested], list[str]]:
    """Tests of the errors of circles that both sides solved, and notes on what could not be compared.

    Parameters
    ----------
    run : str
    new, old : pyarrow.Table
        Scores of the same circles, row by row.
    """
    both = flags(new, "solved") & flags(old, "solved")
    right = both & beside_truth(new) & beside_truth(old)
    out: list[Tested] = []
    notes: list[str] = []
    by_group: Quantity | None = None  # the pose's error; its normal's where there are no bounds
    for q in QUANTITIES:
        wanted = right if q.of_pose else both
        a, b, bound = floats(new, q.column), floats(old, q.column), _bound(old, q, wanted)
        known = wanted & np.isfinite(b) & np.isfinite(bound)
        keep = known & np.isfinite(a)
        if np.any(known & ~keep):
            out.append(rate(run, f"{q.title} given", keep[known], np.ones(int(known.sum()))))
        x, y, group = a[keep] / bound[keep], b[keep] / bound[keep], groups_of(old)[keep]
        if len(x):
            # An error below what counts is not gross, however small the others are.
            limit = np.maximum(_limits(y, group), q.floor / bound[keep])
            wild = rate(run, f"{q.title} without gross error", x <= limit, y <= limit)
            out += [wild] if wild.could_differ else []
            tame = (x <= limit) & (y <= limit)
            keep[np.flatnonzero(keep)[~tame]] = False
            x, y, group = x[tame], y[tame], group[tame]
        if len(x) < MIN_CIRCLES:
            if known.any() or (q.of_pose and np.count_nonzero(both) > np.count_nonzero(right)):
                notes.append(f"{run}: {q.title} not compared: {len(x)} circles are right on both sides")
            continue
        frame = old["frame_id"].to_numpy()[keep]
        shown = a[keep], b[keep]
        scale = _spread(y, group)
        out.append(_growth(run, q, x / scale, y / scale, shown, frame))
        by_group = by_group or q
        names = np.unique(group)
        for name in names.tolist() if q is by_group and len(names) > 1 else []:
            mine = group == name
            if np.count_nonzero(mine) >= MIN_CIRCLES:
                own = shown[0][mine], shown[1][mine]
                out.append(_growth(run, q, x[mine], y[mine], own, frame[mine], name))
    return [*out, *_shifts(run, new, old, both)], notes


def _growth(
    run: str,
    q: Quantity,
    x: Array,
    y: Array,
    shown: tuple[Array, Array],
    frame: NDArray[np.int64],
    group: str = "",
) -> Tested:
    test = rms_ratio_test(x, y, alpha=ALPHA, clusters=frame)
    is_now, was = (_rms(v) for v in shown)
    change, margin = math.expm1(test.effect), 1.96 * test.standard_error
    low, high = math.expm1(test.effect - margin), math.expm1(test.effect + margin)
    sentence = (
        f"RMS {was:.4g} -> {is_now:.4g} {q.unit} of {test.n}; over {'bound' if group else 'bound and group'} "
        f"{100 * change:+.1f} % ({100 * low:+.1f} to {100 * high:+.1f})"
    )
    matters = change > RELATIVE_FLOOR and change * was > q.floor
    better = high < 0 and -change > RELATIVE_FLOOR
    least = max(RELATIVE_FLOOR, q.floor / was if was > 0 else math.inf)
    otherwise = "better" if better else "same"
    return Tested(run, q.title, test, sentence, "worse" if matters else otherwise, otherwise, group, least)


def _shifts(run: str, new: pa.Table, old: pa.Table, both: Flags) -> list[Tested]:
    out = []
    for q in SHIFTS:
        a, b = floats(new, q.column), floats(old, q.column)
        keep = both & np.isfinite(a) & np.isfinite(b)
        if np.count_nonzero(keep) < MIN_CIRCLES:
            continue
        test = shift_test(a[keep], b[keep], alpha=ALPHA)
        floor = max(q.floor, RELATIVE_FLOOR * _rms(b[keep]))
        was, is_now = float(b[keep].mean()), float(a[keep].mean())
        moved = "worse" if abs(is_now) >= abs(was) else "better"
        sentence = f"mean {was:+.4f} -> {is_now:+.4f} {q.unit}"
        out.append(Tested(run, q.title, test, sentence, moved if test.effect > floor else "same"))
    return out


def _bound(old: pa.Table, q: Quantity, wanted: Flags) -> Array:
    """Divisor of each error: its bound, or 1 for all if most circles have no bound (images without noise)."""
    one = np.ones(old.num_rows)
    if q.bound is None:
        return one
    bound = floats(old, q.bound)
    bound = np.where(bound > 0, bound, np.nan)
    return bound if np.count_nonzero(wanted & np.isfinite(bound)) * 2 > np.count_nonzero(wanted) else one


def _limits(errors: Array, group: NDArray[np.str_]) -> Array:
    """The error beyond which that of each circle is gross, from the baseline's errors of its group."""
    out = np.full(len(errors), _limit(errors))
    for name in np.unique(group):
        mine = group == name
        if np.count_nonzero(mine) >= MIN_CIRCLES:
            out[mine] = _limit(errors[mine])
    return out


def _limit(errors: Array) -> float:
    quartile = float(np.quantile(errors, 0.25))
    return GROSS * quartile if quartile > 0 else math.inf


def _spread(errors: Array, group: NDArray[np.str_]) -> Array:
    """RMS of the group of each error, so that a group far from its bounds does not outweigh the others."""
    _, index = np.unique(group, return_inverse=True)
    count = np.bincount(index)
    power = np.bincount(index, errors**2) / count
    # A group with few circles or without error gives no useful scale.
    power = np.where((count >= MIN_CIRCLES) & (power > 0), power, np.mean(errors**2))
    return np.asarray(np.sqrt(np.where(power > 0, power, 1.0))[index])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
