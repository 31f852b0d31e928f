"""A claim of the paper with its findings, before the decision."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roundel.validate.claims.conditions import Condition
from roundel.validate.scores.summary import number
from roundel.validate.statistics.trends import Array, Decision

# Fewer circles show no reliable trend. If less than this share is solved, the rest may be only the easy circles.
MIN_CIRCLES = 30
MIN_PAIRS = 10
MIN_SOLVED = 0.9
# Degrees: smaller errors are rounding errors of frames without noise.
NO_NOISE = 1e-6


@dataclass(frozen=True)
class Finding:
    """One statistic of one condition.

    Attributes
    ----------
    where : str
        Name of the condition.
    on_axis : bool
        Whether the marker is on the optical axis, as in the paper.
    statistic : str
        The statistic's name, with its unit.
    value, low, high : float or None
        The statistic and its 95 % interval.
    n : int
        Number of circles.
    region : str
        The range in which the claim is true.
    p : float or None
        Two-sided, before the correction for the family; None if the statistic cannot be tested.
    inside : bool
        Whether the point estimate is in the region.
    reason : str
        Why the frames cannot decide.
    main : bool
        Whether the statistic is the claim itself, or an additional one.
    words : str
        The statistic as a clause, with `{}` for the number and its interval.
    p_adjusted : float or None
        `p` after Holm's correction over all statistics of a report; None before it.
    holds : bool or None
        The decision; None if it is not significant, or before the correction.
    """

    where: str
    on_axis: bool
    statistic: str
    value: float | None
    low: float | None
    high: float | None
    n: int
    region: str
    p: float | None
    inside: bool
    reason: str = ""
    main: bool = True
    words: str = "{}"
    p_adjusted: float | None = None
    holds: bool | None = None

    def text(self) -> str:
        """The statistic as a clause."""
        if self.value is None or self.low is None or self.high is None:
            return f"{self.statistic}: {self.reason}"
        return self.words.format(f"{number(self.value)} [{number(self.low)}, {number(self.high)}]")


@dataclass(frozen=True)
class Claim:
    """A claim of the paper and the findings on it.

    Attributes
    ----------
    key : str
        Lower-case letters and hyphens; its picture is `verdict-KEY`.
    claim : str
        The claim, paraphrased.
    source : str
        Place in the paper.
    findings : sequence of Finding
        The paper's own condition first.
    condition : str
        What decides whether the claim is true.
    conditional : str
        The condition under which alone the claim is known to be true, as a clause: "on the optical axis". Empty if it
        needs none.
    weaker : str
        A weaker claim, as a clause, which the findings on the optical axis that are not `main` decide; empty if there
        is none.
    remarks : sequence of (str, str)
        Name of a condition, and an additional observation that is not tested.
    """

    key: str
    claim: str
    source: str
    findings: Sequence[Finding]
    condition: str
    conditional: str = ""
    weaker: str = ""
    remarks: Sequence[tuple[str, str]] = ()


def found(
    setting: Condition,
    statistic: str,
    words: str,
    decision: Decision,
    region: str,
    *,
    logarithm: bool = False,
    main: bool = True,
) -> Finding:
    """A finding from a decision; `logarithm` if the statistic is the logarithm of the displayed number."""
    low, high = decision.estimate.interval()
    value, low, high = (math.exp(v) if logarithm else v for v in (decision.estimate.value, low, high))
    return Finding(
        setting.name,
        setting.on_axis,
        statistic,
        value,
        low,
        high,
        decision.estimate.n,
        region,
        decision.p,
        decision.inside,
        main=main,
        words=words,
    )


def undecided(setting: Condition, statistic: str, region: str, reason: str, *, main: bool = True) -> Finding:
    """A finding without a decision."""
    n = len(setting.frame)
    return Finding(setting.name, setting.on_axis, statistic, None, None, None, n, region, None, False, reason, main)


def trend_conditions(settings: Sequence[Condition]) -> list[Condition]:
    """Conditions that allow a trend over distance; empty without one on the axis, as in the paper."""
    size = {(s.group, s.on_axis): len(s.frame) for s in settings}
    spread = [s for s in settings if s.spans()]
    on = [s for s in spread if s.on_axis and size[s.group, True] >= size.get((s.group, False), 0)]
    off = [s for s in spread if not s.on_axis and len(s.frame) >= MIN_CIRCLES]
    return [*on, *off] if on else []


def problem(setting: Condition, *errors: Array, least: int = MIN_CIRCLES) -> str:
    """Why the errors of a condition cannot decide; empty if they can."""
    together = np.all([np.isfinite(e) for e in errors], axis=0)
    n, solved = len(together), int(together.sum())
    if solved < MIN_SOLVED * n:
        return f"only {solved} of {n} circles are solved, perhaps only the easy ones"
    if solved < least:
        return f"{solved} circles are too few; {least} are needed"
    return ""
