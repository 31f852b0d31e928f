"""Benefit of a calibration: errors with and without it on the same frames.

This is the paper's question. Its experiments keep the marker on the optical axis, where the normal does not depend on
the focal length at all (errata, section 5). Frames off the axis are the general case, so both are reported separately.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.claims.conditions import ON_AXIS_DEG
from roundel.validate.metrics.metric import HEADLINE
from roundel.validate.metrics.rows import Rows, circle_keys, column, placed, texts_of, those, where_text
from roundel.validate.scores.summary import CHESSBOARD, levels
from roundel.validate.statistics.intervals import LEVEL, MIN_SAMPLES, Interval, bootstrap_interval, draws, resamples_of

Array = NDArray[np.float64]

# A calibration is called beneficial if it reduces the median error by more than this factor.
FACTOR = 2.0
_MIN_PART = 30
_MIN_BIN, _MAX_BINS = 14, 9
_RESAMPLES = 1999
# Lower limit of the denominator, for points without noise: the ratio is large but finite.
_NOTHING = 1e-9


# The errors that are compared.
ERRORS = HEADLINE


@dataclass(frozen=True)
class Panel:
    """Circles of one part of the image, in bins of one variable.

    Attributes
    ----------
    part : {"on_axis", "off_axis", "all"}
    variable : {"distance_D", "tilt_deg", "off_axis_deg"}
    bins : list of (n,) index arrays
        Rows of the circles.
    low, high, middle : (bins,) arrays
        Extremes and median of the variable in each bin.
    gains : dict
        By the error's name: `error_ratio` of each bin.
    """

    part: str
    variable: str
    bins: list[NDArray[np.int64]]
    low: Array
    high: Array
    middle: Array
    gains: dict[str, list[Interval]] = field(default_factory=dict)


@dataclass(frozen=True)
class CalibrationBenefit:
    """Errors of every kind of intrinsics on the same circles, and the benefit of calibration.

    Attributes
    ----------
    method, calibrated, uncalibrated : str
        The method, and the two labels that are compared: the calibration from the fewest views, and the default.
    labels : list of str
        All kinds of intrinsics, the best known first.
    errors : dict
        By the error's name and label: (circles,) arrays, NaN if not solved. `chessboard` is the pose by solvePnP.
    panels : list of Panel
    on_axis, off_axis : index arrays
    """

    method: str
    calibrated: str
    uncalibrated: str
    labels: list[str]
    errors: dict[str, dict[str, Array]]
    panels: list[Panel]
    on_axis: NDArray[np.int64]
    off_axis: NDArray[np.int64]


BOARD = "chessboard"


def off_axis_deg(truth: pa.Table) -> pa.Table:
    """`off_axis_deg`, the angle between the line of sight to a circle's centre and the optical axis, of each circle."""
    x, y, z = (column(truth, f"centre_{a}_m") for a in "xyz")
    angle = np.degrees(np.arctan2(np.hypot(x, y), z))
    return pa.table({"frame_id": truth["frame_id"], "marker_id": truth["marker_id"], "off_axis_deg": angle})


def calibration_benefit(table: Rows, offset: Rows | None, board: Rows | None = None) -> CalibrationBenefit | None:
    """The benefit of calibration, from a table of scores.

    Parameters
    ----------
    table : Rows
        Rows of scores.parquet; only those against the truth are used.
    offset : Rows or None
        From `off_axis_deg`; None if no run is calibrated.
    board : Rows, optional
        Scores of the same circles with the poses given by the chessboard beside them.

    Returns
    -------
    CalibrationBenefit or None
        None if no method has both calibrated and uncalibrated intrinsics.
    """
    truth = those(table, where_text(table, reference="truth"))
    for method in texts_of(truth, "method"):
        if method == CHESSBOARD or offset is None:
            continue
        part = those(truth, where_text(truth, method=method))
        labels = sorted(texts_of(part, "intrinsics"), key=lambda label: IntrinsicsLabel.of(label).rank)
        pair = _pair(labels)
        if pair is not None:
            return _worth(method, *pair, labels, part, offset, board)
    return None


def _pair(labels: list[str]) -> tuple[str, str] | None:
    """The calibration from the fewest views, and the intrinsics used without a calibration."""
    calibrated = [label for label in labels if label.startswith("calibrated:")]
    wrong = [label for label in labels if not IntrinsicsLabel.of(label).is_right and label != "exif"] or [
        x for x in labels if x == "exif"
    ]
    if not calibrated or not wrong:
        return None
    fewest = min(calibrated, key=lambda x: IntrinsicsLabel.of(x).views or 10**9)
    return fewest, "default" if "default" in wrong else wrong[0]


