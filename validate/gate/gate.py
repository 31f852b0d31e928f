"""The gate: fails when a solver is worse on the same frames by a loss that is certain and that matters.

- Different datasets, metric versions, settings or runs, and too few circles, are not compared.
- The same images with the same scores are identical; no test is needed.
- Golden frames, if the images are the same: no error may grow beyond an absolute and a relative tolerance.
- Statistics over all frames (`checks`): errors over their frame's own bound, shifts (a mean shows a bias of half a
  pixel), rates. Holm's correction keeps the family's false alarms below 0.5 %, and a loss counts only beyond a relative
  *and* an absolute floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pyarrow as pa

from roundel.scenes.errors import NotComparableError
from roundel.validate.gate.baseline import KEY, Baseline
from roundel.validate.gate.checks import (
    ALPHA,
    MIN_CIRCLES,
    POSE,
    Check,
    Tested,
    answer,
    flags,
    floats,
    golden,
    questions,
)
from roundel.validate.statistics.intervals import holm
from roundel.validate.statistics.paired_tests import detectable_effect


@dataclass(frozen=True)
class Frame:
    """A circle whose error grew most: the growth in bounds, and the values before and after."""

    run: str
    frame_id: int
    marker_id: int
    growth: float
    sentence: str


@dataclass(frozen=True)
class GateResult:
    """All checks, and the circles with the largest losses."""

    checks: list[Check]
    worst: list[Frame]
    notes: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether nothing is worse."""
        return all(check.verdict != "worse" for check in self.checks)


def gate(new: Baseline, old: Baseline) -> GateResult:
    """Compare new scores with a baseline.

    Parameters
    ----------
    new, old : Baseline
        From `baseline_of_report` and `read_baseline`.

    Raises
    ------
    NotComparableError
        If they differ in dataset, settings or runs, or there are too few circles.
    """
    _check_alike(new, old)
    shared = [name for name in old.rows.column_names if name in new.rows.column_names]
    new, old = (replace(side, rows=side.rows.select(shared)) for side in (new, old))
    same_images = new.images == old.images
    checks: list[Check] = []
    tested: list[Tested] = []
    worst: list[Frame] = []
    for run in _runs(old.rows):
        label = f"{run[0]}, {run[1]}"
        a, b = _rows_of(new.rows, run), _rows_of(old.rows, run)
        if same_images and a.equals(b):
            checks.append(
                Check(label, "identity", "identical", "the same images gave the same scores, to the last digit")
            )
            continue
        both = int(np.sum(flags(a, "solved") & flags(b, "solved")))
        if both < MIN_CIRCLES:
            raise NotComparableError(f"{label}: {both} circles were solved by both; a verdict needs {MIN_CIRCLES}")
        if same_images:
            checks.append(golden(label, a, b))
        tested += questions(label, a, b)
        worst += _worst(label, a, b)
    # A test whose sides do not differ cannot be a false alarm, so it is not part of the family.
    family = [t for t in tested if t.could_differ]
    adjusted = dict(zip(map(id, family), holm([t.test.p_value for t in family]).tolist(), strict=True))
    checks += [answer(t, adjusted.get(id(t), 1.0)) for t in tested]
    worst.sort(key=lambda frame: -frame.growth)
    more = [
        f"{m}, {i}: not in the baseline, so not compared" for m, i in _runs(new.rows) if (m, i) not in _runs(old.rows)
    ]
    return GateResult(checks, worst[:10], [*_power(family), *more])


def _check_alike(new: Baseline, old: Baseline) -> None:
    if new.metric_version != old.metric_version:
        raise NotComparableError(
            f"the report has metric version {new.metric_version}, the baseline {old.metric_version}: "
            "a metric's definition changed; accept a new baseline"
        )
    if new.dataset_id != old.dataset_id:
        raise NotComparableError(
            f"the report is of dataset {new.dataset_id[:12]}, the baseline of {old.dataset_id[:12]}; "
            "render the study that the baseline was made from"
        )
    if new.settings != old.settings:
        raise NotComparableError("the report was made with other settings than the baseline; validate with the same")
    missing = [f"{m}, {i}" for m, i in _runs(old.rows) if (m, i) not in _runs(new.rows)]
    if missing:
        raise NotComparableError(f"the report lacks the run '{missing[0]}' of the baseline; solve with it, too")
    for run in _runs(old.rows):
        keys = [_rows_of(side.rows, run).select(list(KEY)) for side in (new, old)]
        if not keys[0].equals(keys[1]):
            raise NotComparableError(
                f"{run[0]}, {run[1]}: the report scores {keys[0].num_rows} circles, the baseline {keys[1].num_rows} "
                "or others; validate the whole dataset"
            )


def _runs(rows: pa.Table) -> list[tuple[str, str]]:
    return sorted(set(zip(rows["method"].to_pylist(), rows["intrinsics"].to_pylist(), strict=True)))


def _rows_of(rows: pa.Table, run: tuple[str, str]) -> pa.Table:
    method, intrinsics = (np.array(rows[n].to_pylist(), dtype=object) for n in ("method", "intrinsics"))
    return rows.filter(pa.array((method == run[0]) & (intrinsics == run[1]))).combine_chunks()


def _worst(run: str, new: pa.Table, old: pa.Table) -> list[Frame]:
    """Lost circles, then those whose error grew most: that of the pose in bounds, else of the normal."""
    was, is_now, unit = floats(old, POSE.column), floats(new, POSE.column), "bounds"
    what = "pose"
    if not np.isfinite(was).any():
        was, is_now, what, unit = *(floats(t, "oracle_normal_error_deg") for t in (old, new)), "normal", "deg"
    lost = flags(old, "solved") & ~flags(new, "solved")
    growth = np.where(lost, np.inf, is_now - was)
    growth = np.where(np.isnan(growth), -np.inf, growth)
    out = []
    for row in np.argsort(-growth, kind="stable")[:10].tolist():
        if not growth[row] > 0:
            break
        sentence = "no longer solved" if lost[row] else f"{what} {was[row]:.3g} -> {is_now[row]:.3g} {unit}"
        frame_id, marker_id = int(old["frame_id"][row].as_py()), int(old["marker_id"][row].as_py())
        out.append(Frame(run, frame_id, marker_id, float(growth[row]), sentence))
    return out


def _power(family: list[Tested]) -> list[str]:
    """Detectable losses with these frames, at Holm's first and strictest step."""
    seen = [(t, detectable_effect(t.test.standard_error, ALPHA / len(family))) for t in family if t.kind == "growth"]
    return [
        f"{t.run}: a loss of {100 * math.expm1(effect):.1f} % in {t.title} would be detected in 95 of 100 cases"
        for t, effect in seen
        if 0 < effect < math.inf
    ]
