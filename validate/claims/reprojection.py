"""Claims about reprojection: it grows with distance if calibrated, falls if not, and the two meet."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.claims.claim import Claim, found, problem, trend_conditions, undecided
from roundel.validate.claims.conditions import REPROJECTION, Condition
from roundel.validate.claims.normal import GROWS, POWER, growths, noisy
from roundel.validate.scores.summary import number
from roundel.validate.statistics.trends import Estimate, decide_all, log_slope, mean_of

# "Quite near the error with the right focal length": at most a quarter above it at the farthest distance.
NEAR = 1.25
# "Meets" in the text: the distance from which on the ratio stays below this.
MEETS = 1.1


def reprojection_calibrated(settings: Sequence[Condition]) -> Claim | None:
    """Claim: the calibrated reprojection error grows with the distance."""
    statistic = "log-log slope of the calibrated reprojection error over distance"
    findings = growths(settings, REPROJECTION, statistic, "calibrated error")
    if not findings:
        return None
    return Claim(
        "reprojection-calibrated",
        "With the right focal length the reprojection error grows with the distance.",
        "section V-B, figures of the reprojected points, synthetic and real",
        findings,
        "The number of edge points decides: with as many as the contour has pixels, farther markers give fewer, and "
        "the error grows (slope 0.5 in theory). With a fixed number of points the error is constant.",
        conditional="where farther markers have fewer edge points",
    )


def reprojection_uncalibrated(settings: Sequence[Condition]) -> Claim | None:
    """Claim: the uncalibrated reprojection error falls with the distance."""
    findings, remarks = [], []
    for s in trend_conditions(settings):
        errors = {label: s.of(label, REPROJECTION) for label in s.wrong}
        statistic, region = "log-log slope of the uncalibrated reprojection error over distance", f"below {-GROWS:g}"
        why = problem(s, *errors.values())
        fits = {} if why else {n: log_slope(e, s.distance_D, s.tilts()[1], s.frame) for n, e in errors.items()}
        slopes = {label: slope for label, slope in fits.items() if slope is not None}
        if not slopes:
            findings.append(undecided(s, statistic, region, why or "no slope can be fitted"))
            continue
        decision = decide_all(list(slopes.values()), high=-GROWS)
        label = next(n for n, e in slopes.items() if e is decision.estimate)
        name = IntrinsicsLabel.of(label).short
        words = POWER.format(f"uncalibrated error ({name}, the least certain of {len(slopes)})")
        findings.append(found(s, f"{statistic} ({name})", words, decision, region))
        bias = {IntrinsicsLabel.of(n).short: slope for n in s.wrong if (slope := bias_slope(s, n)) is not None}
        if bias:
            text = ", ".join(
                f"{n} {number(e.value)} [{number(e.interval()[0])}, {number(e.interval()[1])}]" for n, e in bias.items()
            )
            law = f"The bias alone, with noise subtracted, is proportional to the distance to the power {text}."
            remarks.append((s.name, law))
    if not findings:
        return None
    return Claim(
        "reprojection-uncalibrated",
        "With a wrong focal length the reprojection error falls with the distance.",
        "section V-B, figures of the reprojected points, synthetic and real",
        findings,
        "On the optical axis the bias falls with the square of the distance, off the axis with the distance; the "
        "error due to noise does not fall. Points are reprojected with the same wrong focal length.",
        remarks=remarks,
    )


def bias_slope(s: Condition, label: str) -> Estimate | None:
    """Log-log slope over distance of sqrt(mean square of the uncalibrated error - of the calibrated one)."""
    distances, at = s.distances()
    square = s.of(label, REPROJECTION) ** 2 - s.of(s.right, REPROJECTION) ** 2
    means = [mean_of(np.where(at == d, square, np.nan), s.frame) for d in range(len(distances))]
    # If noise hides the bias, its logarithm is meaningless.
    clear = [(math.log(distances[d]), m) for d, m in enumerate(means) if m is not None and m.value > 4 * m.error > 0]
    if len(clear) < 3:
        return None
    x = np.array([c[0] for c in clear])
    logs = [m.log() for _, m in clear]
    weight = np.array([1.0 / e.error**2 for e in logs])
    x = x - np.sum(weight * x) / weight.sum()
    share = 0.5 * weight * x / np.sum(weight * x * x)
    value = float(sum(c * e.value for c, e in zip(share, logs, strict=True)))
    influence = np.sum([c * e.influence for c, e in zip(share, logs, strict=True)], axis=0)
    return Estimate(value, influence, min(e.df for e in logs), sum(e.n for e in logs))


def ratios_over_distance(s: Condition, label: str) -> list[Estimate | None]:
    """Logarithm of uncalibrated over calibrated mean error at each distance, paired by frame."""
    distances, at = s.distances()
    found = []
    for d in range(len(distances)):
        pair = [mean_of(np.where(at == d, s.of(n, REPROJECTION), np.nan), s.frame) for n in (label, s.right)]
        clear = pair[0] is not None and pair[1] is not None and pair[0].value > 0 and pair[1].value > 0
        found.append(pair[0].log() - pair[1].log() if clear and pair[0] and pair[1] else None)
    return found


def _meets_at(distances: Sequence[float], ratios: Sequence[Estimate | None]) -> float | None:
    """The first distance from which on the ratio stays below `MEETS`."""
    first = None
    for distance, ratio in zip(reversed(distances), reversed(ratios), strict=True):
        if ratio is None or ratio.value > math.log(MEETS):
            break
        first = distance
    return first


def reprojection_meets(settings: Sequence[Condition]) -> Claim | None:
    """Claim: far away, a wrong focal length barely increases the reprojection error."""
    findings, remarks = [], []
    for s in trend_conditions(settings):
        if not noisy(s):
            continue
        distances = s.distances()[0].tolist()
        every = {label: ratios_over_distance(s, label) for label in s.wrong}
        why = problem(s, s.of(s.right, REPROJECTION), *(s.of(label, REPROJECTION) for label in s.wrong))
        last = {label: r[-1] for label, r in every.items() if r[-1] is not None}
        region = f"below {NEAR:g}"
        statistic = f"uncalibrated over calibrated reprojection error at {distances[-1]:.3g} D"
        if why or not last:
            findings.append(undecided(s, statistic, region, why or "no ratio can be formed"))
            continue
        decision = decide_all(list(last.values()), high=math.log(NEAR))
        label = next(n for n, e in last.items() if e is decision.estimate)
        name = IntrinsicsLabel.of(label).short
        words = f"at {distances[-1]:.3g} D the error with {name} is {{}} times the calibrated one"
        findings.append(
            found(s, f"{statistic} ({IntrinsicsLabel.of(label).short})", words, decision, region, logarithm=True)
        )
        places = {n: _meets_at(distances, r) for n, r in every.items()}
        text = ", ".join(
            f"{IntrinsicsLabel.of(n).short} " + (f"from {d:.3g} D" if d else "nowhere") for n, d in places.items()
        )
        remarks.append((s.name, f"Within 10 % of the calibrated curve: {text}."))
    if not findings:
        return None
    return Claim(
        "reprojection-meets",
        "Far away, the reprojection error with a wrong focal length is near that with the right one.",
        "section V-B and conclusion, figures of the reprojected points, synthetic and real",
        findings,
        "The curves meet where the noise of the edges hides the bias. With an edge noise of 1 px this is in the "
        "paper's range; with more precise detection, farther away. The extent of the reprojected points matters, too: "
        "bias grows with the square of their distance from the marker, noise linearly.",
        conditional="where the noise of the edges hides the bias",
        remarks=remarks,
    )
