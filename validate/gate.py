"""The gate: has a solver become worse on the same frames? Red only for a loss that is certain and that matters.

- What is unlike is not compared: another dataset, metric version or settings, other runs, too few circles.
- The same images and the same scores: identical, and nothing more to ask.
- Golden frames, where the images are the same: no error may grow beyond an absolute and a relative tolerance.
- Statistics over all frames, each error divided by its frame's own bound: the ratio of RMS errors, the mean signed
  error of the ellipse's centre (half a pixel of it is lost in no average), and the rates of solving and choosing.
  Holm's correction holds the family's false alarms below 1 %, and a loss counts only beyond a relative *and* an
  absolute floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.scenes.errors import NotComparableError
from roundel.validate.baseline import KEY, Baseline
from roundel.validate.intervals import holm
from roundel.validate.paired import PairedTest, mcnemar_test, rms_ratio_test, shift_test

Array = NDArray[np.float64]

ALPHA = 0.01  # of one false alarm in the whole family
MIN_CIRCLES = 30  # below them a statistic says nothing worth a verdict
RELATIVE_FLOOR = 0.02
GOLDEN = 16  # circles of each run
GOLDEN_TOLERANCE = 1.0  # an error may grow by this fraction of itself, or by so many bounds: whichever is more


@dataclass(frozen=True)
class Quantity:
    """An error that the gate watches: column, bound it is divided by, words, unit, and the floor of a loss."""

    column: str
    bound: str
    title: str
    unit: str
    floor: float


QUANTITIES = (
    Quantity("oracle_normal_error_deg", "normal_bound_deg", "normal", "deg", 0.001),
    Quantity("oracle_position_error_m", "position_bound_m", "position", "m", 1e-6),
    Quantity("ellipse_centre_error_px", "ellipse_centre_bound_px", "ellipse centre", "px", 0.0005),
    Quantity("contour_error_px", "ellipse_centre_bound_px", "contour", "px", 0.0005),
)
SHIFTS = (
    Quantity("ellipse_centre_x_error_px", "", "shift of the ellipse centre in x", "px", 0.002),
    Quantity("ellipse_centre_y_error_px", "", "shift of the ellipse centre in y", "px", 0.002),
)
RATE_FLOOR = 0.002


@dataclass(frozen=True)
class Check:
    """One question and its answer.

    Attributes
    ----------
    run, name : str
    verdict : str
        `same`, `worse`, `better`, or `identical`.
    sentence : str
    p_value : float
        Adjusted for the family; NaN where nothing was tested.
    """

    run: str
    name: str
    verdict: str
    sentence: str
    p_value: float = math.nan


@dataclass(frozen=True)
class Frame:
    """A circle whose error grew most: by how many bounds, and from what to what."""

    run: str
    frame_id: int
    marker_id: int
    growth: float
    sentence: str


@dataclass(frozen=True)
class GateResult:
    """All checks, and the circles that lost most."""

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
        If they are unlike, or there are too few circles.
    """
    _check_alike(new, old)
    same_images = new.images == old.images
    checks: list[Check] = []
    tested: list[tuple[str, Quantity | str, PairedTest, Array, Array]] = []
    worst: list[Frame] = []
    for run in _runs(old.rows):
        label = f"{run[0]}, {run[1]}"
        a, b = _rows_of(new.rows, run), _rows_of(old.rows, run)
        if same_images and a.equals(b):
            checks.append(
                Check(label, "identity", "identical", "the same images gave the same scores, to the last digit")
            )
            continue
        both = _solved(a) & _solved(b)
        if int(both.sum()) < MIN_CIRCLES:
            raise NotComparableError(
                f"{label}: {int(both.sum())} circles were solved by both; a verdict needs {MIN_CIRCLES}"
            )
        if same_images:
            checks.append(_golden(label, a, b, both))
        tested += _tests(label, a, b, both)
        worst += _worst(label, a, b)
    adjusted = holm([test.p_value for _, _, test, _, _ in tested]) if tested else np.zeros(0)
    checks += [_verdict(*entry, p=float(p)) for entry, p in zip(tested, adjusted, strict=True)]
    worst.sort(key=lambda frame: -frame.growth)
    return GateResult(checks, worst[:10], _notes(tested))


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
        raise NotComparableError(f"the report has no run '{missing[0]}', which the baseline has; solve with it too")
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


def _solved(rows: pa.Table) -> NDArray[np.bool_]:
    return np.asarray(rows["solved"].to_numpy(zero_copy_only=False), dtype=bool)


def _floats(rows: pa.Table, name: str) -> Array:
    return np.asarray(rows[name].to_numpy(zero_copy_only=False), dtype=np.float64)


def _golden(label: str, a: pa.Table, b: pa.Table, both: NDArray[np.bool_]) -> Check:
    """The first solved circles: each error may grow by its own size or by one bound, whichever is more."""
    rows = np.flatnonzero(_solved(b))[:GOLDEN]
    for row in rows.tolist():
        where = f"frame {b['frame_id'][row].as_py()}, marker {b['marker_id'][row].as_py()}"
        if not both[row]:
            return Check(label, "golden frames", "worse", f"{where} is no longer solved")
        for q in QUANTITIES:
            was, is_now, bound = _floats(b, q.column)[row], _floats(a, q.column)[row], _floats(b, q.bound)[row]
            allowed = was + GOLDEN_TOLERANCE * max(was, bound if math.isfinite(bound) else 0.0) + q.floor
            if is_now > allowed:
                sentence = f"{where}: {q.title} {was:.3g} -> {is_now:.3g} {q.unit}, allowed {allowed:.3g}"
                return Check(label, "golden frames", "worse", sentence)
    return Check(label, "golden frames", "same", f"{len(rows)} golden circles stay within their tolerances")


