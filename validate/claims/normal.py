"""Claims about the normal: its error grows with distance, is worst at low tilt, ignores the focal length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.claims.claim import (
    MIN_PAIRS,
    NO_NOISE,
    Claim,
    Finding,
    found,
    problem,
    trend_conditions,
    undecided,
)
from roundel.validate.claims.conditions import NORMAL, Condition
from roundel.validate.scores.summary import number
from roundel.validate.statistics.trends import Array, Estimate, decide, decide_all, log_ratio, log_slope, mean_of

# "Grows": doubling the distance increases the error by at least 7 %.
GROWS = 0.1
POWER = "the {} is proportional to the distance to the power {{}}"
# "Does not depend on the focal length": the mean error changes by less than this.
SAME_DEG = 0.1


def noisy(setting: Condition) -> bool:
    """Whether the calibrated case has any error: points without noise have no error and no trend."""
    errors = setting.of(setting.right, NORMAL)
    return bool(np.isfinite(errors).any() and np.nanmean(errors) > NO_NOISE)


def growths(settings: Sequence[Condition], error: str, statistic: str, subject: str) -> list[Finding]:
    """Whether an error of the calibrated case grows with the distance, for each condition."""
    findings, region = [], f"above {GROWS:g}"
    for s in trend_conditions(settings):
        if not noisy(s):
            continue
        errors = s.of(s.right, error)
        why = problem(s, errors)
        slope = None if why else log_slope(errors, s.distance_D, s.tilts()[1], s.frame)
        if slope is None:
            findings.append(undecided(s, statistic, region, why or "no slope can be fitted"))
        else:
            findings.append(found(s, statistic, POWER.format(subject), decide(slope, GROWS), region))
    return findings


def normal_grows(settings: Sequence[Condition]) -> Claim | None:
    """Claim: the normal's error grows with the distance."""
    statistic = "log-log slope of the normal's mean error over distance"
    findings = growths(settings, NORMAL, statistic, "mean error")
    if not findings:
        return None
    return Claim(
        "normal-distance",
        "The error of the normal grows with the distance.",
        "section V-B, figure of the normal's orientation",
        findings,
        "With a fixed number of edge points the error is proportional to the distance (slope 1); with as many points "
        "as the contour has pixels, to its power 1.5 (slope 1.5).",
    )


def normal_lowest_tilt(settings: Sequence[Condition]) -> Claim | None:
    """Claim: the normal is worst at the lowest tilt."""
    findings: list[Finding] = []
    for s in trend_conditions(settings):
        tilts, at_tilt = s.tilts()
        if not noisy(s) or not 2 <= len(tilts) <= 6:
            continue
        errors, lowest = s.of(s.right, NORMAL), f"{tilts[0]:.3g}\N{DEGREE SIGN}"
        others = [f"{t:.3g}\N{DEGREE SIGN}" for t in tilts[1:]]
        statistic = f"error at a tilt of {lowest} over that at the next worst of {' and '.join(others)}, like distances"
        why = problem(s, errors)
        ratios = [] if why else [log_ratio(errors, s.distance_D, at_tilt, s.frame, 0, i) for i in range(1, len(tilts))]
        known = [r for r in ratios if r is not None]
        if why or not known or len(known) < len(ratios):
            findings.append(undecided(s, statistic, "above 1", why or "no ratio can be fitted"))
            continue
        words = f"at a tilt of {lowest} the error is {{}} times the largest mean error at {' and '.join(others)}"
        findings.append(found(s, statistic, words, decide_all(known, 0.0), "above 1", logarithm=True))
        cells = _cells(s)
        if cells:
            worst = sum(_largest_at_lowest(s))
            each = "the smallest such ratio at any single distance"
            words = (
                f"at {worst} of {len(s.distances()[0])} distances the error is largest at {lowest}; the least certain "
                "ratio is {}"
            )
            findings.append(found(s, each, words, decide_all(cells, 0.0), "above 1", logarithm=True, main=False))
    if not findings:
        return None
    return Claim(
        "normal-tilt",
        "The error of the normal is worst at the lowest tilt.",
        "section V-B, figure of the normal's orientation, left graph",
        findings,
        "The paper's angle is interpreted as the tilt between the optical axis and the plane's normal: a nearly "
        "frontal circle looks round whatever the direction of its tilt. With elevation, the claim would be false.",
    )


