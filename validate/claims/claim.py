"""A claim of the paper with its findings, before the decision."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roundel.validate.claims.conditions import Condition
from roundel.validate.scores.summary import number
from roundel.validate.statistics.trends import Array, Decision

# Fewer circles show no trend worth a verdict; where more than this share is lost, what is left may be the easy ones.
MIN_CIRCLES = 30
MIN_PAIRS = 10
MIN_SOLVED = 0.9
# Degrees: smaller errors are rounding, of frames without noise.
NO_NOISE = 1e-6


@dataclass(frozen=True)
class Finding:
    """One statistic of one setting.

    Attributes
    ----------
    where : str
        Condition.
    on_axis : bool
        As in the paper.
    statistic : str
        What the number is, with its unit.
    value, low, high : float or None
        The number and its 95 % interval.
    n : int
        Circles.
    region : str
        Where the number must lie for the claim to hold.
    p : float or None
        Two-sided, before the correction for the family; None where the frames cannot say.
    inside : bool
        Whether the number itself lies in the region.
    reason : str
        Why the frames cannot say.
    main : bool
        Whether it is the claim itself, or stands beside it.
    words : str
        The statistic as a clause, with `{}` for the number and its interval.
    p_adjusted : float or None
        `p` after Holm's correction over all statistics of a report; None before it.
    holds : bool or None
        What the number decides; None where it is not sure, or before the correction.
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
    """A claim of the paper and what the frames say of it.

    Attributes
    ----------
    key : str
        Of lower-case letters and hyphens; its picture is `verdict-KEY`.
    claim : str
        In our words.
    source : str
        Where the paper makes it.
    findings : sequence of Finding
        The paper's own setting first.
    condition : str
        Under which it is true, with both sides.
    conditional : bool
        It is known to be true under that condition only, even if these frames show one side.
    remarks : sequence of (str, str)
        A setting's name, and what else its frames show: not tested.
    """

    key: str
    claim: str
    source: str
    findings: Sequence[Finding]
    condition: str
    conditional: bool = False
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
    """A finding from a decision; `logarithm` if the statistic is the logarithm of what is shown."""
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
    """A finding that the frames do not yield."""
    n = len(setting.frame)
    return Finding(setting.name, setting.on_axis, statistic, None, None, None, n, region, None, False, reason, main)


def trend_conditions(settings: Sequence[Condition]) -> list[Condition]:
    """Settings in which a trend over distance can be asked for; empty without one on the axis, as the paper's is."""
    size = {(s.group, s.on_axis): len(s.frame) for s in settings}
    spread = [s for s in settings if s.spans()]
    on = [s for s in spread if s.on_axis and size[s.group, True] >= size.get((s.group, False), 0)]
    off = [s for s in spread if not s.on_axis and len(s.frame) >= MIN_CIRCLES]
    return [*on, *off] if on else []


def problem(setting: Condition, *errors: Array, least: int = MIN_CIRCLES) -> str:
    """Why errors of a setting decide nothing; empty if they may."""
    together = np.all([np.isfinite(e) for e in errors], axis=0)
    n, solved = len(together), int(together.sum())
    if solved < MIN_SOLVED * n:
        return f"only {solved} of {n} circles are solved, perhaps the easy ones"
    if solved < least:
        return f"{solved} circles are too few; it takes {least}"
    return ""
