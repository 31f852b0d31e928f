"""Slopes, means and ratios of errors, and whether they are in the region required by a claim.

An error's mean is modelled as proportional to a power of the distance, E[e] = exp(a_tilt + b ln r), and fitted to the
frames by the gamma quasi-likelihood, which only assumes that the standard deviation of errors grows with their mean.
Logarithms of single errors are never taken (a frame with an error near zero would dominate them), and no bins are
needed. Each statistic stores the influence of every frame on it. The sum of their squares gives its variance for any
distribution of the errors, like a bootstrap over frames (the tests compare the two) but without its noise and in a
thousandth of the time. The influences of two statistics of the same frames subtract, so comparisons are paired.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

LEVEL = 0.95
# Smaller than rounding: a statistic of noise-free frames has a standard error of zero.
_NOTHING = 1e-12


@dataclass(frozen=True)
class Estimate:
    """A statistic of frames.

    Attributes
    ----------
    value : float
    influence : (frames,) array
        Influence of each frame on the value; zero for frames that are not used.
    df : int
        Degrees of freedom of its standard error.
    n : int
        Number of circles used.
    """

    value: float
    influence: Array
    df: int
    n: int

    @property
    def error(self) -> float:
        """Standard error."""
        return float(np.sqrt(np.sum(self.influence**2)))

    def interval(self) -> tuple[float, float]:
        """95 % interval by Student's t."""
        half = float(stats.t.ppf(0.5 + LEVEL / 2, self.df)) * self.error
        return self.value - half, self.value + half

    def __sub__(self, other: Estimate) -> Estimate:
        """Difference of two statistics of the same frames, paired."""
        return Estimate(
            self.value - other.value,
            self.influence - other.influence,
            min(self.df, other.df),
            min(self.n, other.n),
        )

    def over(self, other: Estimate) -> Estimate:
        """Ratio of two statistics of the same frames, by the delta method."""
        ratio = self.value / other.value
        influence = (self.influence - ratio * other.influence) / other.value
        return Estimate(ratio, influence, min(self.df, other.df), min(self.n, other.n))

    def log(self) -> Estimate:
        """Natural logarithm, by the delta method."""
        return Estimate(math.log(self.value), self.influence / self.value, self.df, self.n)


def mean_of(values: Array, frame: Index) -> Estimate | None:
    """Mean over circles; those of one frame count as one sample.

    Parameters
    ----------
    values : (n,) array
        NaN for circles that are not used.
    frame : (n,) array
        Number of each circle's frame, from 0.

    Returns
    -------
    Estimate or None
        None with fewer than two frames.
    """
    known = np.isfinite(values)
    clusters = len(np.unique(frame[known]))
    if clusters < 2:
        return None
    y = values[known]
    mean = float(y.mean())
    scale = math.sqrt(clusters / (clusters - 1)) / len(y)
    return Estimate(mean, _by_frame((y - mean) * scale, frame[known], frame), clusters - 1, len(y))


def log_slope(values: Array, at: Array, stratum: Index, frame: Index) -> Estimate | None:
    """Slope b of ln E[value] = a_stratum + b ln(at).

    Parameters
    ----------
    values : (n,) array
        Non-negative errors; NaN is left out.
    at : (n,) array
        Positive distances.
    stratum : (n,) array of int
        Tilts: each has its own level, the slope is common.
    frame : (n,) array of int
        Frames are independent; circles of one frame may be correlated.

    Returns
    -------
    Estimate or None
        None if the frames do not determine a slope.

    Notes
    -----
    P. McCullagh and J. A. Nelder, Generalized Linear Models, 2nd ed. (1989), chapters 8 and 9: quasi-likelihood with
    variance proportional to the squared mean. Variance: K.-Y. Liang and S. L. Zeger, Biometrika 73 (1986).
    """
    return _fitted(values, at, stratum, frame, None)


def log_ratio(values: Array, at: Array, stratum: Index, frame: Index, first: int, second: int) -> Estimate | None:
    """Logarithm of the ratio of two strata's errors at equal distance: a_first - a_second of `log_slope`'s model."""
    return _fitted(values, at, stratum, frame, (first, second))