def _cells(s: Condition) -> list[Estimate]:
    """Logarithms of error ratios, lowest tilt over each other, per distance; empty if a cell has too few frames."""
    (distances, at), (tilts, at_tilt) = s.distances(), s.tilts()
    errors = s.of(s.right, NORMAL)
    ratios = []
    for d in range(len(distances)):
        means = [mean_of(np.where((at == d) & (at_tilt == t), errors, np.nan), s.frame) for t in range(len(tilts))]
        if any(m is None or m.n < MIN_PAIRS or m.value <= 0 for m in means):
            return []
        logs = [m.log() for m in means if m is not None]
        ratios += [logs[0] - other for other in logs[1:]]
    return ratios


def _largest_at_lowest(s: Condition) -> list[bool]:
    (distances, at), (tilts, at_tilt) = s.distances(), s.tilts()
    errors = s.of(s.right, NORMAL)
    found = []
    for d in range(len(distances)):
        means = [float(np.nanmean(errors[(at == d) & (at_tilt == t)])) for t in range(len(tilts))]
        found.append(means[0] == max(means))
    return found


def normal_focal(settings: Sequence[Condition]) -> Claim | None:
    """Claim: the normal does not depend on the focal length. True only on the axis."""
    findings, remarks = [], []
    for s in settings:
        if len(s.frame) < MIN_PAIRS and not (s.on_axis and s.whole_group):
            continue
        pure = [label for label in s.wrong if label in s.pure]
        if pure or s.on_axis:
            findings.append(_change(s, pure, main=True))
        findings.extend(_change(s, [label], main=False) for label in s.wrong if label not in s.pure)
        worst = [float(np.nanmax(c)) for label in pure if np.isfinite(c := added(s, label)).any()]
        if worst and not s.on_axis:
            remarks.append((s.name, f"In the worst frame the error increases by {number(max(worst))} deg."))
    if not any(f.on_axis for f in findings):
        return None
    off = any(not f.on_axis for f in findings)
    condition = (
        "On the optical axis, where the paper's marker is, a wrong focal length changes only the depth. Off axis it "
        "rotates the line of sight and with it the normal, at any distance (by theory 12.6\N{DEGREE SIGN} at "
        "20\N{DEGREE SIGN} off axis with x0.7 at the worst azimuth)"
    )
    condition += "; both are measured here." if off else "; these frames have no marker there, see study wrong_focal."
    return Claim(
        "normal-focal",
        "The error of the normal does not depend on the focal length.",
        "section V-B and abstract; the paper's marker is on the optical axis",
        findings,
        condition,
        conditional="on the optical axis",
        remarks=remarks,
    )


def added(s: Condition, label: str) -> Array:
    """Increase of the normal's error by the intrinsics, in degrees, for each frame."""
    return s.of(label, NORMAL) - s.of(s.exact, NORMAL)


def _change(s: Condition, labels: Sequence[str], *, main: bool) -> Finding:
    """Whether the mean error stays the same with each of these intrinsics."""
    statistic = "largest change of the mean normal error by a wrong focal length, deg"
    region = f"within \N{PLUS-MINUS SIGN}{SAME_DEG:g} deg"
    why = problem(s, s.of(s.exact, NORMAL), *(s.of(label, NORMAL) for label in labels), least=MIN_PAIRS)
    means = {} if why else {label: mean_of(added(s, label), s.frame) for label in labels}
    changes = {label: change for label, change in means.items() if change is not None}
    if not changes:
        return undecided(s, statistic, region, why or "no intrinsics have only the focal length wrong", main=main)
    decision = decide_all(list(changes.values()), -SAME_DEG, SAME_DEG)
    # The largest change is shown; a less certain one may decide.
    label = max(changes, key=lambda name: abs(changes[name].value))
    decision = replace(decision, estimate=changes[label])
    where = "" if s.on_axis else f", at a median of {number(float(np.median(s.off_axis_deg)))} deg off axis"
    also = "" if main else ", whose principal point and distortion are also wrong,"
    words = f"with {IntrinsicsLabel.of(label).short}{also} the mean error of the normal changes by {{}} deg{where}"
    return found(s, f"{statistic} ({IntrinsicsLabel.of(label).short})", words, decision, region, main=main)
