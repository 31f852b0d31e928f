"""Claims about the position: independent of distance if calibrated, linear in it if not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.claims.claim import Claim, found, problem, trend_conditions, undecided
from roundel.validate.claims.conditions import POSITION, RELATIVE, Condition
from roundel.validate.claims.normal import POWER, noisy
from roundel.validate.scores.summary import number
from roundel.validate.statistics.trends import Array, Estimate, decide, decide_all, log_slope, mean_of

# "Does not depend": doubling the distance changes the error by less than 7 %.
FLAT = 0.1
# On the scale of the uncalibrated curves, the calibrated curve rises by less than this share of their height.
OF_HEIGHT = 0.1
# "Linear": a slope within this of 1; "is |k - 1| r": a ratio within this of 1.
NEAR_ONE = 0.05


def predicted_D(s: Condition, label: str) -> Array:
    """Position error in D without noise: the factor k of the focal length scales the depth, |k - 1| r on the axis."""
    return abs(s.factor[label] - 1.0) * s.distance_D * np.cos(np.radians(s.off_axis_deg))


def position_calibrated(settings: Sequence[Condition]) -> Claim | None:
    """Claim: the calibrated position error does not depend on the distance."""
    findings, remarks = [], []
    for s in trend_conditions(settings):
        if not noisy(s):
            continue
        errors = s.of(s.right, POSITION)
        why, region = problem(s, errors), f"within \N{PLUS-MINUS SIGN}{FLAT:g}"
        statistic = "log-log slope of the calibrated position error in D over distance"
        slope = None if why else log_slope(errors, s.distance_D, s.tilts()[1], s.frame)
        if slope is None:
            findings.append(undecided(s, statistic, region, why or "no slope can be fitted"))
            continue
        findings.append(found(s, statistic, POWER.format("calibrated error in D"), decide(slope, -FLAT, FLAT), region))
        rise = _rise_of_height(s)
        if rise is not None:
            words = "on the scale of the paper's figure it rises by {} of the height of the uncalibrated curves"
            scale = "rise of the calibrated curve over the height of the uncalibrated ones"
            findings.append(
                found(s, scale, words, decide(rise, -OF_HEIGHT, OF_HEIGHT), f"below {OF_HEIGHT:g}", main=False)
            )
        relative = log_slope(s.of(s.right, RELATIVE), s.distance_D, s.tilts()[1], s.frame)
        if relative is not None:
            low, high = relative.interval()
            remarks.append(
                (
                    s.name,
                    f"In percent of the distance the slope is {number(relative.value)} "
                    f"[{number(low)}, {number(high)}].",
                )
            )
    if not findings:
        return None
    return Claim(
        "position-calibrated",
        "With the right focal length the position's error does not depend on the distance.",
        "section V-B, figure of the marker's position",
        findings,
        "In theory the error in D grows with a power of the distance: 2.5 with as many edge points as the contour has "
        "pixels, 2 with a fixed number.",
        weaker="on an axis that extends to the uncalibrated curves, the calibrated curve looks constant: it rises by "
        f"less than {100 * OF_HEIGHT:g} % of their height",
        remarks=remarks,
    )


def _rise_of_height(s: Condition) -> Estimate | None:
    """(calibrated error at the farthest distance - at the nearest) / the largest uncalibrated error at the farthest."""
    distances, at = s.distances()
    last = len(distances) - 1

    def mean(label: str, level: int) -> Estimate | None:
        return mean_of(np.where(at == level, s.of(label, POSITION), np.nan), s.frame)

    near, far = mean(s.right, 0), mean(s.right, last)
    heights = [h for h in (mean(label, last) for label in s.wrong) if h is not None and h.value > 0]
    if near is None or far is None or not heights:
        return None
    return (far - near).over(max(heights, key=lambda h: h.value))


def position_uncalibrated(settings: Sequence[Condition]) -> Claim | None:
    """Claim: the uncalibrated position error grows linearly with the distance."""
    findings, remarks = [], []
    for s in trend_conditions(settings):
        errors = {label: s.of(label, POSITION) for label in s.wrong}
        why = problem(s, *errors.values())
        statistic = "log-log slope of the uncalibrated position error in D over distance"
        region = f"1 \N{PLUS-MINUS SIGN} {NEAR_ONE:g}"
        fits = {} if why else {n: log_slope(e, s.distance_D, s.tilts()[1], s.frame) for n, e in errors.items()}
        slopes = {label: slope for label, slope in fits.items() if slope is not None}
        if not slopes:
            findings.append(undecided(s, statistic, region, why or "no slope can be fitted"))
            continue
        low, high = 1 - NEAR_ONE, 1 + NEAR_ONE
        decision = decide_all(list(slopes.values()), low, high)
        label = next(n for n, e in slopes.items() if e is decision.estimate)
        name = IntrinsicsLabel.of(label).short
        words = POWER.format(f"uncalibrated error ({name}, the least certain of {len(slopes)})")
        findings.append(found(s, f"{statistic} ({name})", words, decision, region))
        told = [label for label in s.wrong if label in s.pure]
        means = {label: mean_of(errors[label] / predicted_D(s, label), s.frame) for label in told}
        ratios = [r for r in means.values() if r is not None]
        if ratios:
            law = "error over the noise-free |k - 1| r" + ("" if s.on_axis else " cos(angle off axis)")
            findings.append(
                found(
                    s,
                    law,
                    f"the error is {{}} times {law.partition('noise-free ')[2]}",
                    decide_all(ratios, low, high),
                    region,
                    main=False,
                )
            )
        medians = ", ".join(
            f"{IntrinsicsLabel.of(n).short} {number(float(np.nanmedian(s.of(n, RELATIVE))))} %" for n in s.wrong
        )
        remarks.append((s.name, f"Medians in percent of the distance: {medians}."))
    if not findings:
        return None
    return Claim(
        "position-uncalibrated",
        "With a wrong focal length the position's error grows linearly with the distance.",
        "section V-B, figure of the marker's position",
        findings,
        "Contrary to the paper, the cause is not less accurate detection: a focal length that is wrong by a factor k "
        "moves the marker along the ray by |k - 1| r, without any noise and with the same ellipse as if calibrated.",
        remarks=remarks,
    )
