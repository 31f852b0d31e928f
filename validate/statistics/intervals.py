"""Confidence intervals: bootstrap over frames, Wilson for rates; Holm's correction for families.

Frames are the independent samples: circles of a frame share camera, light and noise, so a frame with several circles is
resampled as a unit. Beyond `MOST_UNITS` frames, random groups of frames are the units, so that time and memory of
resampling have a limit.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

LEVEL = 0.95
# Minimum numbers of frames for an interval: percentiles need frames in their tail.
MIN_SAMPLES = {"median": 10, "rms": 20, "p95": 60}
_Q = {"median": 0.5, "p95": 0.95}
_RESAMPLES = 1999
_AT_ONCE = 2_000_000  # values in one block of resamples
MOST_UNITS = 20_000


@dataclass(frozen=True)
class Interval:
    """A value with its confidence interval.

    Attributes
    ----------
    value, low, high : float or None
        None if there are too few samples.
    n : int
        Number of frames.
    method : str
        `BCa`, `percentile` (if BCa degenerates), `Wilson`, or why there is none.
    """

    value: float | None
    low: float | None
    high: float | None
    n: int
    method: str


def bootstrap_interval(
    values: ArrayLike, statistic: str, *, clusters: ArrayLike | None = None, level: float = LEVEL, seed: int = 0
) -> Interval:
    """Bootstrap interval of a statistic over frames: BCa, or percentiles if BCa degenerates.

    Parameters
    ----------
    values : (n,) array_like
        Values that are not finite are left out.
    statistic : {"median", "p95", "rms"}
        `p95` is of magnitudes.
    clusters : (n,) array_like of int, optional
        Frame of each value; values of one frame are drawn together. Default: each value is its own frame.
    level : float
    seed : int

    Returns
    -------
    Interval
        In the unit of the values. Without bounds below `MIN_SAMPLES` frames.

    Notes
    -----
    B. Efron, Better bootstrap confidence intervals, JASA 82 (1987). On constant data BCa divides by zero. Order
    statistics of independent frames need no resampling: their rank in the sample has a known (beta) distribution.
    """
    x = np.asarray(values, dtype=np.float64)
    return bootstrap_intervals([x], (statistic,), clusters=clusters, level=level, seed=seed)[0][statistic]


def bootstrap_intervals(
    columns: Iterable[ArrayLike],
    statistics: Sequence[str] = tuple(MIN_SAMPLES),
    *,
    clusters: ArrayLike | None = None,
    level: float = LEVEL,
    seed: int = 0,
) -> list[dict[str, Interval]]:
    """`bootstrap_interval` of every statistic of every column (n,).

    Columns are used one after another and not kept. Those with the same gaps share their draws.
    """
    out: list[dict[str, Interval]] = []
    powers: dict[tuple[int, bytes], tuple[list[_Power], Array]] = {}
    gaps, frame = b"", np.zeros(0, dtype=np.int64)
    for i, values in enumerate(columns):
        x = np.asarray(values, dtype=np.float64)
        known = np.isfinite(x)
        digest = hashlib.sha256(known.tobytes()).digest()
        if digest != gaps or i == 0:
            label = np.arange(len(x)) if clusters is None else np.asarray(clusters)
            gaps, frame = digest, frame_numbers(label[known])
        x = x[known]
        frames = int(frame.max()) + 1 if len(x) else 0
        found: dict[str, Interval] = {}
        for statistic in statistics:
            value = _statistic(x, statistic)
            if value is None:
                found[statistic] = Interval(None, None, None, 0, "no samples")
            elif frames < MIN_SAMPLES[statistic]:
                found[statistic] = Interval(value, None, None, frames, f"fewer than {MIN_SAMPLES[statistic]} frames")
            elif np.ptp(np.abs(x) if statistic == "p95" else x) == 0.0:
                found[statistic] = Interval(value, value, value, frames, "percentile")
            elif statistic == "rms":
                found[statistic] = Interval(value, None, None, frames, "")
                unit = units_of(frame)
                count = np.bincount(unit).astype(np.float64)
                mine = powers.setdefault((frames, digest), ([], count))[0]
                mine.append(_Power(i, value, np.bincount(unit, x * x).astype(np.float64)))
            else:
                ends = _bca(value, *_quantile_draws(x, frame, statistic, seed), level)
                found[statistic] = Interval(value, ends[0], ends[1], frames, ends[2])
        out.append(found)
    for (frames, _), (alike, count) in powers.items():
        draws = _rms_draws(np.stack([p.power for p in alike], axis=1), count, seed)
        for p, (drawn, left_out) in zip(alike, draws, strict=True):
            ends = _bca(p.value, drawn, left_out, level)
            out[p.column]["rms"] = Interval(p.value, ends[0], ends[1], frames, ends[2])
    return out


@dataclass(frozen=True)
class _Power:
    """The sums of squares of a column's units."""

    column: int
    value: float
    power: Array


