"""Questions of stated uncertainty: covariances of poses, and probabilities of the two candidates.

The logarithmic score is proper: it is worse whenever a covariance is less true. Coverage says which way it errs: too
few truths within the 95 % region are over-confidence, too many within the 50 % region under-confidence. Sharpness is
the size of the regions.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.validate.gate.checks import Tested, growth_verdicts, rate
from roundel.validate.gate.quantities import (
    ALPHA,
    CHI2,
    CHOICE,
    COVERAGE_FLOORS,
    MIN_CIRCLES,
    SCORE,
    SCORE_FLOOR,
    SHARPNESS_FLOOR,
    Array,
    Flags,
    beside_truth,
    flags,
    floats,
    groups_of,
    there,
)
from roundel.validate.metrics.uncertainty import DEGREES_OF_FREEDOM, choice_score, percentile_of
from roundel.validate.statistics.paired_tests import PairedTest, mean_growth_test

# A change of a pose's score beyond this counts as this much, so that a few poses do not outweigh the others.
SCORE_LIMIT = 10.0
_HOLDS = 0.95
_HALF = 0.5


def uncertainty_questions(run: str, new: pa.Table, old: pa.Table) -> list[Tested]:
    """Tests of the covariances and probabilities that both sides state; none if a baseline does not have them.

    Parameters
    ----------
    run : str
    new, old : pyarrow.Table
        Scores of the same circles, row by row.
    """
    both = flags(new, "solved") & flags(old, "solved")
    return [*_covariances(run, new, old, both), *_choice(run, new, old, both)]


def _covariances(run: str, new: pa.Table, old: pa.Table, both: Flags) -> list[Tested]:
    if not (there(SCORE, new, old) and there(CHI2, new, old)):
        return []
    chi2 = [floats(t, CHI2) for t in (new, old)]
    known = both & beside_truth(new) & beside_truth(old) & np.isfinite(chi2[1])
    keep = known & np.isfinite(chi2[0])
    if np.count_nonzero(known) < MIN_CIRCLES:
        return []
    out = [rate(run, "covariance given", keep[known], np.ones(int(known.sum())))] if np.any(known & ~keep) else []
    if np.count_nonzero(keep) < MIN_CIRCLES:
        return out
    score = [floats(t, SCORE)[keep] for t in (new, old)]
    inside = [percentile_of(v[keep]) for v in chi2]
    out += [_score(run, *score), *_coverage(run, *inside), _sharpness(run, score, [v[keep] for v in chi2])]
    group = groups_of(old)[keep]
    names = np.unique(group)
    for name in names.tolist() if len(names) > 1 else []:
        mine = group == name
        if np.count_nonzero(mine) >= MIN_CIRCLES:
            out.append(replace(_score(run, *(v[mine] for v in score)), group=name))
    return out


def _score(run: str, new: Array, old: Array) -> Tested:
    test = _mean_change(new, old, SCORE_LIMIT)
    was = float(old.mean())
    sentence = f"mean log score {was:.3f} -> {was + test.effect:.3f} of {test.n}"
    verdicts = growth_verdicts(test.effect, test.standard_error, SCORE_FLOOR)
    return Tested(run, "stated uncertainty", test, sentence, *verdicts)


def _mean_change(new: Array, old: Array, limit: float) -> PairedTest:
    change = np.clip(new - old, -limit, limit)
    return mean_growth_test(change, np.zeros(len(change)), alpha=ALPHA)


def _coverage(run: str, new: Array, old: Array) -> list[Tested]:
    """Over- and under-confidence, from the percentiles of chi-square; a change toward what is stated is no loss."""
    out = []
    for title, level, way in (("over-confidence", _HOLDS, 1.0), ("under-confidence", _HALF, -1.0)):
        within = [v <= level for v in (new, old)]
        is_now, was = (float(v.mean()) for v in within)
        # Too few truths within a region that should hold nearly all, or too many within one that should hold half.
        now, before = within if way > 0 else [~v for v in within]
        tested = rate(run, title, now, before)
        away = max(0.0, way * (level - is_now)) - max(0.0, way * (level - was))
        shares = f"{100 * was:.1f} % -> {100 * is_now:.1f} % of {tested.test.n}"
        sentence = f"{shares} truths within the {100 * level:.0f} % region"
        verdicts = growth_verdicts(away, tested.test.standard_error, COVERAGE_FLOORS[level])
        out.append(Tested(run, title, tested.test, sentence, *verdicts))
    return out


def _sharpness(run: str, score: list[Array], chi2: list[Array]) -> Tested:
    """Whether regions have grown, in all directions together, without need: not if the score says that they had to."""
    # The score is half of chi-square plus the logarithm of the determinant: what is left is five times log sigma.
    new, old = ((s - 0.5 * c) / DEGREES_OF_FREEDOM for s, c in zip(score, chi2, strict=True))
    test = _mean_change(new, old, math.inf)
    gain = float(np.mean(np.clip(score[1] - score[0], -SCORE_LIMIT, SCORE_LIMIT)))
    certain, otherwise = growth_verdicts(test.effect, test.standard_error, SHARPNESS_FLOOR)
    sentence = f"standard deviations stated {100 * math.expm1(test.effect):+.1f} % of {test.n}"
    return Tested(
        run, "sharpness", test, sentence, certain if gain <= 0 else "same", otherwise if gain >= 0 else "same"
    )


def _choice(run: str, new: pa.Table, old: pa.Table, both: Flags) -> list[Tested]:
    """Whether the stated probabilities of the two candidates hold as before."""
    if not all(there(name, new, old) for name in CHOICE):
        return []
    stated, right = ([floats(t, name) for t in (new, old)] for name in CHOICE)
    asked = both & np.isfinite(stated[1])
    known = asked & np.isfinite(stated[0])
    title = "probability of the likelier candidate"
    if np.count_nonzero(asked) < MIN_CIRCLES:
        return []
    out = [rate(run, f"{title} given", known[asked], np.ones(int(asked.sum())))] if np.any(asked & ~known) else []
    if np.count_nonzero(known) < MIN_CIRCLES:
        return out
    score = [choice_score(p[known], r[known] > 0) for p, r in zip(stated, right, strict=True)]
    test = _mean_change(score[0], score[1], math.inf)
    means = [_stated(p[known], r[known]) for p, r in zip(stated, right, strict=True)]
    sentence = f"log score {score[1].mean():.3f} -> {score[0].mean():.3f} of {test.n}; {means[1]} -> {means[0]}"
    verdicts = growth_verdicts(test.effect, test.standard_error, SCORE_FLOOR)
    return [*out, Tested(run, title, test, sentence, *verdicts)]


def _stated(probability: Array, right: NDArray[np.float64]) -> str:
    return f"{100 * probability.mean():.1f} % stated, {100 * np.mean(right):.1f} % right"