def _tests(
    label: str, a: pa.Table, b: pa.Table, both: NDArray[np.bool_]
) -> list[tuple[str, Quantity | str, PairedTest, Array, Array]]:
    out: list[tuple[str, Quantity | str, PairedTest, Array, Array]] = []
    for q in (*QUANTITIES, *SHIFTS):
        new, old = _floats(a, q.column), _floats(b, q.column)
        keep = both & np.isfinite(new) & np.isfinite(old)
        if q.bound:
            bound = _floats(b, q.bound)
            keep &= np.isfinite(bound) & (bound > 0)
        if np.count_nonzero(keep) < MIN_CIRCLES:
            continue
        x, y = new[keep], old[keep]
        if q.bound:
            test = rms_ratio_test(x / bound[keep], y / bound[keep], alpha=ALPHA)
        else:
            test = shift_test(x, y, alpha=ALPHA)
        out.append((label, q, test, x, y))
    new_rate, old_rate = _solved(a), _solved(b)
    rate = mcnemar_test(new_rate, old_rate, alpha=ALPHA)
    out.append((label, "solved", rate, new_rate.astype(float), old_rate.astype(float)))
    branch = [np.array([np.nan if v is None else float(v) for v in t["branch_correct"].to_pylist()]) for t in (a, b)]
    known = np.isfinite(branch[0]) & np.isfinite(branch[1])
    if np.count_nonzero(known) >= MIN_CIRCLES:
        new_branch, old_branch = branch[0][known], branch[1][known]
        out.append(
            (label, "right candidate", mcnemar_test(new_branch, old_branch, alpha=ALPHA), new_branch, old_branch)
        )
    return out


def _verdict(label: str, q: Quantity | str, test: PairedTest, new: Array, old: Array, p: float) -> Check:
    if isinstance(q, str):
        sure = p < ALPHA and test.effect > RATE_FLOOR
        sentence = f"{q}: {100 * old.mean():.2f} % -> {100 * new.mean():.2f} % of {test.n}, p = {p:.2g}"
        better = not sure and test.effect < -RATE_FLOOR and test.effect < -3.0 * test.standard_error
        return Check(label, q, "worse" if sure else "better" if better else "same", sentence, p)
    if not q.bound:
        floor = max(q.floor, RELATIVE_FLOOR * float(np.sqrt(np.mean(old**2))))
        toward = abs(new.mean()) - abs(old.mean())
        sure = p < ALPHA and test.effect > floor
        sentence = f"{q.title}: mean {old.mean():+.4f} -> {new.mean():+.4f} {q.unit}, p = {p:.2g}"
        return Check(label, q.title, ("worse" if toward > 0 else "better") if sure else "same", sentence, p)
    was, is_now = (float(np.sqrt(np.mean(v**2))) for v in (old, new))
    change, margin = math.expm1(test.effect), 1.96 * test.standard_error
    low, high = math.expm1(test.effect - margin), math.expm1(test.effect + margin)
    sentence = (
        f"{q.title}: RMS {was:.4g} -> {is_now:.4g} {q.unit}; over the bounds {100 * change:+.1f} % "
        f"({100 * low:+.1f} to {100 * high:+.1f}), p = {p:.2g}"
    )
    matters = change > RELATIVE_FLOOR and change * was > q.floor
    verdict = "worse" if p < ALPHA and matters else "better" if high < 0 and -change > RELATIVE_FLOOR else "same"
    return Check(label, q.title, verdict, sentence, p)


def _worst(label: str, a: pa.Table, b: pa.Table) -> list[Frame]:
    """Circles that were lost, then those whose normal's error grew most, in bounds."""
    was, is_now, bound = (
        _floats(t, n)
        for t, n in ((b, "oracle_normal_error_deg"), (a, "oracle_normal_error_deg"), (b, "normal_bound_deg"))
    )
    lost = _solved(b) & ~_solved(a)
    with np.errstate(invalid="ignore"):
        growth = np.where(lost, np.inf, (is_now - was) / bound)
    growth = np.where(np.isnan(growth), -np.inf, growth)
    out = []
    for row in np.argsort(-growth, kind="stable")[:10].tolist():
        if not growth[row] > 0:
            break
        what = "no longer solved" if lost[row] else f"normal {was[row]:.3g} -> {is_now[row]:.3g} deg"
        frame_id, marker_id = int(b["frame_id"][row].as_py()), int(b["marker_id"][row].as_py())
        out.append(Frame(label, frame_id, marker_id, float(growth[row]), what))
    return out


def _notes(tested: list[tuple[str, Quantity | str, PairedTest, Array, Array]]) -> list[str]:
    """What these frames could have shown."""
    power = [
        f"{label}: a loss of {100 * math.expm1(test.detectable):.1f} % in {q.title} would be seen in 95 of 100 cases"
        for label, q, test, _, _ in tested
        if isinstance(q, Quantity) and q.bound and test.detectable > 0
    ]
    return power