def _statistic(x: Array, statistic: str) -> float | None:
    if not len(x):
        return None
    if statistic == "rms":
        return float(np.sqrt(np.mean(x**2)))
    return float(np.quantile(np.abs(x) if statistic == "p95" else x, _Q[statistic]))


def frame_numbers(frame: NDArray[Any]) -> Labels:
    """Frames numbered from 0 in their order."""
    return np.unique(frame, return_inverse=True)[1].astype(np.int64)


def units_of(frame: Labels) -> Labels:
    """The unit of each value that a bootstrap draws: its frame, or a random group of frames.

    Parameters
    ----------
    frame : (n,) int array
        Numbered from 0.

    Returns
    -------
    (n,) int array
        Numbered from 0; at most `MOST_UNITS`.

    Notes
    -----
    Groups of independent frames are independent, so the same bootstrap holds; groups are random because neighbours in
    a study may be alike.
    """
    frames = int(frame.max()) + 1 if len(frame) else 0
    if frames <= MOST_UNITS:
        return frame
    return np.random.default_rng(0).permutation(frames)[frame] % MOST_UNITS


def _bca(value: float, drawn: Array, left_out: Array, level: float) -> tuple[float, float, str]:
    """Ends of the interval from resampled values and from jackknife values with one frame left out."""
    tails = np.array([(1 - level) / 2, (1 + level) / 2])
    z = stats.norm.ppf(tails)
    below = float(np.mean(drawn < value) + 0.5 * np.mean(drawn == value))
    d = left_out.mean() - left_out
    spread = float(np.sum(d * d))
    method = "percentile"
    # If leaving out one frame changes nothing, or all resamples are on one side, no correction is possible.
    if 0 < below < 1 and spread > 0:
        bias, acceleration = float(stats.norm.ppf(below)), float(np.sum(d**3)) / (6.0 * spread**1.5)
        shifted = bias + z
        if np.all(1 - acceleration * shifted > 0):
            tails, method = stats.norm.cdf(bias + shifted / (1 - acceleration * shifted)), "BCa"
    low, high = np.quantile(drawn, tails)
    return float(low), float(high), method


def _rms_draws(power: Array, count: Array, seed: int) -> list[tuple[Array, Array]]:
    """For each column of sums of squares by unit, the resampled RMS and those with one unit left out."""
    sums = resampled_sums(np.column_stack([power, count]), seed)
    drawn = np.sqrt(sums[:, :-1] / sums[:, -1:])
    rest = np.sqrt(np.maximum(power.sum(axis=0) - power, 0.0) / (count.sum() - count)[:, None])
    return list(zip(drawn.T, rest.T, strict=True))


