"""Defaults for columns that a file of estimates leaves out: the camera, and the ellipse of a pose.

Neither default improves an estimate: the default camera is the true one, and an ellipse computed from a pose has the
errors of the pose.
"""

from __future__ import annotations

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.model import Camera, project
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import FACING, minimal_rotation
from roundel.validate.metrics.ground_truth import columns_of

Array = NDArray[np.float64]


def true_intrinsics(dataset: Dataset, frame_id: NDArray[np.int64]) -> tuple[Array, list[list[float]], list[str]]:
    """Intrinsics (rows, 5), distortion and lens model of each row's own frame."""
    known: dict[int, Camera] = {}
    index = {frame: i for i, frame in enumerate(dataset.images.frame_ids)}
    for frame in np.unique(frame_id).tolist():
        known[frame] = dataset.images.camera(index[frame])
    cameras = [known[frame] for frame in frame_id.tolist()]
    values = [(c.K[0, 0], c.K[1, 1], c.K[0, 1], c.K[0, 2], c.K[1, 2]) for c in cameras]
    return (
        np.array(values, dtype=np.float64).reshape(-1, 5),
        [list(c.distortion) for c in cameras],
        [c.distortion_model for c in cameras],
    )


def radii_m(dataset: Dataset, frame_id: NDArray[np.int64], centre_px: Array) -> Array:
    """Radius of the printed circle whose true centre is nearest to `centre_px`, row by row; NaN if there is none."""
    truth = dataset.truth.filter(pa.array(np.isfinite(columns_of(dataset.truth, ["radius_m"])[:, 0])))
    values = columns_of(truth, ["radius_m", "centre_image_x_px", "centre_image_y_px"])
    rows: dict[int, list[int]] = {}
    for row, frame in enumerate(truth["frame_id"].to_pylist()):
        rows.setdefault(frame, []).append(row)
    out = np.full(len(frame_id), np.nan)
    for i, frame in enumerate(frame_id.tolist()):
        its = rows.get(frame, [])
        if its:
            away = np.linalg.norm(values[its, 1:] - centre_px[i], axis=-1)
            # A centre without an image gets the frame's first print.
            out[i] = values[its[int(np.argmin(np.where(np.isfinite(away), away, np.inf)))], 0]
    return out


def ellipses_of_poses(normal: Array, centre_m: Array, radius_m: Array, camera: Camera) -> Array:
    """Ellipses (rows, 5) of circles in undistorted pixel coordinates; NaN if the image is not an ellipse."""
    out = np.full((len(normal), 5), np.nan)
    if not len(normal):
        return out
    poses = np.tile(np.eye(4), (len(normal), 1, 1))
    poses[:, :3, :3] = minimal_rotation(np.array([0.0, 0.0, -1.0]), normal) @ FACING
    poses[:, :3, 3] = centre_m
    seen = np.isfinite(radius_m)
    # The image of a circle that is partly behind the camera is not an ellipse.
    deepest = centre_m[:, 2] - radius_m * np.sqrt(np.maximum(1 - normal[:, 2] ** 2, 0.0))
    seen &= deepest > 1e-6 * radius_m
    if seen.any():
        out[seen] = ellipse_of_conic(conic_of_circle(poses[seen], radius_m[seen], camera.K))
    return out


def centres_px(centre_m: Array, camera: Camera) -> Array:
    """Images (rows, 2) of centres in the delivered image; NaN if there is none."""
    out = np.full((len(centre_m), 2), np.nan)
    there = np.isfinite(centre_m).all(axis=-1)
    if there.any():
        out[there] = project(camera, centre_m[there])
    return out
