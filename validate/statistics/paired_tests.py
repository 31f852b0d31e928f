"""Paired tests of two methods on the same frames, with the detectable effect.

Frames are paired, so that their individual difficulty cancels. Errors must be divided by their frame's own Cramer-Rao
bound, so that no frame outweighs the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from roundel.validate.statistics.intervals import LEVEL, Interval, frame_numbers

Array = NDArray[np.float64]

_POWER = 0.95


@dataclass(frozen=True)
class PairedTest:
    """Result of one comparison, new against old.

    Attributes
    ----------
    effect : float
        Positive is worse: log of the ratio of RMS errors, a shift, or a difference of rates.
    standard_error : float
    p_value : float
        One-sided, for the null hypothesis of no loss.
    n : int
        Number of pairs.
    detectable : float
        The effect that these pairs would show at `alpha` in 95 of 100 cases, a measure of the set's power.
    """

    effect: float
    standard_error: float
    p_value: float
    n: int
    detectable: float


def rms_ratio_test(new: ArrayLike, old: ArrayLike, *, alpha: float, clusters: ArrayLike | None = None) -> PairedTest:
    """Test whether the RMS of paired errors has grown: log ratio, with its linearised standard deviation over frames.

    The ratio of RMS is used instead of the mean of log ratios, which is dominated by frames in which an error happened
    to be small, and contains little information on the large ones.

    Parameters
    ----------
    new, old : (n,) or (n, k) array_like
        Errors of the same frames over their bounds; k components of one frame go together.
    alpha : float
        For `detectable`.
    clusters : (n,) array_like of int, optional
        Frame of each row; rows of one frame go together. Default: each row is a frame of its own.

    Returns
    -------
    PairedTest
        `effect` is ln(RMS new / RMS old).

    Raises
    ------
    ValueError
        If the shapes differ, or fewer than two frames are given.
    """
    a, b = _paired(new, old)
    power_new, power_old = (np.sum(v.reshape(len(v), -1) ** 2, axis=1) for v in (a, b))
    if np.array_equal(power_new, power_old):
        return PairedTest(0.0, 0.0, 1.0, len(a), 0.0)
    total_new, total_old = float(np.sum(power_new)), float(np.sum(power_old))
    if total_old == 0.0 or total_new == 0.0:
        effect = math.inf if total_new > 0 else -math.inf
        return PairedTest(effect, 0.0, float(total_new == 0.0), len(a), 0.0)
    effect = 0.5 * math.log(total_new / total_old)
    # The logarithm of the ratio is close to normal: to first order it is a sum over frames.
    error, units = _clustered(0.5 * (power_new / total_new - power_old / total_old), clusters)
    return _tested(effect, error, units, len(a), alpha)


def shift_test(new: ArrayLike, old: ArrayLike, *, alpha: float) -> PairedTest:
    """Test whether the mean of a signed error has moved, in either direction: paired t-test.

    A shift common to all frames is not visible in the RMS of a much larger error, but it is in its mean.

    Returns
    -------
    PairedTest
        `effect` is |mean(new) - mean(old)| in the unit of the input; the p-value is two-sided.
    """
    a, b = _paired(new, old)
    difference = (a - b).ravel()
    n = len(difference)
    mean = float(np.mean(difference))
    error = float(np.std(difference, ddof=1) / math.sqrt(n))
    if error == 0.0:
        return PairedTest(abs(mean), 0.0, float(mean == 0.0), n, 0.0)
    p = 2.0 * float(stats.t.sf(abs(mean) / error, n - 1))
    return PairedTest(abs(mean), error, p, n, detectable_effect(error, alpha / 2))


def mean_growth_test(new: ArrayLike, old: ArrayLike, *, alpha: float) -> PairedTest:
    """Test whether the mean of a score has grown: paired one-sided t-test.

    Returns
    -------
    PairedTest
        `effect` is mean(new) - mean(old) in the unit of the input.
    """
    a, b = _paired(new, old)
    difference = (a - b).ravel()
    n, mean = len(difference), float(np.mean(difference))
    error = float(np.std(difference, ddof=1) / math.sqrt(n))
    if error == 0.0:
        return PairedTest(mean, 0.0, float(mean <= 0.0), n, 0.0)
    return PairedTest(mean, error, float(stats.t.sf(mean / error, n - 1)), n, detectable_effect(error, alpha))


def mean_ratio_test(new: tuple[ArrayLike, ArrayLike], old: tuple[ArrayLike, ArrayLike], *, alpha: float) -> PairedTest:
    """Test whether a mean over items has grown, where each frame has some items, not the same on both sides.

    Parameters
    ----------
    new, old : pair of (n,) array_like
        Sum of the scores of each frame's items, and their number.
    alpha : float
        For `detectable`.

    Returns
    -------
    PairedTest
        `effect` is the difference of the means over all items, with its linearised standard deviation over frames.

    Raises
    ------
    ValueError
        If a side has no items.
    """
    influence, means = [], []
    for total, number in (new, old):
        s, n = np.asarray(total, dtype=np.float64), np.asarray(number, dtype=np.float64)
        if n.sum() == 0:
            raise ValueError("one side has no items to compare")
        means.append(float(s.sum() / n.sum()))
        influence.append((s - means[-1] * n) / n.sum())
    effect = means[0] - means[1]
    error, units = _clustered(influence[0] - influence[1], None)
    return _tested(effect, error, units, units, alpha)


def sign_test(new: ArrayLike, old: ArrayLike, *, alpha: float) -> PairedTest:
    """Test whether a count has grown in more frames than it has fallen: exact one-sided sign test.

    Parameters
    ----------
    new, old : (n,) array_like of int
        Counts of the same frames.

    Returns
    -------
    PairedTest
        `effect` is the share of frames with more, less that of frames with fewer.
    """
    a, b = _paired(new, old)
    return mcnemar_test(a <= b, b <= a, alpha=alpha)


def mcnemar_test(new: ArrayLike, old: ArrayLike, *, alpha: float) -> PairedTest:
    """Test whether fewer frames succeed than before: exact one-sided McNemar test on the frames that changed.

    Source: Q. McNemar, Note on the sampling error of the difference between correlated proportions, Psychometrika 12
    (1947), with the binomial distribution in place of its chi-square.

    Parameters
    ----------
    new, old : (n,) array_like of bool
        Success of the same frames.

    Returns
    -------
    PairedTest
        `effect` is the loss of the rate of success, a fraction.
    """
    a, b = _paired(np.asarray(new, dtype=bool), np.asarray(old, dtype=bool))
    lost, won = int(np.sum(b.astype(bool) & ~a.astype(bool))), int(np.sum(a.astype(bool) & ~b.astype(bool)))
    n = len(a)
    error = math.sqrt(lost + won) / n
    p = float(stats.binomtest(lost, lost + won, 0.5, alternative="greater").pvalue) if lost + won else 1.0
    # With only losses, this number is beyond chance; at this number half of the real losses may be missed.
    needed = math.ceil(math.log2(1.0 / alpha)) if alpha < 1 else 1
    detectable = float(stats.gamma.isf(1 - _POWER, needed)) / n
    return PairedTest((lost - won) / n, error, p, n, detectable)


def rate_difference(only_first: int, only_second: int, n: int, *, level: float = LEVEL) -> Interval:
    """Difference of two rates of success on the same n items, second minus first, with its interval.

    Wald's interval with half an item added to each of the four cells, which keeps its level for few items and for
    rates near one. Source: A. Agresti, Y. Min, Simple improved confidence intervals for comparing matched proportions,
    Statistics in Medicine 24 (2005).
    """
    b, c, total = only_first + 0.5, only_second + 0.5, n + 2.0
    middle = (c - b) / total
    half = float(stats.norm.ppf((1 + level) / 2)) * math.sqrt(b + c - (c - b) ** 2 / total) / total
    low, high = max(-1.0, middle - half), min(1.0, middle + half)
    return Interval((only_second - only_first) / n, low, high, n, "Agresti-Min")


def detectable_effect(standard_error: float, alpha: float) -> float:
    """The effect that a one-sided test at `alpha` detects in 95 of 100 cases."""
    return float((stats.norm.isf(alpha) + stats.norm.ppf(_POWER)) * standard_error)


def _paired(new: ArrayLike, old: ArrayLike) -> tuple[Array, Array]:
    a, b = np.asarray(new, dtype=np.float64), np.asarray(old, dtype=np.float64)
    if a.shape != b.shape or a.ndim not in (1, 2):
        raise ValueError(f"paired errors must have one shape (n,) or (n, k); these have {a.shape} and {b.shape}")
    if len(a) < 2:
        raise ValueError("a comparison needs at least two frames")
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
        raise ValueError("an error is not finite; compare frames that both sides solved")
    return a, b


def _clustered(influence: Array, clusters: ArrayLike | None) -> tuple[float, int]:
    """Standard error of a sum of influences (n,), and the number of independent units; those of a frame go together."""
    if clusters is not None:
        influence = np.bincount(frame_numbers(np.asarray(clusters)), influence).astype(np.float64)
    n = len(influence)
    return (math.sqrt(n / (n - 1) * float(np.sum(influence**2))) if n > 1 else math.inf), n


def _tested(effect: float, error: float, units: int, pairs: int, alpha: float) -> PairedTest:
    p = float(stats.t.sf(effect / error, units - 1)) if 0 < error < math.inf else float(effect <= 0 or error > 0)
    return PairedTest(effect, error, p, pairs, detectable_effect(error, alpha))