def _worth(
    method: str,
    calibrated: str,
    uncalibrated: str,
    labels: list[str],
    part: Rows,
    offsets: Rows,
    board: Rows | None,
) -> CalibrationBenefit:
    runs = {label: those(part, where_text(part, intrinsics=label)) for label in labels}
    first = runs[calibrated]
    keys = circle_keys(first)
    if board is not None and board.num_rows:
        runs[BOARD] = board
    errors: dict[str, dict[str, Array]] = {error.name: {} for error in ERRORS}
    for label, rows in runs.items():
        of = circle_keys(rows)
        for error in ERRORS:
            errors[error.name][label] = placed(error.values(rows), of, keys)
    offset = placed(column(offsets, "off_axis_deg"), circle_keys(offsets), keys)
    variables = {name: column(first, name) for name in ("distance_D", "tilt_deg")}
    near, far = np.flatnonzero(offset <= ON_AXIS_DEG), np.flatnonzero(offset > ON_AXIS_DEG)
    parts = {"on_axis": near, "off_axis": far}
    parts = {name: rows for name, rows in parts.items() if len(rows) >= _MIN_PART} or {"all": np.arange(len(keys))}
    panels = [_panel(p, name, variables[name], rows) for name in variables for p, rows in parts.items()]
    panels.append(_panel("all", "off_axis_deg", offset, np.flatnonzero(np.isfinite(offset))))
    benefit = CalibrationBenefit(method, calibrated, uncalibrated, labels, errors, panels, near, far)
    for panel in panels:
        panel.gains.update({e.name: [error_ratio(benefit, e.name, rows) for rows in panel.bins] for e in ERRORS})
    return benefit


def _panel(part: str, name: str, values: Array, rows: NDArray[np.int64]) -> Panel:
    if name == "off_axis_deg":
        # All circles on the axis form one bin, whatever their number.
        near, far = rows[values[rows] <= ON_AXIS_DEG], rows[values[rows] > ON_AXIS_DEG]
        bins = [*([near] if len(near) else []), *_even(values, far)]
    else:
        grid = levels(values[rows])
        fits = grid is not None and len(grid) <= _MAX_BINS
        bins = (
            [rows[np.round(values[rows], 6) == v] for v in grid] if fits and grid is not None else _even(values, rows)
        )
    spread = np.array([[values[b].min(), values[b].max(), np.median(values[b])] for b in bins]).reshape(-1, 3)
    return Panel(part, name, bins, spread[:, 0], spread[:, 1], spread[:, 2])


def _even(values: Array, rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Bins of equally many circles."""
    count = min(_MAX_BINS, len(rows) // _MIN_BIN) or min(1, len(rows))
    order = rows[np.argsort(values[rows], kind="stable")]
    return [b for b in np.array_split(order, count) if len(b)] if count else []


def median_of(benefit: CalibrationBenefit, error: str, label: str, rows: NDArray[np.int64]) -> float | None:
    """Median error of the given circles, over those that were solved."""
    values = benefit.errors[error][label][rows]
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def level_of(benefit: CalibrationBenefit, error: str, label: str, rows: NDArray[np.int64]) -> Interval:
    """Median error of the given circles with its interval."""
    return bootstrap_interval(benefit.errors[error][label][rows], "median", level=LEVEL)


def error_ratio(
    benefit: CalibrationBenefit, error: str, rows: NDArray[np.int64], uncalibrated: str | None = None
) -> Interval:
    """Median error without calibration over that with it, with a paired bootstrap interval.

    Parameters
    ----------
    benefit : CalibrationBenefit
    error : str
    rows : index array
        Circles; those that are not solved with both are left out.
    uncalibrated : str, optional
        Another label to compare with `calibrated`.
    """
    a = benefit.errors[error][uncalibrated or benefit.uncalibrated][rows]
    b = benefit.errors[error][benefit.calibrated][rows]
    both = np.isfinite(a) & np.isfinite(b)
    a, b = a[both], b[both]
    if not len(a):
        return Interval(None, None, None, 0, "no samples")
    value = float(np.median(a) / max(float(np.median(b)), _NOTHING))
    if len(a) < MIN_SAMPLES["median"]:
        return Interval(value, None, None, len(a), f"fewer than {MIN_SAMPLES['median']} samples")
    ratios = [
        np.median(a[drawn], axis=1) / np.maximum(np.median(b[drawn], axis=1), _NOTHING)
        for drawn in draws(len(a), min(_RESAMPLES, resamples_of(len(a))))
    ]
    low, high = np.percentile(np.concatenate(ratios), [50 - 50 * LEVEL, 50 + 50 * LEVEL])
    return Interval(value, float(low), float(high), len(a), "percentile, paired")


def verdict_of(gain: Interval, factor: float = FACTOR) -> str:
    """`yes` if the interval is above the factor, `no` if it is below, else `open`."""
    if gain.low is None or gain.high is None:
        return "open"
    return "yes" if gain.low > factor else "no" if gain.high < factor else "open"
