"""Error over the levels of one nuisance, on the same frames, and the level at which it doubles.

Every level has the same frames, so levels are compared in pairs: resampling draws frames, each with all its levels.
A frame's error is divided by its own Cramer-Rao bound at the reference level, where the nuisance is mildest, because
frames differ in difficulty much more than the levels of most nuisances do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.datasets.layout.sweeps import level_numbers
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.metrics.metric import NORMAL, POSITION, REPROJECTION, Metric
from roundel.validate.metrics.rows import Rows, column, flag_column, those, where_text
from roundel.validate.metrics.uncertainty import percentile_of
from roundel.validate.scores.summary import CHESSBOARD, run_keys, run_rows
from roundel.validate.statistics.intervals import Interval, draws, rate_interval, wilson_interval

Array = NDArray[np.float64]

BOUND, CHI2 = NORMAL.bound, "oracle_pose_chi2"
REGION = 0.95  # the stated region whose coverage is given
# Errors that are drawn beside that of the normal.
BESIDE = (POSITION, REPROJECTION)
MIN_FRAMES = 10  # per level: with fewer, the median's interval is too wide to draw
_RESAMPLES = 2000

# Displayed names and units of swept keys; other keys are displayed as they are.
TITLES: dict[str, tuple[str, str]] = {
    "sensor.full_well_e": ("Full well", "electrons"),
    "sensor.exposure_e": ("Exposure of white", "electrons"),
    "sensor.exposure_ph": ("Exposure of white", "photons"),
    "sensor.read_noise_e": ("Read noise", "electrons"),
    "sensor.gain_dn_per_e": ("Gain", "DN/electron"),
    "sensor.bits": ("Bits", ""),
    "sensor.curve": ("Response curve", ""),
    "sensor.gamma": ("Gamma", ""),
    "sensor.isp": ("Processing", ""),
    "sensor.white_level": ("White paper over the full well", ""),
    "sensor.isp.sharpen_amount": ("Sharpening", ""),
    "camera.f_number": ("F-number", ""),
    "camera.distortion.0": ("Radial distortion k1", ""),
    "camera.barrel_mm": ("Diameter of the lens barrel", "mm"),
    "camera.lateral_ca.0": ("Magnification of red", ""),
    "marker.edge_softness_m": ("Width of the ink's edge", "m"),
    "marker.grain": ("Grain of the paper", "RMS"),
    "marker.surface.roughness": ("Roughness of the gloss", ""),
    "sensor.jpeg_quality": ("JPEG quality", ""),
    "light.environment": ("Radiance of the surroundings", ""),
    "motion.exposure_s": ("Exposure of a turning camera", "s"),
    "motion.readout_s": ("Readout of a rolling shutter", "s"),
    "occluders.0.x_m": ("Position of the occluder's centre", "m"),
    "pose.offset_x_px": ("Offset from the image's centre", "px"),
}


@dataclass(frozen=True)
class Doubling:
    """The level at which an error is twice its value at the reference level.

    Attributes
    ----------
    level : float or None
        Interpolated between levels, in the logarithm of the error; None if it never doubles.
    low, high : float or None
        95 % interval over frames; None if more than 2.5 % of the resamples never double on that side.
    share : float
        Share of the resamples in which the error doubles.
    """

    level: float | None
    low: float | None
    high: float | None
    share: float


@dataclass(frozen=True)
class Curve:
    """One run over the levels: median over frames, failures counted as infinite errors, and its 95 % interval.

    Attributes
    ----------
    median, low, high : (levels,) arrays
        Of the normal's error over the frame's own bound at the reference level; in degrees if there is no bound.
    bound : (levels,) array
        The bound at each level, in the same unit: median over frames.
    median_deg : (levels,) array
        Median of the error in degrees.
    relative : bool
        Whether the unit is the bound.
    coverage : list of Interval
        At each level, the share of truths within the 95 % region that the run states, of the poses with a covariance.
    beside : dict of (3, levels) array
        Median, low and high of the errors of `BESIDE`, by the metric's column, in its unit.
    """

    method: str
    intrinsics: str
    median: Array
    low: Array
    high: Array
    bound: Array
    median_deg: Array
    relative: bool
    solved: list[int]
    frames: list[int]
    doubling: Doubling
    coverage: list[Interval]
    beside: dict[str, Array]


@dataclass(frozen=True)
class Sweep:
    """A swept key with its levels in the study's order, its reference level for doubling, and its curves.

    `words` has the levels of a key that takes words, such as a response curve; its `levels` are their positions.
    """

    group: str
    key: str
    title: str
    unit: str
    levels: list[float]
    words: list[str]
    reference: int
    curves: list[Curve]


def sweeps_of(table: Rows, study: dict[str, Any]) -> list[Sweep]:
    """The sweeps of a study, from its scores.

    Parameters
    ----------
    table : Rows
        Scores, with `sweep_level` and `sweep_frame`.
    study : dict
        The resolved study.

    Returns
    -------
    list of Sweep
        Empty without a sweep. Errors are those of the normal of the better candidate, in degrees.
    """
    if "sweep_level" not in table.column_names:
        return []
    found = []
    keys = [key for key in run_keys(table) if key[2] == "truth" and key[0] != CHESSBOARD]
    keys.sort(key=lambda key: (key[0], not IntrinsicsLabel.of(key[1]).is_right))
    for name, section in (study.get("groups") or {}).items():
        swept = section.get("sweep")
        if not swept:
            continue
        levels = level_numbers(swept["levels"])
        words = [level for level in swept["levels"] if isinstance(level, str)]
        # The reference is level 0 if there is one, else the first level.
        reference = levels.index(0.0) if 0.0 in levels else 0
        curves = []
        for key in keys:
            rows = run_rows(table, key)
            curve = _curve(those(rows, where_text(rows, group=name)), key, levels, reference)
            if curve is not None:
                curves.append(curve)
        if curves:
            title, unit = TITLES.get(swept["key"], (swept["key"], ""))
            found.append(Sweep(name, swept["key"], title, unit, levels, words, reference, curves))
    return found


def _curve(table: Rows, key: tuple[str, str, str], levels: list[float], reference: int) -> Curve | None:
    frame, level = column(table, "sweep_frame"), column(table, "sweep_level")
    solved = flag_column(table, "solved")
    frames = np.unique(frame[np.isfinite(frame)])

    def worst_of(metric: Metric) -> Array:
        error = column(table, metric.oracle)
        # A frame is represented by its worst circle.
        return _by_frame(np.where(solved & np.isfinite(error), error, math.inf), frame, level, frames, levels)

    worst, bounds = worst_of(NORMAL), _by_frame(column(table, BOUND), frame, level, frames, levels)
    complete = ~np.isnan(worst).any(axis=1)
    worst, bounds = worst[complete], bounds[complete]
    if len(worst) < MIN_FRAMES:
        return None
    unit = bounds[:, reference]
    relative = bool((np.isfinite(unit) & (unit > 0)).all())
    scaled = worst / unit[:, None] if relative else worst
    medians = _resampled_medians(scaled)
    median, low, high = _with_interval(scaled, medians)
    others = {metric.column: worst_of(metric)[complete] for metric in BESIDE}
    return Curve(
        key[0],
        key[1],
        median,
        low,
        high,
        np.median(bounds / unit[:, None] if relative else bounds, axis=0),
        _middle(worst, axis=0),
        relative,
        [int(solved[level == value].sum()) for value in levels],
        [int((level == value).sum()) for value in levels],
        _doubling(medians, median, levels, reference),
        _coverage(table, level, levels),
        {name: _with_interval(values, _resampled_medians(values)) for name, values in others.items()},
    )


def _with_interval(values: Array, medians: Array) -> Array:
    """Median of frames (n, levels), and its 95 % interval from the medians of resamples: (3, levels)."""
    low, high = np.quantile(medians, [0.025, 0.975], axis=0, method="inverted_cdf")
    return np.stack([_middle(values, axis=0), low, high])


def _coverage(table: Rows, level: Array, levels: list[float]) -> list[Interval]:
    stated = CHI2 in table.column_names
    chi2 = column(table, CHI2) if stated else np.full(table.num_rows, np.nan)
    frame, known = column(table, "sweep_frame"), np.isfinite(chi2)
    at = [known & (level == value) for value in levels]
    return [rate_interval(percentile_of(chi2[rows]) <= REGION, frame[rows]) for rows in at]


def _by_frame(values: Array, frame: Array, level: Array, frames: Array, levels: list[float]) -> Array:
    """Largest value of each frame at each level (frames, levels); NaN if there is none."""
    out = np.full((len(frames), len(levels)), np.nan)
    for i, value in enumerate(levels):
        rows = np.flatnonzero(level == value)
        np.fmax.at(out[:, i], np.searchsorted(frames, frame[rows]), values[rows])
    return out


def _resampled_medians(values: Array) -> Array:
    """Medians (resamples, levels) of frames (n, levels) drawn with replacement."""
    return np.concatenate([_middle(values[drawn], axis=1) for drawn in draws(len(values), _RESAMPLES)])


def _middle(values: Array, axis: int) -> Array:
    """Median of values that may be infinite; averaging the two middle values would be infinite if one of them is."""
    return np.asarray(np.quantile(values, 0.5, axis=axis, method="inverted_cdf"))


def _doubling(medians: Array, median: Array, levels: list[float], reference: int) -> Doubling:
    best = crossing(levels, median, reference)
    found = [crossing(levels, m, reference) for m in medians]
    known = [level for level in found if level is not None]
    share = len(known) / len(found)
    if best is None:
        return Doubling(None, None, None, share)
    # Resamples that never double are placed beyond the last level, on the side on which the nuisance grows.
    grows = max(levels, key=lambda v: abs(levels.index(v) - reference)) > levels[reference]
    filled = np.array([(math.inf if grows else -math.inf) if v is None else v for v in found])
    low, high = np.quantile(filled, [0.025, 0.975], method="inverted_cdf").tolist()
    low, high = (v if math.isfinite(v) else None for v in (low, high))
    return Doubling(best, low, high, share)


def crossing(levels: list[float], values: Array, reference: int, factor: float = 2.0) -> float | None:
    """The level nearest to the reference at which a curve first reaches `factor` times its value there.

    Interpolated linearly in the logarithm of the value, and of the level if levels span a decade without zero. A curve
    that jumps to infinity crosses at the level of the jump.
    """
    if not (0 < values[reference] < math.inf):
        return None
    target = factor * values[reference]
    logarithmic = is_logarithmic(levels)
    found = []
    for step in (1, -1):
        for i in range(reference + step, len(levels) if step > 0 else -1, step):
            if not values[i] >= target:
                continue
            a, b = (math.log(levels[k]) if logarithmic else levels[k] for k in (i - step, i))
            if not math.isfinite(values[i]):
                found.append((i, levels[i]))
            else:
                low = math.log(values[i - step])
                t = (math.log(target) - low) / (math.log(values[i]) - low)
                found.append((i, math.exp(a + t * (b - a)) if logarithmic else a + t * (b - a)))
            break
    return min(found, key=lambda f: abs(f[0] - reference))[1] if found else None


def is_logarithmic(values: ArrayLike) -> bool:
    """Whether values are shown and interpolated on a logarithmic scale: all positive, over a decade or more."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    return bool(known.min() > 0 and known.max() >= 10 * known.min())


