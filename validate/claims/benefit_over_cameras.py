"""Benefit of a calibration over several cameras: each report is one camera, each calibration of it one set of views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.claims.calibration_benefit import ERRORS
from roundel.validate.metrics.metric import Metric
from roundel.validate.metrics.rows import Rows, circle_keys, placed, texts_of, those, where_text
from roundel.validate.scores.summary import CHESSBOARD
from roundel.validate.statistics.intervals import Interval
from roundel.validate.statistics.nested import CameraErrors, nested_factor

Array = NDArray[np.float64]

# Of single pairs of a camera and a set: four of five lie between.
SPREAD = (10.0, 90.0)
# A camera of fewer circles has no median worth the name.
MIN_CIRCLES = 5


@dataclass(frozen=True)
class BenefitOverCameras:
    """The factor by which a calibration divides the median error, over cameras.

    Attributes
    ----------
    error : Metric
    without : str
        Label of the assumed intrinsics.
    views : int or None
        Number of views of each calibration; None if the labels do not say.
    cameras, sets : int
        Numbers of cameras, and of calibrations of all of them.
    factor : Interval
        See `nested_factor`.
    low, high : float
        Factors of single cameras and sets, at `SPREAD`.
    """

    error: Metric
    without: str
    views: int | None
    cameras: int
    sets: int
    factor: Interval
    low: float
    high: float


def benefit_over_cameras(reports: Sequence[Rows]) -> list[BenefitOverCameras]:
    """The benefit for each error, each assumed intrinsics that all cameras share, and each number of views.

    Parameters
    ----------
    reports : sequence of Rows
        Scores of each camera. Cameras without a calibration, or without the assumed intrinsics, are left out.
    """
    runs = [by_label for rows in reports if (by_label := _runs(rows))]
    if len(runs) < 2:
        return []
    shared = set.intersection(*(set(run) for run in runs))
    assumed = [
        x for x in sorted(shared, key=lambda x: IntrinsicsLabel.of(x).rank) if not IntrinsicsLabel.of(x).is_right
    ]
    counts = sorted({_views(x) for run in runs for x in run if x.startswith("calibrated:")}, key=lambda n: n or 0)
    out = []
    for error in ERRORS:
        for without in assumed:
            for views in counts:
                cameras = [c for run in runs if (c := camera_errors(run, error, without, views)) is not None]
                if len(cameras) < 2:
                    continue
                single = np.concatenate([camera.factors for camera in cameras])
                low, high = np.percentile(single, SPREAD).tolist()
                found = nested_factor(cameras)
                out.append(BenefitOverCameras(error, without, views, len(cameras), len(single), found, low, high))
    return out


def camera_errors(runs: dict[str, Rows], error: Metric, without: str, views: int | None) -> CameraErrors | None:
    """Errors of one camera's circles that every run solved; None if there are too few, or no such calibration.

    Parameters
    ----------
    runs : dict
        Scores by label of the intrinsics.
    error : Metric
    without : str
        Label of the assumed intrinsics.
    views : int or None
        See `BenefitOverCameras.views`.
    """
    sets = [label for label in runs if label.startswith("calibrated:") and _views(label) == views]
    if not sets or without not in runs:
        return None
    keys = circle_keys(runs[without])
    errors = np.array([placed(error.values(runs[x]), circle_keys(runs[x]), keys) for x in (without, *sorted(sets))])
    errors = errors[:, np.isfinite(errors).all(axis=0)]
    # Without noise an error may be nothing at all, and a ratio to it says nothing.
    if errors.shape[1] < MIN_CIRCLES or not np.all(np.median(errors, axis=1) > 0):
        return None
    return CameraErrors(errors[0], errors[1:])


def _views(label: str) -> int | None:
    return IntrinsicsLabel.of(label).views_of_set


def _runs(rows: Rows) -> dict[str, Rows]:
    """Runs by intrinsics, of the first method with a calibration; empty if there is none."""
    truth = those(rows, where_text(rows, reference="truth"))
    for method in texts_of(truth, "method"):
        if method == CHESSBOARD:
            continue
        mine = those(truth, where_text(truth, method=method))
        labels = texts_of(mine, "intrinsics")
        if any(label.startswith("calibrated:") for label in labels):
            return {label: those(mine, where_text(mine, intrinsics=label)) for label in labels}
    return {}
