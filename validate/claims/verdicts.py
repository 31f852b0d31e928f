"""The paper's claims as verdicts: each decided on a report's own frames, with its statistic, and written in words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import pyarrow as pa

from roundel.validate.claims.claim import Claim, Finding
from roundel.validate.claims.conditions import Setting, settings_of
from roundel.validate.claims.normal import normal_focal, normal_grows, normal_lowest_tilt
from roundel.validate.claims.position import position_calibrated, position_uncalibrated
from roundel.validate.claims.reprojection import (
    reprojection_calibrated,
    reprojection_meets,
    reprojection_uncalibrated,
)
from roundel.validate.statistics.intervals import holm

HOLDS, CONDITION, FALSE, OPEN = (
    "holds",
    "holds under a condition",
    "does not hold",
    "cannot be decided from these frames",
)
ALPHA = 0.05

CLAIMS: tuple[Callable[[Sequence[Setting]], Claim | None], ...] = (
    normal_grows,
    normal_lowest_tilt,
    position_calibrated,
    position_uncalibrated,
    reprojection_calibrated,
    reprojection_uncalibrated,
    reprojection_meets,
    normal_focal,
)


@dataclass(frozen=True)
class Side:
    """A statistic and what it decides: `Finding` with the family's correction.

    `holds` is None where the frames do not decide; `p` is Holm's.
    """

    where: str
    on_axis: bool
    main: bool
    statistic: str
    value: float | None
    low: float | None
    high: float | None
    n: int
    region: str
    p: float | None
    holds: bool | None
    reason: str


@dataclass(frozen=True)
class Verdict:
    """What these frames say about a claim of the paper.

    Attributes
    ----------
    key, claim, source : str
        The claim in our words, and where the paper makes it.
    outcome : str
        `HOLDS`, `CONDITION`, `FALSE` or `OPEN`.
    sentence : str
        The outcome's reason, with the numbers.
    settings : list of {where, text}
        The same by setting; where there is one alone, it has no name.
    condition : str
        Under which it is true.
    statistic, value, low, high, p, n
        Of the first side: the paper's own setting.
    sides : list of Side
        Every statistic: groups, on and off the axis, the strict reading and the lenient one.
    picture : str
        Name of its figure.
    """

    key: str
    claim: str
    source: str
    outcome: str
    sentence: str
    settings: list[dict[str, str]]
    condition: str
    statistic: str
    value: float | None
    low: float | None
    high: float | None
    p: float | None
    n: int
    sides: list[Side]
    picture: str


def verdicts_of(table: pa.Table, study: dict[str, Any]) -> list[dict[str, Any]]:
    """Verdicts of a report, as plain JSON.

    Parameters
    ----------
    table : pa.Table
        Scores.
    study : dict
        The resolved study.

    Returns
    -------
    list of dict
        `Verdict` records. Empty where the study asks nothing that the paper claims: no calibrated beside an
        uncalibrated case, no marker on the optical axis, a sweep over a nuisance.

    Notes
    -----
    All statistics of a report are one family: Holm's correction keeps the chance of any wrong side below 5 %.
    """
    settings = settings_of(table, study)
    claims = [claim for make in CLAIMS if (claim := make(settings)) is not None]
    findings = [f for claim in claims for f in claim.findings]
    tested = [f.p for f in findings if f.p is not None]
    adjusted = iter(holm(tested).tolist() if tested else [])
    sides = iter([_side(f, next(adjusted) if f.p is not None else None) for f in findings])
    return [asdict(_verdict(claim, [next(sides) for _ in claim.findings])) for claim in claims]


def _side(f: Finding, p: float | None) -> Side:
    decided = p is not None and p < ALPHA
    many = f.p is not None and f.p < ALPHA  # sure, were it the only one
    why = "it is not sure among all the report's statistics" if many else "the interval reaches over the border"
    reason = f.reason or ("" if decided else why)
    return Side(
        f.where,
        f.on_axis,
        f.main,
        f.statistic,
        f.value,
        f.low,
        f.high,
        f.n,
        f.region,
        p,
        f.inside if decided else None,
        reason,
    )


def _verdict(claim: Claim, sides: list[Side]) -> Verdict:
    first, settings = sides[0], _by_setting(claim, sides)
    return Verdict(
        claim.key,
        claim.claim,
        claim.source,
        _outcome(sides, claim.conditional),
        " ".join(f"{one['where']}: {one['text']}" if one["where"] else one["text"] for one in settings),
        settings,
        claim.condition,
        first.statistic,
        first.value,
        first.low,
        first.high,
        first.p,
        first.n,
        sides,
        f"verdict-{claim.key}",
    )


def _outcome(sides: Sequence[Side], conditional: bool) -> str:
    """The claim itself, on the axis, decides; sides beside it make a condition of what they contradict."""
    own = [s.holds for s in sides if s.main and s.on_axis]
    beside = [s.holds for s in sides if not (s.main and s.on_axis)]
    if all(h is None for h in own):
        return OPEN
    said = {h for h in (*own, *beside) if h is not None}
    if said == {True}:
        return CONDITION if conditional else HOLDS
    if said == {False}:
        return FALSE
    return CONDITION


_WORDS = {True: "holds", False: "does not hold", None: "not decided"}


def _by_setting(claim: Claim, sides: Sequence[Side]) -> list[dict[str, str]]:
    """Every statistic as a sentence, under its setting's name where there are several."""
    settings = list(dict.fromkeys(s.where for s in sides))
    parts = []
    for where in settings:
        text = " ".join(_clause(f, s) for f, s in zip(claim.findings, sides, strict=True) if s.where == where)
        text += "".join(f" {remark}" for name, remark in claim.remarks if name == where)
        parts.append({"where": where if len(settings) > 1 else "", "text": text})
    return parts


def _clause(finding: Finding, side: Side) -> str:
    """A statistic: the number with its interval, what was asked of it, what follows."""
    if side.p is None:
        return f"{finding.text()}."
    p = "p < 0.0001" if side.p < 1e-4 else f"p = {side.p:.2g}"
    why = f", as {side.reason}" if side.holds is None else ""
    text = finding.text()
    return f"{text[:1].upper()}{text[1:]} (asked: {finding.region}; {p}): {_WORDS[side.holds]}{why}."
