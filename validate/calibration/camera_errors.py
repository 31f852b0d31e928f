"""Errors of a calibrated camera against the true one.

The RMS of a calibration measures how well the model fits its own corners, not the accuracy of the camera. It is
therefore reported with the errors of the parameters and the difference of projection over the whole image (mrcal,
"Projection uncertainty").
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset, open_dataset
from roundel.datasets.store.addresses import Address
from roundel.datasets.store.writing import write_file
from roundel.scenes.camera.camera_file import camera_file_text
from roundel.scenes.camera.model import Camera, project, ray_direction
from roundel.scenes.errors import NotComparableError
from roundel.solver.detect.chessboard_corners import BoardLayout, board_points_m
from roundel.validate.calibration.opencv import (
    BoardView,
    Calibration,
    calibrate_views,
    calibration_group,
    calibration_to_json,
    first_views,
    look_for_boards,
)
from roundel.validate.metrics.ground_truth import frame_cameras, poses_of, rows_of_kind

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ProjectionDifference:
    """Difference of projection between two cameras over the whole image, px.

    Attributes
    ----------
    x_px, y_px : (w,), (h,) arrays
        Columns and rows of the grid.
    plain, rotated : (h, w, 2) array
        Projection of a ray minus its true pixel, as it is and with the best-fit rotation removed; NaN if one of the
        cameras does not see the ray: a calibrated polynomial may not reach the corners.
    """

    x_px: Array
    y_px: Array
    plain: Array
    rotated: Array

    @property
    def share(self) -> float:
        """Fraction of the image's rays that both cameras see."""
        return float(np.isfinite(self.plain).all(axis=-1).mean())

    def figures(self) -> dict[str, float]:
        """Mean and maximum over the image, px, as keys of `calibration_errors`."""
        return {
            f"projection_{name}{which}_px": float(statistic(np.linalg.norm(offsets, axis=-1)))
            for which, offsets in (("", self.plain), ("_rotated", self.rotated))
            for name, statistic in (("mean", np.nanmean), ("max", np.nanmax))
        }


def projection_difference(camera: Camera, truth: Camera) -> ProjectionDifference:
    """Difference between the projections of the same ray, over a grid of the whole image.

    `rotated` has the least-squares rotation between the cameras removed (mrcal, "Differencing cameras"): a calibration
    may trade principal point for rotation, as does a pose estimated with it.
    """
    from scipy.optimize import least_squares

    u, v = np.linspace(0, truth.width_px - 1, 33), np.linspace(0, truth.height_px - 1, 19)
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays = ray_direction(truth, grid)

    def miss(rotation: Array) -> Array:
        return project(camera, rays @ cv2.Rodrigues(rotation)[0].T) - grid

    # Rays that the rotation moves out of the field do not enter the fit.
    fit = least_squares(lambda r: np.nan_to_num(miss(r)).ravel(), np.zeros(3), x_scale=1e-3)
    plain, rotated = (miss(r).reshape(len(v), len(u), 2) for r in (np.zeros(3), fit.x))
    return ProjectionDifference(u, v, plain, rotated)


def calibration_errors(camera: Camera, truth: Camera) -> dict[str, float]:
    """Errors of a calibrated camera against the true one: parameters, and projection over the whole image.

    Returns
    -------
    dict
        fx_error_pct, fy_error_pct, cx_error_px, cy_error_px, k1_error ... k3_error, projection_mean_px,
        projection_max_px, the last two with the best-fit rotation removed, and the share of the image they cover.
        Parameters are left out if the true lens has terms that the calibration lacks: each parameter then absorbs some
        of the missing terms, and none is comparable.
    """
    if (camera.width_px, camera.height_px) != (truth.width_px, truth.height_px):
        raise NotComparableError(
            f"the camera file is for {camera.width_px}x{camera.height_px} px, the dataset has "
            f"{truth.width_px}x{truth.height_px} px; calibrate with this dataset's camera"
        )
    difference = projection_difference(camera, truth)
    return {
        **_parameter_errors(camera, truth),
        **difference.figures(),
        "projection_share": difference.share,
    }


def _parameter_errors(camera: Camera, truth: Camera) -> dict[str, float]:
    names = ("k1", "k2", "p1", "p2", "k3")
    if camera.distortion_model != truth.distortion_model or truth.distortion_model != "opencv":
        return {}
    if any(truth.distortion[len(names) :]) or any(camera.distortion[len(names) :]):
        return {}
    pad = (0.0,) * len(names)
    pairs = zip(names, (camera.distortion + pad)[:5], (truth.distortion + pad)[:5], strict=True)
    return {
        "fx_error_pct": float(100 * (camera.K[0, 0] / truth.K[0, 0] - 1)),
        "fy_error_pct": float(100 * (camera.K[1, 1] / truth.K[1, 1] - 1)),
        "cx_error_px": float(camera.K[0, 2] - truth.K[0, 2]),
        "cy_error_px": float(camera.K[1, 2] - truth.K[1, 2]),
        **{f"{name}_error": float(a - b) for name, a, b in pairs},
    }


