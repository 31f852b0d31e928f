"""How sure a number is: bootstrap intervals over frames, Wilson intervals for rates, Holm's correction for families."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

Array = NDArray[np.float64]

LEVEL = 0.95
# Below these an interval says more about the method than about the data: percentiles need frames in their tail.
MIN_SAMPLES = {"median": 10, "rms": 20, "p95": 60}
_RESAMPLES = 1999


@dataclass(frozen=True)
class Interval:
    """A value with its confidence interval.

    Attributes
    ----------
    value, low, high : float or None
        None where there are too few samples to say.
    n : int
        Samples that it rests on.
    method : str
        `BCa`, `percentile` (where BCa degenerates), `Wilson`, or why there is none.
    """

    value: float | None
    low: float | None
    high: float | None
    n: int
    method: str


def _median(x: Array, axis: int = -1) -> Array:
    return np.asarray(np.median(x, axis=axis))


def _rms(x: Array, axis: int = -1) -> Array:
    return np.asarray(np.sqrt(np.mean(x * x, axis=axis)))


def _p95(x: Array, axis: int = -1) -> Array:
    return np.asarray(np.percentile(np.abs(x), 95, axis=axis))


STATISTICS: dict[str, Callable[..., Array]] = {"median": _median, "p95": _p95, "rms": _rms}


def bootstrap_interval(values: ArrayLike, statistic: str, *, level: float = LEVEL, seed: int = 0) -> Interval:
    """Bootstrap interval of a statistic over frames: BCa, or percentiles where BCa degenerates.

    Parameters
    ----------
    values : (n,) array_like
        One a frame, independent; what is not finite is left out.
    statistic : {"median", "p95", "rms"}
        `p95` is of magnitudes.
    level : float
    seed : int

    Returns
    -------
    Interval
        In the unit of the values. Without bounds below `MIN_SAMPLES`.

    Notes
    -----
    B. Efron, Better bootstrap confidence intervals, JASA 82 (1987). On constant data BCa divides by zero.
    """
    x = np.asarray(values, dtype=np.float64)
    x = x[np.isfinite(x)]
    if not len(x):
        return Interval(None, None, None, 0, "no samples")
    function = STATISTICS[statistic]
    value = float(function(x))
    if len(x) < MIN_SAMPLES[statistic]:
        return Interval(value, None, None, len(x), f"fewer than {MIN_SAMPLES[statistic]} samples")
    if np.ptp(x) == 0.0:
        return Interval(value, value, value, len(x), "percentile")
    for method in ("BCa", "percentile"):
        with warnings.catch_warnings():
            # BCa's acceleration is 0/0 where leaving one frame out changes nothing: the loop then goes on.
            warnings.simplefilter("ignore", stats.DegenerateDataWarning)
            warnings.simplefilter("ignore", RuntimeWarning)
            found = stats.bootstrap(
                (x,),
                function,
                n_resamples=_RESAMPLES,
                batch=max(1, 4_000_000 // len(x)),
                vectorized=True,
                confidence_level=level,
                method=method,
                rng=np.random.default_rng(seed),
            ).confidence_interval
        if math.isfinite(found.low) and math.isfinite(found.high):
            break
    return Interval(value, float(found.low), float(found.high), len(x), method)


def wilson_interval(successes: int, n: int, *, level: float = LEVEL) -> Interval:
    """Wilson's score interval of a rate: sensible at 0 and at 1, where the textbook's has no width.

    Source: E. B. Wilson, JASA 22 (1927).
    """
    if n == 0:
        return Interval(None, None, None, 0, "no samples")
    bounds = stats.binomtest(successes, n).proportion_ci(level, method="wilson")
    return Interval(successes / n, float(bounds.low), float(bounds.high), n, "Wilson")


def holm(p_values: ArrayLike) -> Array:
    """p-values adjusted for a family, so that any below alpha keeps the family's error below alpha.

    Source: S. Holm, A simple sequentially rejective multiple test procedure, Scand. J. Stat. 6 (1979).

    Parameters
    ----------
    p_values : (m,) array_like

    Returns
    -------
    (m,) array
        In the order of the input.
    """
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p, kind="stable")
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    out = np.empty_like(p)
    out[order] = np.minimum(steps, 1.0)
    return out