def _quantile_draws(x: Array, frame: Labels, statistic: str, seed: int) -> tuple[Array, Array]:
    """The resampled quantile, and those with one unit left out."""
    q, n, frames = _Q[statistic], len(x), int(frame.max()) + 1
    if statistic == "p95":
        x = np.abs(x)
    if frames == n:
        ordered = np.sort(x)
        place, part = divmod(q * (n - 1), 1.0)
        u, v = _order_draws(n, int(place), seed)
        drawn = (1 - part) * ordered[(u * n).astype(np.int64)] + part * ordered[(v * n).astype(np.int64)]
        return drawn, _left_out_one(ordered, q)
    order = np.argsort(x, kind="stable")
    ordered, owner = x[order], units_of(frame)[order]
    return _resampled_quantile(ordered, owner, q, seed), _left_out_quantile(ordered, owner, q)


@lru_cache(maxsize=32)
def _order_draws(n: int, j: int, seed: int) -> tuple[Array, Array]:
    """Draws of the j-th (from 0) of n ordered uniform numbers, and of the next one."""
    generator = np.random.default_rng(seed)
    u = generator.beta(j + 1, n - j, _RESAMPLES)
    rest = n - j - 1
    v = 1 - (1 - u) * generator.random(_RESAMPLES) ** (1.0 / rest) if rest else u
    # Numbers are below one, so that they give an index below n.
    top = np.nextafter(1.0, 0.0)
    return np.minimum(u, top), np.minimum(v, top)


def _resampled_quantile(ordered: Array, owner: Labels, q: float, seed: int) -> Array:
    """The quantile of resamples of whole frames."""
    n, count = len(ordered), np.bincount(owner)
    # Only values with ranks near the quantile's can become it: within eight standard deviations of the number below it,
    # for fully correlated values of a frame. Values below are only counted, frame by frame.
    half = int(8 * math.sqrt(n * q * (1 - q) * count.max())) + 8
    start, stop = max(0, int(q * (n - 1)) - half), min(n, int(q * (n - 1)) + half)
    below = np.bincount(owner[:start], minlength=len(count))
    near, out = ordered[start:stop], []
    for weight in _weights(len(count), seed):
        total = (weight @ below)[:, None] + np.cumsum(weight[:, owner[start:stop]], axis=1)
        place = q * (weight @ count - 1)
        low = np.floor(place)
        # The first value whose rank exceeds the target rank, or the last value.
        a, b = (near[np.minimum(np.sum(total <= k[:, None], axis=1), len(near) - 1)] for k in (low, np.ceil(place)))
        out.append(a + (place - low) * (b - a))
    return np.concatenate(out)


def _left_out_one(ordered: Array, q: float) -> Array:
    """The quantile with each value left out in turn."""
    n = len(ordered)
    place = q * (n - 2)
    ends = []
    for at in (math.floor(place), math.ceil(place)):
        rest = np.full(n, ordered[at])
        rest[: at + 1] = ordered[at + 1]
        ends.append(rest)
    return np.asarray(ends[0] + (place - math.floor(place)) * (ends[1] - ends[0]))


def _left_out_quantile(ordered: Array, owner: Labels, q: float) -> Array:
    """The quantile with each frame left out in turn."""
    count = np.bincount(owner)
    # Ranks of each frame's values, ascending, padded with a rank beyond all others.
    ranks = np.full((len(count), count.max()), len(ordered))
    by_frame = np.argsort(owner, kind="stable")
    column = np.arange(len(ordered)) - np.repeat(np.cumsum(count) - count, count)
    ranks[owner[by_frame], column] = by_frame
    place = q * (len(ordered) - count - 1)
    ends = []
    for k in (np.floor(place), np.ceil(place)):
        at = k.astype(np.int64)
        for rank in ranks.T:
            at += rank <= at
        ends.append(ordered[np.minimum(at, len(ordered) - 1)])
    return np.asarray(ends[0] + (place - np.floor(place)) * (ends[1] - ends[0]))


