"""The gate: fails when a solver is worse on the same frames by a loss that is certain and that matters.

- Different datasets, metric versions, settings or runs, and too few circles, are not compared.
- The same images with the same scores are identical; no test is needed.
- Golden frames, if the images are the same: no error may grow beyond an absolute and a relative tolerance.
- Statistics over all frames and over each group (`questions`): errors over their frame's own bound, shifts (a mean
  shows a bias of half a pixel), rates, stated uncertainty, detections. Holm's correction keeps the false alarms of all
  questions together below 0.5 %, and a loss counts only beyond a relative *and* an absolute floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pyarrow as pa

from roundel.scenes.errors import NotComparableError
from roundel.validate.gate.baseline import KEY, Baseline
from roundel.validate.gate.checks import Check, Tested, answers, strictest
from roundel.validate.gate.golden import golden
from roundel.validate.gate.quantities import MIN_CIRCLES, POSE, beside_truth, flags, floats
from roundel.validate.gate.questions import RIGHT_CANDIDATE, questions
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
    """All checks, and the circles with the largest losses.

    `solvable` are the methods that `roundel solve` knows, for the commands that replay a circle; None: all.
    """

    checks: list[Check]
    worst: list[Frame]
    notes: list[str] = field(default_factory=list)
    solvable: frozenset[str] | None = None

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
    notes: list[str] = []
    pairs: list[tuple[str, pa.Table, pa.Table]] = []
    for run in _runs(old.rows):
        label = f"{run[0]}, {run[1]}"
        a, b = _rows_of(new.rows, run), _rows_of(old.rows, run)
        false = [_false_of(side, run) for side in (new, old)]
        if any(table is None for table in false):
            false = [None, None]  # not asked of an older version
        if same_images and a.equals(b) and false[0] == false[1]:
            checks.append(
                Check(label, "identity", "identical", "the same images gave the same scores, to the last digit")
            )
            continue
        both = int(np.sum(flags(a, "solved") & flags(b, "solved")))
        if both < MIN_CIRCLES:
            raise NotComparableError(f"{label}: {both} circles were solved by both; a verdict needs {MIN_CIRCLES}")
        if same_images:
            checks.append(golden(label, a, b))
        asked, found, remarks = questions(label, a, b, *false)
        tested, checks, notes = [*tested, *asked], [*checks, *found], [*notes, *remarks]
        pairs.append((label, a, b))
    checks += answers(tested)
    flipped = {check.run for check in checks if check.verdict == "worse" and check.name == RIGHT_CANDIDATE}
    worst = [frame for label, a, b in pairs for frame in _worst(label, a, b, label in flipped)]
    worst.sort(key=lambda frame: -frame.growth)
    more = [
        f"{m}, {i}: not in the baseline, so not compared" for m, i in _runs(new.rows) if (m, i) not in _runs(old.rows)
    ]
    return GateResult(checks, worst[:10], [*_power(tested), *notes, *more])


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


def _false_of(side: Baseline, run: tuple[str, str]) -> pa.Table | None:
    return None if side.false_positives is None else _rows_of(side.false_positives, run)


def _worst(run: str, new: pa.Table, old: pa.Table, flipped: bool) -> list[Frame]:
    """Lost circles, then those whose error grew most: that of the pose in bounds, else of the normal.

    Poses that are beside the second solution now are among them only if that is what is worse (`flipped`).
    """
    was, is_now, unit = floats(old, POSE.column), floats(new, POSE.column), "bounds"
    what = "pose"
    if not np.isfinite(was).any():
        was, is_now, what, unit = *(floats(t, "oracle_normal_error_deg") for t in (old, new)), "normal", "deg"
    lost = flags(old, "solved") & ~flags(new, "solved")
    growth = np.where(lost, np.inf, is_now - was)
    growth = np.where(np.isnan(growth), -np.inf, growth)
    away = beside_truth(old) & ~beside_truth(new)
    growth = np.where(away & ~lost & (not flipped), -np.inf, growth)
    out = []
    for row in np.argsort(-growth, kind="stable")[:10].tolist():
        if not growth[row] > 0:
            break
        sentence = "no longer solved" if lost[row] else f"{what} {was[row]:.3g} -> {is_now[row]:.3g} {unit}"
        sentence += ", beside the second solution" if away[row] and not lost[row] else ""
        frame_id, marker_id = int(old["frame_id"][row].as_py()), int(old["marker_id"][row].as_py())
        out.append(Frame(run, frame_id, marker_id, float(growth[row]), sentence))
    return out


def _power(tested: list[Tested]) -> list[str]:
    """Detectable losses with these frames, at Holm's first and strictest step; of groups the largest.

    No loss below what counts is detectable, however sure.
    """
    seen: dict[tuple[str, str, bool], tuple[float, str]] = {}
    for t in tested:
        if t.least is not None and t.could_differ and math.isfinite(t.test.standard_error):
            sure = detectable_effect(t.test.standard_error, strictest(tested, bool(t.group)))
            key, loss = (t.run, t.title, bool(t.group)), max(math.expm1(sure), t.least)
            seen[key] = max(seen.get(key, (0.0, "")), (loss, t.name))
    out = []
    for (run, _, grouped), (loss, name) in seen.items():
        where = f"{name} alone" if grouped else name
        out.append(f"{run}: a loss of {100 * loss:.1f} % in {where} would be detected in 95 of 100 cases")
    return out
