"""Verdicts on the paper's claims, decided on a report's own frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from roundel.validate.claims.claim import Claim, Finding
from roundel.validate.claims.conditions import Condition, conditions_of
from roundel.validate.claims.normal import normal_focal, normal_grows, normal_lowest_tilt
from roundel.validate.claims.position import position_calibrated, position_uncalibrated
from roundel.validate.claims.reprojection import (
    reprojection_calibrated,
    reprojection_meets,
    reprojection_uncalibrated,
)
from roundel.validate.metrics.rows import Rows
from roundel.validate.statistics.intervals import holm

HOLDS, CONDITION, FALSE, OPEN = (
    "holds",
    "holds under a condition",
    "does not hold",
    "cannot be decided from these frames",
)
ALPHA = 0.05

CLAIMS: tuple[Callable[[Sequence[Condition]], Claim | None], ...] = (
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
class Verdict:
    """The decision of these frames on a claim of the paper.

    Attributes
    ----------
    claim : Claim
        With decided findings: groups, on and off the axis, strict and lenient reading; the paper's own condition first.
    outcome : str
        `HOLDS`, `CONDITION`, `FALSE` or `OPEN`.
    settings : tuple of (str, str)
        The outcome's reason by condition: the condition's name (empty if there is only one), and sentences.
    qualifier : str
        A sentence that goes with the outcome: where a claim holds that does not hold everywhere, or the weaker claim
        that holds instead of a false one; empty if there is nothing to add.
    """

    claim: Claim
    outcome: str
    settings: tuple[tuple[str, str], ...]
    qualifier: str = ""

    @property
    def sentence(self) -> str:
        """The outcome's reason, with the numbers."""
        return " ".join(f"{where}: {text}" if where else text for where, text in self.settings)

    @property
    def picture(self) -> str:
        """Name of its figure."""
        return f"verdict-{self.claim.key}"


def verdicts_of(table: Rows, study: dict[str, Any]) -> list[Verdict]:
    """Verdicts of a report.

    Parameters
    ----------
    table : Rows
        Scores.
    study : dict
        The resolved study.

    Returns
    -------
    list of Verdict
        Empty if the study cannot test the claims: no pair of a calibrated and an uncalibrated case, no marker on the
        optical axis, or a sweep over a nuisance.

    Notes
    -----
    All statistics of a report form one family: Holm's correction keeps the chance of any wrong decision below 5 %.
    """
    settings = conditions_of(table, study)
    claims = [claim for make in CLAIMS if (claim := make(settings)) is not None]
    tested = [f.p for claim in claims for f in claim.findings if f.p is not None]
    adjusted = iter(holm(tested).tolist() if tested else [])
    return [
        verdict_on(replace(c, findings=[decided(f, next(adjusted) if f.p is not None else None) for f in c.findings]))
        for c in claims
    ]


def decided(finding: Finding, p_adjusted: float | None) -> Finding:
    """A finding with its decision at level `ALPHA`, or the reason why there is none."""
    sure = p_adjusted is not None and p_adjusted < ALPHA
    alone = finding.p is not None and finding.p < ALPHA  # significant without the correction
    why = "it is not significant after Holm's correction" if alone else "the interval crosses the limit"
    reason = finding.reason or ("" if sure else why)
    return replace(finding, p_adjusted=p_adjusted, holds=finding.inside if sure else None, reason=reason)


def verdict_on(claim: Claim) -> Verdict:
    """The verdict on a claim whose findings are decided."""
    outcome = _outcome(claim)
    return Verdict(claim, outcome, _by_setting(claim), _qualifier(claim, outcome))


def _outcome(claim: Claim) -> str:
    """The main findings on the axis decide; where they hold, findings that contradict them make it conditional."""
    own = {f.holds for f in claim.findings if f.main and f.on_axis} - {None}
    if not own:
        return OPEN
    if own == {False}:
        return FALSE
    contradicted = any(f.holds is False for f in claim.findings)
    return CONDITION if contradicted or claim.conditional else HOLDS


def _qualifier(claim: Claim, outcome: str) -> str:
    """Where a conditional claim holds, or the weaker claim that holds instead of a false one."""
    main = [f for f in claim.findings if f.main]
    true, false = ([f.where for f in main if f.holds is holds] for holds in (True, False))
    if outcome == CONDITION:
        if false:
            return f"It holds for {_list(true)}; it does not hold for {_list(false)}."
        beside = next((f.statistic for f in claim.findings if f.holds is False), "")
        return f"It holds, but not in this respect: {beside}." if beside else f"It holds {claim.conditional}."
    if outcome != FALSE:
        return ""
    if true:
        return f"It holds only for {_list(true)}."
    weaker = {f.holds for f in claim.findings if f.on_axis and not f.main} - {None}
    if claim.weaker and weaker == {True}:
        return f"A weaker claim holds: {claim.weaker}."
    return f"By theory it holds only {claim.conditional}." if claim.conditional else ""


def _list(names: list[str]) -> str:
    once = list(dict.fromkeys(names))
    return " and ".join(filter(None, [", ".join(once[:-1]), once[-1]]))


_WORDS = {True: "holds", False: "does not hold", None: "not decided"}


def _by_setting(claim: Claim) -> tuple[tuple[str, str], ...]:
    """Every statistic as a sentence, by condition if there are several."""
    settings = list(dict.fromkeys(f.where for f in claim.findings))
    parts = []
    for where in settings:
        text = " ".join(_clause(f) for f in claim.findings if f.where == where)
        text += "".join(f" {remark}" for name, remark in claim.remarks if name == where)
        parts.append((where if len(settings) > 1 else "", text))
    return tuple(parts)


def _clause(finding: Finding) -> str:
    """A statistic as a sentence: the number with its interval, the required range, the decision."""
    if finding.p_adjusted is None:
        return f"{finding.text()}."
    p = "p < 0.0001" if finding.p_adjusted < 1e-4 else f"p = {finding.p_adjusted:.2g}"
    why = f", because {finding.reason}" if finding.holds is None else ""
    text = finding.text()
    return f"{text[:1].upper()}{text[1:]} (required: {finding.region}; {p}): {_WORDS[finding.holds]}{why}."


# The fields of each finding in summary.json.
_FINDING = ("where", "on_axis", "main", "statistic", "value", "low", "high", "n", "region", "holds", "reason")


def verdict_record(verdict: Verdict) -> dict[str, Any]:
    """A verdict as plain values for summary.json: those of the first finding, and all findings as `sides`."""
    claim, first = verdict.claim, verdict.claim.findings[0]
    return {
        "key": claim.key,
        "claim": claim.claim,
        "source": claim.source,
        "outcome": verdict.outcome,
        "qualifier": verdict.qualifier,
        "sentence": verdict.sentence,
        "settings": [{"where": where, "text": text} for where, text in verdict.settings],
        "condition": claim.condition,
        "statistic": first.statistic,
        "value": first.value,
        "low": first.low,
        "high": first.high,
        "p": first.p_adjusted,
        "n": first.n,
        "sides": [{**{key: getattr(f, key) for key in _FINDING}, "p": f.p_adjusted} for f in claim.findings],
        "picture": verdict.picture,
    }