def sweep_summary(sweeps: list[Sweep]) -> list[dict[str, Any]]:
    """Sweeps as plain values for summary.json; infinite medians are None."""

    def plain(values: Array) -> list[float | None]:
        return [float(v) if math.isfinite(v) else None for v in values]

    out = []
    for sweep in sweeps:
        curves = []
        for c in sweep.curves:
            rates = [wilson_interval(s, n) for s, n in zip(c.solved, c.frames, strict=True)]
            curves.append(
                {
                    "method": c.method,
                    "intrinsics": c.intrinsics,
                    "unit": "bounds" if c.relative else "deg",
                    "normal_median": plain(c.median),
                    "normal_median_low": plain(c.low),
                    "normal_median_high": plain(c.high),
                    "normal_bound": plain(c.bound),
                    "normal_median_deg": plain(c.median_deg),
                    "solved": c.solved,
                    "frames": c.frames,
                    "solved_rate_low": [r.low for r in rates],
                    "solved_rate_high": [r.high for r in rates],
                    "doubling": vars(c.doubling),
                    "coverage": [r.value for r in c.coverage],
                    "coverage_low": [r.low for r in c.coverage],
                    "coverage_high": [r.high for r in c.coverage],
                    **{
                        f"{metric.name}_median{end}": plain(values)
                        for metric in BESIDE
                        for end, values in zip(("", "_low", "_high"), c.beside[metric.column], strict=True)
                    },
                }
            )
        facts = {"group": sweep.group, "key": sweep.key, "title": sweep.title, "unit": sweep.unit, "words": sweep.words}
        out.append({**facts, "levels": sweep.levels, "reference": sweep.levels[sweep.reference], "curves": curves})
    return out