def _fitted(values: Array, at: Array, stratum: Index, frame: Index, pair: tuple[int, int] | None) -> Estimate | None:
    known = np.isfinite(values) & np.isfinite(at)
    y, f = values[known], frame[known]
    names, which = np.unique(stratum[known], return_inverse=True)
    clusters, size = len(np.unique(f)), len(names) + 1
    if clusters <= size or not np.any(y > 0) or (pair and not set(pair) <= set(names.tolist())):
        return None
    x = np.zeros((len(y), size))
    x[np.arange(len(y)), which] = 1.0
    log_at = np.log(at[known])
    x[:, -1] = log_at - log_at.mean()
    if np.linalg.matrix_rank(x) < size:
        return None
    contrast = np.zeros(size)
    if pair is None:
        contrast[-1] = 1.0
    else:
        contrast[:-1] = (names == pair[0]).astype(float) - (names == pair[1])
    beta = _solved(y, x)
    if beta is None:
        return None
    relative = y * np.exp(-x @ beta)
    direction = np.linalg.solve((x * relative[:, None]).T @ x, contrast)
    scale = math.sqrt(clusters / (clusters - size))
    influence = _by_frame((x @ direction) * (relative - 1.0) * scale, f, frame)
    return Estimate(float(contrast @ beta), influence, clusters - size, len(y))


def _by_frame(influence: Array, of: Index, every: Index) -> Array:
    """Sums over the circles of each frame."""
    return np.bincount(of, weights=influence, minlength=int(every.max()) + 1).astype(np.float64)


def _solved(y: Array, x: Array) -> Array | None:
    """Coefficients of ln E[y] = x beta by Fisher scoring; None if it does not converge."""
    beta = np.linalg.lstsq(x, np.full(len(y), math.log(y.mean())), rcond=None)[0]
    for _ in range(200):
        step = np.linalg.solve(x.T @ x, x.T @ (y * np.exp(-x @ beta) - 1.0))
        step *= min(1.0, 1.0 / float(np.max(np.abs(step)) + 1e-300))
        beta = beta + step
        if np.max(np.abs(step)) < 1e-10:
            return np.asarray(beta)
    return None


@dataclass(frozen=True)
class Decision:
    """Whether a statistic is inside the region of a claim, and with what certainty.

    Attributes
    ----------
    inside : bool
        Whether the estimate itself is inside.
    p : float
        Two-sided, for the nearest border of the region: the chance of an estimate this far beyond it if the true value
        is just on the other side.
    estimate : Estimate
        The statistic, or the deciding one of several.
    """

    inside: bool
    p: float
    estimate: Estimate


def decide(estimate: Estimate, low: float = -math.inf, high: float = math.inf) -> Decision:
    """Whether a statistic is in [low, high]."""
    e, error = estimate, estimate.error

    def tail(distance: float) -> float:
        rounding = _NOTHING * max(1.0, abs(e.value))
        if error <= rounding:
            return 0.0 if distance > rounding else 1.0
        return float(stats.t.sf(distance / error, e.df))

    if low <= e.value <= high:
        # Two one-sided tests: it must be inside both borders.
        return Decision(True, min(1.0, 2.0 * max(tail(e.value - low), tail(high - e.value))), e)
    return Decision(False, min(1.0, 2.0 * tail(max(low - e.value, e.value - high))), e)


def decide_all(estimates: Sequence[Estimate], low: float = -math.inf, high: float = math.inf) -> Decision:
    """Whether all of several statistics are in [low, high].

    All are inside only if the least certain one is (R. L. Berger's intersection-union test, Technometrics 24, 1982: no
    correction). A single one outside is enough to reject, with Bonferroni's correction.
    """
    found = [decide(e, low, high) for e in estimates]
    outside = [d for d in found if not d.inside]
    if not outside:
        # Far from every border all p are zero; then the nearest to a border, in standard errors, is the least certain.
        return max(found, key=lambda d: (d.p, -_clearance(d.estimate, low, high)))
    worst = min(outside, key=lambda d: d.p)
    return Decision(False, min(1.0, worst.p * len(found)), worst.estimate)


def _clearance(e: Estimate, low: float, high: float) -> float:
    return min(e.value - low, high - e.value) / max(e.error, _NOTHING)