@lru_cache(maxsize=4)
def _counts(n: int, seed: int) -> NDArray[np.uint8]:
    """Number of draws of each of n frames: (resamples, n). All statistics of the same frames share them."""
    generator, resamples, blocks = np.random.default_rng(seed), resamples_of(n), []
    step = max(1, _AT_ONCE // n)
    for start in range(0, resamples, step):
        rows = min(step, resamples - start)
        drawn = generator.integers(n, size=(rows, n)) + n * np.arange(rows)[:, None]
        times = np.bincount(drawn.ravel(), minlength=rows * n)
        blocks.append(np.minimum(times, 255).astype(np.uint8).reshape(rows, n))
    return np.concatenate(blocks)


def resamples_of(n: int) -> int:
    """Number of resamples of n frames: fewer for many frames, whose statistics are smoother."""
    return int(np.clip(20_000_000 // max(n, 1), 499, _RESAMPLES))


def _weights(n: int, seed: int) -> Iterator[Array]:
    counts = _counts(n, seed)
    step = max(1, _AT_ONCE // n)
    for start in range(0, len(counts), step):
        yield counts[start : start + step].astype(np.float64)


def draws(n: int, resamples: int, seed: int = 0) -> Iterator[Labels]:
    """Numbers (some, n) of values drawn with replacement, a block of resamples after another."""
    generator, step = np.random.default_rng(seed), max(1, _AT_ONCE // max(n, 1))
    for start in range(0, resamples, step):
        yield generator.integers(0, n, size=(min(step, resamples - start), n))


def resampled_sums(values: Array, seed: int = 0) -> Array:
    """Sums (resamples, columns) over frames (n, columns) drawn with replacement."""
    return np.concatenate([weight @ values for weight in _weights(len(values), seed)])


def wilson_interval(successes: float, n: float, *, level: float = LEVEL) -> Interval:
    """Wilson's score interval of a rate, valid also at 0 and 1, where the Wald interval has no width.

    Source: E. B. Wilson, JASA 22 (1927). Non-integer numbers are effective sample sizes (`rate_interval`).
    """
    if n == 0:
        return Interval(None, None, None, 0, "no samples")
    z = float(stats.norm.ppf((1 + level) / 2))
    rate = successes / n
    middle = (rate + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(rate * (1 - rate) / n + z * z / (4 * n * n))
    # At 0 and 1 one end is the rate itself, which rounding would miss by 1e-17.
    low, high = (0.0 if successes == 0 else middle - half), (1.0 if successes == n else middle + half)
    return Interval(rate, low, high, round(n), "Wilson")


def rate_interval(success: ArrayLike, clusters: ArrayLike, *, level: float = LEVEL) -> Interval:
    """Wilson's interval of a rate whose outcomes are clustered by frame.

    Parameters
    ----------
    success : (n,) array_like of bool
    clusters : (n,) array_like of int
        Frame of each outcome.
    level : float

    Notes
    -----
    Outcomes of one frame are correlated: their number is divided by the design effect, the variance of the rate between
    frames over that of the same number of independent outcomes, at least one. If all outcomes are equal, the variance
    gives no information, and a frame counts once. Source: J. N. K. Rao and A. J. Scott, Biometrics 48 (1992).
    """
    hit = np.asarray(success, dtype=bool)
    n = len(hit)
    if not n:
        return Interval(None, None, None, 0, "no samples")
    frame = np.unique(np.asarray(clusters), return_inverse=True)[1]
    count = np.bincount(frame).astype(np.float64)
    frames, rate = len(count), float(hit.mean())
    effect = 1.0
    if frames < n:
        effect = n / frames
        if 0 < rate < 1 and frames > 1:
            residual = np.bincount(frame, hit) - rate * count
            variance = frames / (frames - 1) * float(np.sum(residual**2)) / n**2
            effect = max(1.0, variance / (rate * (1 - rate) / n))
    found = wilson_interval(rate * n / effect, n / effect, level=level)
    # The exact rate, without the rounding of the effective numbers.
    return Interval(rate, found.low, found.high, frames, "Wilson")


def holm(p_values: ArrayLike) -> Array:
    """p-values adjusted for a family: rejecting those below alpha keeps the family-wise error below alpha.

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