def corner_offsets_px(corners_px: Array, camera_from_board: Array, layout: BoardLayout, camera: Camera) -> Array:
    """Detected corners minus their true images (N, 2), px."""
    points = board_points_m(layout) @ camera_from_board[:3, :3].T + camera_from_board[:3, 3]
    return corners_px - project(camera, points)


def calibration_summary(dataset: Dataset, views: list[BoardView], calibration: Calibration) -> dict[str, Any]:
    """A calibration in numbers: its own residual, its corners, and its camera compared with the truth.

    The errors of the camera are left out if the views were taken by different cameras, without a single truth.
    """
    index, cameras = frame_cameras(dataset)
    used = {view.frame_id for view in views}
    truth = rows_of_kind(dataset, ("chessboard",))
    keys = zip(truth["frame_id"].to_pylist(), truth["marker_id"].to_pylist(), strict=True)
    poses = dict(zip(keys, poses_of(truth), strict=True))
    offsets = np.concatenate(
        [
            corner_offsets_px(v.corners_px, poses[v.frame_id, v.marker_id], v.layout, cameras[index[v.frame_id]])
            for v in views
            if v.corners_px is not None
        ]
    )
    camera = calibration.camera
    return {
        "group": ", ".join(dict.fromkeys(view.group for view in views)),
        "views": len(calibration.frame_ids),
        "missed_views": len(calibration.missed_frame_ids),
        "corners": len(offsets),
        "rms_px": calibration.rms_px,
        "rms_check_px": calibration.rms_check_px,
        "corner_offset_mean_x_px": float(offsets[:, 0].mean()),
        "corner_offset_mean_y_px": float(offsets[:, 1].mean()),
        "corner_offset_std_px": float(offsets.std()),
        "corner_offset_max_px": float(np.abs(offsets).max()),
        "fx_px": float(camera.K[0, 0]),
        "fy_px": float(camera.K[1, 1]),
        "cx_px": float(camera.K[0, 2]),
        "cy_px": float(camera.K[1, 2]),
        "distortion": list(camera.distortion),
        **errors_of_frames(dataset, camera, used),
    }


def errors_of_frames(dataset: Dataset, camera: Camera, frame_ids: set[int]) -> dict[str, float]:
    """`calibration_errors` against the true camera of these frames.

    Empty if they have more than one, or none: that of imported photographs was calibrated itself.
    """
    if dataset.reference is not None:
        return {}
    index, cameras = frame_cameras(dataset)
    used = {index[frame_id] for frame_id in frame_ids}
    return calibration_errors(camera, cameras[used.pop()]) if len(used) == 1 else {}


def calibrate_dataset(
    dataset_path: Address,
    camera_path: str | Path,
    group: str | None = None,
    count: int | None = None,
    coefficients: int = 4,
) -> dict[str, Any]:
    """Calibrate from a dataset's chessboards, write the camera file, and return its errors.

    Parameters
    ----------
    dataset_path : path
    camera_path : path
        The camera file to write: the camera keys of `cameras.json`, without truth.
    group : str, optional
        As `calibrate`.
    count : int, optional
        Use only the first `count` views.
    coefficients : int
        As `calibrate`.

    Returns
    -------
    dict
        As `calibration_summary`.
    """
    dataset = open_dataset(dataset_path)
    group = calibration_group(dataset.images, group)
    views = first_views(look_for_boards(dataset.images, group), count)
    return write_calibration(dataset, views, camera_path, group, coefficients)


def write_calibration(
    dataset: Dataset, views: list[BoardView], camera_path: str | Path, group: str | None, coefficients: int = 4
) -> dict[str, Any]:
    """Write the camera file of these views; returns its errors, as `calibration_summary`."""
    calibration = calibrate_views(views, coefficients)
    record = calibration_to_json(calibration, str(dataset.manifest["dataset_id"]), group)
    write_file(camera_path, camera_file_text(record, camera_path).encode())
    return calibration_summary(dataset, views, calibration)


def calibration_lines(summary: dict[str, Any]) -> list[str]:
    """A calibration as lines for the terminal."""
    if "rms_px" not in summary:
        return [f"calibration: {summary['reason']}"]
    total = summary["views"] + summary["missed_views"]
    views = f"{summary['views']} of {total} views, {summary['corners']} corners"
    return [f"calibration: {views}, RMS {summary['rms_px']:.4f} px", *error_lines(summary)]


def error_lines(summary: dict[str, Any]) -> list[str]:
    """The `calibration_errors` of a summary as a line; none without them."""
    if "projection_mean_px" not in summary:
        return []
    parameters = "its lens model has terms that the calibration lacks, so only projection is compared"
    if "fx_error_pct" in summary:
        parameters = (
            f"fx {summary['fx_error_pct']:+.3f} %, fy {summary['fy_error_pct']:+.3f} %, "
            f"cx {summary['cx_error_px']:+.3f} px, cy {summary['cy_error_px']:+.3f} px"
        )
    share = summary["projection_share"]
    over = "" if share == 1 else f" over {100 * share:.0f} % of the image; the calibrated lens does not cover the rest"
    return [
        f"against the true camera: {parameters}; mean projection error {summary['projection_mean_px']:.3f} px, "
        f"maximum {summary['projection_max_px']:.3f} px{over}"
    ]
