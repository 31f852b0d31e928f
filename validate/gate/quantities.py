"""What the gate compares: errors, columns, and the smallest loss of each that counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.validate.metrics import metric
from roundel.validate.metrics.metric import Metric

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ALPHA = 0.005  # chance of any false alarm in all questions together
MIN_CIRCLES = 30  # with fewer there is no verdict
RELATIVE_FLOOR = 0.02
RATE_FLOOR = 0.002
# The logarithmic score of the stated covariance: a factor of 0.8 or 1.25 on all covariances costs 0.06.
SCORE_FLOOR = 0.02
# Of the share of truths in a region; each is what standard deviations do that are wrong by 5 %.
COVERAGE_FLOORS = {0.95: 0.02, 0.5: 0.05}
# Standard deviations that are stated larger by this fraction, without need.
SHARPNESS_FLOOR = 0.05
# Of the mean squared difference between confidence and outcome: one detection in 500 that is surely wrong.
BRIER_FLOOR = 0.002


@dataclass(frozen=True)
class Quantity:
    """An error that the gate checks, and the smallest loss, in its unit, that counts."""

    metric: Metric
    floor: float

    @property
    def column(self) -> str:
        """Column of scores.parquet."""
        return self.metric.oracle

    @property
    def bound(self) -> str | None:
        """Column of the error's bound; None if the error is in units of its bound, or has no bound."""
        return self.metric.bound or None

    @property
    def title(self) -> str:
        """Name within a sentence."""
        return self.metric.words

    @property
    def unit(self) -> str:
        """Unit of the error."""
        return self.metric.unit

    @property
    def of_pose(self) -> bool:
        """Whether a pose has it, and not the ellipse that both solutions share."""
        return self.metric.of == "pose"


POSE = Quantity(metric.POSE, 0.001)
QUANTITIES = (POSE, Quantity(metric.NORMAL, 0.001), Quantity(metric.POSITION_M, 1e-6), Quantity(metric.CONTOUR, 0.0005))
SHIFTS = (Quantity(metric.SHIFT_X, 0.002), Quantity(metric.SHIFT_Y, 0.002))

# Columns of scores.parquet beside the errors.
SCORE, CHI2 = "oracle_pose_log_score", "oracle_pose_chi2"
CHOICE = ("likelier_probability", "likelier_correct")
BRANCH, ORACLE_BRANCH = "branch_correct", "oracle_branch_correct"
DETECTED, CONFIDENCE = "detected", "confidence"


def flags(rows: pa.Table, name: str) -> Flags:
    """A column of booleans; null is false."""
    return np.asarray(rows[name].fill_null(False).to_numpy(zero_copy_only=False), dtype=bool)


def floats(rows: pa.Table, name: str) -> Array:
    """A column of numbers or booleans; nulls are NaN."""
    column = rows[name]
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.int8())
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


def there(name: str, *tables: pa.Table) -> bool:
    """Whether all tables have a column; those of older versions lack some."""
    return all(name in table.column_names for table in tables)


def beside_truth(rows: pa.Table) -> Flags:
    """Whether each pose may be held against the truth: false for a pose beside the circle's second solution.

    A baseline of an older version does not tell a method's only pose from a choice of two: there a wrong choice counts
    as such a pose.
    """
    name = ORACLE_BRANCH if there(ORACLE_BRANCH, rows) else BRANCH
    return np.asarray(floats(rows, name) != 0)


def groups_of(rows: pa.Table) -> NDArray[np.str_]:
    """The group of each circle."""
    return np.array(rows["group"].to_pylist(), dtype=np.str_)
