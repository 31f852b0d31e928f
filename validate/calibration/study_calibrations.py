"""Calibrations of one camera from different numbers of views, each judged against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.store.addresses import Address
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.scenes.errors import NotComparableError
from roundel.scenes.study.schema import SolveSection
from roundel.validate.calibration.camera_errors import (
    ProjectionDifference,
    calibration_errors,
    calibration_summary,
    projection_difference,
    write_calibration,
)
from roundel.validate.calibration.opencv import (
    BoardView,
    calibrate_views,
    calibration_group,
    first_views,
    look_for_boards,
)
from roundel.validate.metrics.ground_truth import frame_cameras

# Number of random subsets of views, to show the scatter of calibrations from few views: half a second in OpenCV.
SUBSETS = 10


@dataclass(frozen=True)
class Calibrations:
    """Calibrations from the first N views, and from random subsets of N views.

    Attributes
    ----------
    records : list of dict
        As `calibration_summary`, with `label`; fewest views first.
    differences : list of ProjectionDifference
        Of each record, if there is a single true camera; else empty.
    subsets : list of dict
        `views`, `rms_px` and the keys of `calibration_errors`, one per subset.
    """

    records: list[dict[str, Any]]
    differences: list[ProjectionDifference]
    subsets: list[dict[str, Any]]


def calibrate_study(
    dataset_path: Address, solve: SolveSection, camera_path: Path, folder: Path
) -> tuple[list[dict[str, Any]], dict[str, Path]]:
    """The camera files required by a study's intrinsics; the boards are detected once.

    Parameters
    ----------
    dataset_path : path
    solve : SolveSection
        Its `calibrate_from` is a group of chessboards.
    camera_path : path
        Camera file from all views: used by `calibrated`, and for the reference pose from the chessboard.
    folder : path
        Folder in which `calibrated:5` becomes `5.json`; the file's stem is the label of the estimates.

    Returns
    -------
    records : list of dict
        As `calibration_summary`, the camera from all views first.
    files : dict
        Camera file of each of the study's labels.
    """
    dataset = open_dataset(dataset_path)
    group = calibration_group(dataset.images, solve.calibrate_from)
    views = look_for_boards(dataset.images, group)
    records = [write_calibration(dataset, views, camera_path, group)]
    files = {"calibrated": camera_path}
    for label in solve.intrinsics:
        count = IntrinsicsLabel.of(label).views
        if count is not None:
            files[label] = folder / f"{count}.json"
            records.append(write_calibration(dataset, first_views(views, count), files[label], group))
    return records, files


def several_calibrations(dataset: Dataset, views: list[BoardView], labels: Sequence[str]) -> Calibrations | None:
    """Compute the calibrations named by labels such as `calibrated:5` from the views, and their errors.

    Parameters
    ----------
    dataset : Dataset
    views : list of BoardView
        Views of the calibration group, in its order.
    labels : sequence of str
        A study's intrinsics.

    Returns
    -------
    Calibrations or None
        None if no label gives a number of views; failed calibrations are left out.
    """
    counts = sorted({n for label in labels if (n := IntrinsicsLabel.of(label).views) is not None and n <= len(views)})
    if not counts:
        return None
    index, cameras = frame_cameras(dataset)
    used = {index[view.frame_id] for view in views}
    truth = cameras[used.pop()] if len(used) == 1 else None
    records, differences = [], []
    for count in counts:
        try:
            calibration = calibrate_views(first_views(views, count))
        except NotComparableError:
            continue
        summary = calibration_summary(dataset, first_views(views, count), calibration)
        records.append({"label": f"calibrated:{count}", **summary})
        if truth is not None:
            differences.append(projection_difference(calibration.camera, truth))
    subsets = []
    found = [view for view in views if view.corners_px is not None]
    if truth is not None and records:
        rng = np.random.default_rng(0)
        for count in counts[:2]:
            # Subsets of almost all views would be nearly identical.
            for _ in range(SUBSETS if 2 * count <= len(found) else 0):
                chosen = np.sort(rng.choice(len(found), count, replace=False))
                calibration = calibrate_views([found[i] for i in chosen.tolist()])
                errors = calibration_errors(calibration.camera, truth)
                subsets.append({"views": count, "rms_px": calibration.rms_px, **errors})
    return Calibrations(records, differences, subsets) if records else None


def spread_in_words(subsets: list[dict[str, Any]]) -> list[str]:
    """Sentences on the scatter of calibrations from few views, one per number of views."""
    lines = []
    for count in sorted({subset["views"] for subset in subsets}):
        mine = [s for s in subsets if s["views"] == count]
        errors = np.array([s.get("fx_error_pct", np.nan) for s in mine])
        rms = np.array([s["rms_px"] for s in mine])
        mean = np.array([s["projection_mean_rotated_px"] for s in mine])
        text = f"{len(mine)} random subsets of {count} views: residual RMS {rms.min():.3f} to {rms.max():.3f} px"
        if np.isfinite(errors).all():
            text += f", fx off by {errors.min():+.3f} to {errors.max():+.3f} %"
        lines.append(f"{text}, mean projection error {mean.min():.3f} to {mean.max():.3f} px.")
    return lines
