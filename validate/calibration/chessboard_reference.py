"""Reference pose from the chessboard: the pose of a circle from the board printed beside it, by `cv2.solvePnP`.

The paper evaluates real photographs in this way. Here the truth is also known, so the reference's own error is measured
first: its pose is scored against the truth as method `chessboard_pnp`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.model import Camera
from roundel.solver.detect.chessboard_corners import BoardLayout
from roundel.validate.calibration.chessboard import pose_of_corners
from roundel.validate.calibration.opencv import BoardView
from roundel.validate.metrics.ground_truth import (
    CONTOUR_POINTS,
    Targets,
    board_targets,
    frame_cameras,
    poses_of,
    rows_of_kind,
)
from roundel.validate.scores.candidates import Candidates
from roundel.validate.scores.scores import score_rows
from roundel.validate.scores.summary import CHESSBOARD

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Reference:
    """Poses of boards from images, and the resulting poses of the circles beside them.

    Attributes
    ----------
    rows : pyarrow.Table
        Rows of scores.parquet: the boards' poses against the truth.
    circles : Targets or None
        The circles beside a board, with poses from the board.
    circle_rows : pyarrow.Table or None
        The same poses as rows of scores.parquet, against the truth: errors of the board on the circle's own grid.
    """

    rows: pa.Table
    circles: Targets | None
    circle_rows: pa.Table | None = None


def reference_of(
    dataset: Dataset, views: list[BoardView], targets: Targets, camera: Camera | None, label: str
) -> Reference:
    """Scored poses of all boards, and the resulting poses of circles.

    Parameters
    ----------
    dataset : Dataset
    views : list of BoardView
        From `look_for_boards`.
    targets : Targets
        Every true circle.
    camera : Camera or None
        The intrinsics of the reference; if None, each frame's true camera.
    label : str
        Label of these intrinsics in the records.
    """
    index, cameras = frame_cameras(dataset)
    truth = rows_of_kind(dataset, ("chessboard",))
    keys = zip(truth["frame_id"].to_pylist(), truth["marker_id"].to_pylist(), strict=True)
    true_poses = dict(zip(keys, poses_of(truth), strict=True))
    estimates: dict[tuple[int, int], Array] = {}
    for view in views:
        if view.corners_px is not None:
            pose = pose_of_corners(view.corners_px, view.layout, camera or cameras[index[view.frame_id]])
            if pose is not None:
                estimates[view.frame_id, view.marker_id] = pose
    rows = _rows(truth, views, true_poses, estimates, index, cameras, camera, label)
    # One board per frame gives the poses of its circles; a sheet has no more.
    board_in = {frame: key for key in true_poses for frame in (key[0],)}
    beside = np.array([i for i, f in enumerate(targets.frame_id.tolist()) if f in board_in], dtype=np.int64)
    if not len(beside):
        return Reference(rows, None)
    circles = targets.take(beside)
    placed = np.full((len(circles), 4, 4), np.nan)
    for i, frame in enumerate(circles.frame_id.tolist()):
        key = board_in[frame]
        if key in estimates:
            # The layout of disc and board on the sheet is known from its drawing; here it is taken from the truth.
            board_from_circle = np.linalg.inv(true_poses[key]) @ circles.camera_from_marker[i]
            placed[i] = estimates[key] @ board_from_circle
    found = np.isfinite(placed).all(axis=(1, 2))
    candidates = _candidates(found, placed, circles.camera, cameras, camera)
    reason = ["" if there else "the chessboard was not found" for there in found.tolist()]
    circle_rows = score_rows(circles, candidates, reason, CHESSBOARD, label, "truth")
    return Reference(rows, board_targets(circles, placed, camera), circle_rows)


def _candidates(
    found: NDArray[np.bool_], pose: Array, index: NDArray[np.int64], cameras: list[Camera], camera: Camera | None
) -> Candidates:
    """One pose per target: (N, 4, 4), with the camera of the reference or each frame's own."""
    n = len(found)
    has = np.stack([found, np.zeros(n, dtype=bool)], axis=1)
    two = np.stack([pose, np.full_like(pose, np.nan)], axis=1)
    return Candidates(
        has,
        has,
        two[:, :, :3, 2],
        two[:, :, :3, 3],
        np.full((n, 2, 5), np.nan),
        np.zeros((n, 2), dtype=np.int64) if camera else np.stack([index, index], axis=1),
        [camera] if camera else cameras,
    )


def _rows(
    truth: pa.Table,
    views: list[BoardView],
    true_poses: dict[tuple[int, int], Array],
    estimates: dict[tuple[int, int], Array],
    index: dict[int, int],
    cameras: list[Camera],
    camera: Camera | None,
    label: str,
) -> pa.Table:
    keys = list(true_poses)
    n = len(keys)
    layouts = {(view.frame_id, view.marker_id): view.layout for view in views}
    found = np.array([key in estimates for key in keys], dtype=bool)
    pose = np.stack([estimates.get(key, np.full((4, 4), np.nan)) for key in keys]) if n else np.empty((0, 4, 4))
    frame_camera = np.array([index[frame] for frame, _ in keys], dtype=np.int64)
    targets = Targets(
        np.array([frame for frame, _ in keys], dtype=np.int64),
        np.array([marker for _, marker in keys], dtype=np.int64),
        np.array(list(true_poses.values())).reshape(n, 4, 4),
        np.full(n, np.nan),
        np.array([_half_size_m(layouts.get(key)) for key in keys], dtype=np.float64),
        frame_camera,
        cameras,
        np.full((n, 5), np.nan),
        np.full((n, CONTOUR_POINTS, 2), np.nan),
        np.full((n, 3), np.nan),
        truth,
    )
    candidates = _candidates(found, pose, frame_camera, cameras, camera)
    reason = ["" if there else "the chessboard was not found" for there in found.tolist()]
    return score_rows(targets, candidates, reason, CHESSBOARD, label, "truth")


def _half_size_m(layout: BoardLayout | None) -> float:
    """Half the longer side between the outermost inner corners, for the grid of the board's reprojection error."""
    return float("nan") if layout is None else (max(layout.columns, layout.rows) - 1) * layout.square_m / 2
