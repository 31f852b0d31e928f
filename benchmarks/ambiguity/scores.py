"""How often stated probabilities decide, how often they are right, and whether they are calibrated, for `ambiguity.py`.

Every circle of which something was declared has one number, the probability that was stated for its true candidate. It
counts as *decided* where that of the likelier candidate is at least 95 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DECIDED = 0.95
BINS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
_LEAST = 1e-6  # of a probability, for the log score: one that rounds to zero would make it infinite


@dataclass(frozen=True)
class Score:
    """Scores of some circles; shares are fractions.

    Attributes
    ----------
    circles : int
    decided : float
        Share with a stated probability of at least `DECIDED`.
    right_decided : float
        Share of these whose likelier candidate is the true one.
    right : float
        The same of all circles; where both are equally likely, one half counts.
    stated : float
        Mean stated probability of the likelier candidate: what `right` should be.
    excess : float
        `right` minus `stated` in standard deviations of what chance allows if every probability holds; beyond 3 to the
        negative side the probabilities are overconfident.
    brier : float
        Mean squared difference between the stated probability of the true candidate and 1; 0.25 without knowledge.
    log_score : float
        Mean of minus the natural logarithm of that probability; 0.693 without knowledge.
    calibration_error : float
        Mean of |stated - right| over the bins of `reliability`, weighted by circles.
    """

    circles: int
    decided: float
    right_decided: float
    right: float
    stated: float
    excess: float
    brier: float
    log_score: float
    calibration_error: float


def score_of(probability: Array) -> Score:
    """Scores of the stated probabilities (n,) of true candidates.

    Source of the proper scores: T. Gneiting and A. E. Raftery, Strictly proper scoring rules, prediction, and
    estimation, JASA 102 (2007).
    """
    if len(probability) == 0:
        return Score(0, *[math.nan] * 8)
    likelier = np.maximum(probability, 1.0 - probability)
    right = np.where(probability == 0.5, 0.5, probability > 0.5)
    sure = likelier >= DECIDED
    chance = math.sqrt(float(np.sum(likelier * (1.0 - likelier))))
    off = float(np.sum(right - likelier))
    bins = reliability(probability)
    return Score(
        len(probability),
        float(sure.mean()),
        float(right[sure].mean()) if sure.any() else math.nan,
        float(right.mean()),
        float(likelier.mean()),
        off / chance if chance > 0 else (0.0 if off == 0 else math.copysign(math.inf, off)),
        float(np.mean((1.0 - probability) ** 2)),
        float(np.mean(-np.log(np.maximum(probability, _LEAST)))),
        sum(n * abs(stated - true) for n, stated, true in bins) / len(probability),
    )


def reliability(probability: Array) -> list[tuple[int, float, float]]:
    """Circles, mean stated probability and share right, of the likelier candidate in each bin that has circles."""
    likelier = np.maximum(probability, 1.0 - probability)
    right = np.where(probability == 0.5, 0.5, probability > 0.5)
    index = np.clip(np.searchsorted(BINS, likelier, side="right") - 1, 0, len(BINS) - 2)
    return [
        (int(np.sum(index == b)), float(likelier[index == b].mean()), float(right[index == b].mean()))
        for b in range(len(BINS) - 1)
        if np.any(index == b)
    ]


@dataclass(frozen=True, eq=False)
class Stated:
    """What was stated of circles with one kind of knowledge and one kind of intrinsics.

    Attributes
    ----------
    kind, intrinsics : str
    probability : (n,) array
        Of the true candidate.
    distance_D, tilt_deg, offset_px : (n,) arrays
        See `Circle`; the tilt is that from the line of sight.
    """

    kind: str
    intrinsics: str
    probability: Array
    distance_D: Array
    tilt_deg: Array
    offset_px: Array
