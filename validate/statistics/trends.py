"""Slopes, means and ratios of errors, and whether they lie in the region that a claim asks for.

An error's mean is modelled as proportional to a power of the distance, E[e] = exp(a_tilt + b ln r), and fitted to the
frames by the gamma quasi-likelihood: it asks of the errors only that their spread grows with their mean. Logarithms of
single errors are never taken (a frame that happens to be near zero would rule them), and no bins are needed.
Each statistic carries the influence of every frame on it. Sums of their squares give its spread whatever the law of
the errors, as a bootstrap over frames would (the tests compare the two), without its noise and in a thousandth of the
time; and the influences of two statistics of the same frames subtract, so that comparisons are paired.
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
# Smaller than rounding: a statistic of noise-free frames has no spread.
_NOTHING = 1e-12


@dataclass(frozen=True)
class Estimate:
    """A statistic of frames.

    Attributes
    ----------
    value : float
    influence : (frames,) array
        How much each frame moves the value; zero for frames that it does not rest on.
    df : int
        Degrees of freedom of its spread.
    n : int
        Circles that it rests on.
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
    """Mean over circles; those of one frame count as one draw.

    Parameters
    ----------
    values : (n,) array
        NaN where a circle has no say.
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
        Errors, not negative; NaN is left out.
    at : (n,) array
        Positive: distances.
    stratum : (n,) array of int
        Tilts: each has its own level, the slope is common.
    frame : (n,) array of int
        Frames are independent; circles of one frame need not be.

    Returns
    -------
    Estimate or None
        None where the frames determine no slope.

    Notes
    -----
    P. McCullagh and J. A. Nelder, Generalized Linear Models, 2nd ed. (1989), chapters 8 and 9: quasi-likelihood with
    variance proportional to the squared mean. Spread: K.-Y. Liang and S. L. Zeger, Biometrika 73 (1986).
    """
    return _fitted(values, at, stratum, frame, None)


def log_ratio(values: Array, at: Array, stratum: Index, frame: Index, first: int, second: int) -> Estimate | None:
    """Logarithm of the ratio of two strata's errors at like distance: a_first - a_second of `log_slope`'s model."""
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
    """Coefficients of ln E[y] = x beta by Fisher's scoring; None where it does not settle."""
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
    """Where a statistic lies: inside the region of a claim or outside, and how surely.

    Attributes
    ----------
    inside : bool
        Of the estimate itself.
    p : float
        Two-sided, of the nearest border of the region: the chance of being so far beyond it from just on the other
        side of it.
    estimate : Estimate
        The statistic, or of several the one that decides.
    """

    inside: bool
    p: float
    estimate: Estimate


def decide(estimate: Estimate, low: float = -math.inf, high: float = math.inf) -> Decision:
    """Whether a statistic lies in [low, high]."""
    e, error = estimate, estimate.error

    def tail(distance: float) -> float:
        rounding = _NOTHING * max(1.0, abs(e.value))
        if error <= rounding:
            return 0.0 if distance > rounding else 1.0
        return float(stats.t.sf(distance / error, e.df))

    if low <= e.value <= high:
        # Two one-sided tests: it must be clear of both borders.
        return Decision(True, min(1.0, 2.0 * max(tail(e.value - low), tail(high - e.value))), e)
    return Decision(False, min(1.0, 2.0 * tail(max(low - e.value, e.value - high))), e)


def decide_all(estimates: Sequence[Estimate], low: float = -math.inf, high: float = math.inf) -> Decision:
    """Whether every one of several statistics lies in [low, high].

    All are inside only if the least sure one is (R. L. Berger's intersection-union test, Technometrics 24, 1982: no
    correction). One outside is enough to refuse it, and has to stand Bonferroni's correction.
    """
    found = [decide(e, low, high) for e in estimates]
    outside = [d for d in found if not d.inside]
    if not outside:
        # Far from every border all p are zero: then the nearest to one, in standard errors, is the least sure.
        return max(found, key=lambda d: (d.p, -_clearance(d.estimate, low, high)))
    worst = min(outside, key=lambda d: d.p)
    return Decision(False, min(1.0, worst.p * len(found)), worst.estimate)


def _clearance(e: Estimate, low: float, high: float) -> float:
    return min(e.value - low, high - e.value) / max(e.error, _NOTHING)
