"""Camera calibration from chessboard views by OpenCV, blind to the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from roundel.datasets.layout.images import Images
from roundel.scenes.camera.camera_file import read_camera_record
from roundel.scenes.camera.model import Camera, camera_from_json, camera_to_json, project
from roundel.scenes.camera.parameter_covariance import parameter_names
from roundel.scenes.errors import NotComparableError, UsageError
from roundel.scenes.study.schema import MIN_CALIBRATION_VIEWS
from roundel.solver.detect.chessboard_corners import BoardLayout, board_points_m, detect_corners, layout_of
from roundel.validate.calibration.board_bundle import BoardCorners, least_squares_covariance

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BoardView:
    """One search for a chessboard: its frame, its layout, and its corners (N, 2) as in `board_points_m`, or None."""

    frame_id: int
    group: str
    marker_id: int
    layout: BoardLayout
    camera_size_px: tuple[int, int]
    corners_px: Array | None


@dataclass(frozen=True)
class Calibration:
    """A camera and the views it was calibrated from.

    Attributes
    ----------
    camera : Camera
        With OpenCV's k1, k2, p1, p2 (and k3 with five coefficients).
    rms_px : float
        As returned by `cv2.calibrateCamera`.
    rms_check_px : float
        Recomputed from the result: root of the mean squared distance over all corners.
    frame_ids, missed_frame_ids : list of int
        The views with and without a detected board.
    covariance : (c, c) array
        Of the camera's parameters, see `parameter_names` and `least_squares_covariance`.
    widened : float
        Factor on its standard deviations, because the views contradict each other by more than their noise.
    """

    camera: Camera
    rms_px: float
    rms_check_px: float
    frame_ids: list[int]
    missed_frame_ids: list[int]
    covariance: Array
    widened: float

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return dict(zip(parameter_names(self.camera), np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def look_for_boards(
    images: Images, group: str | None = None, progress: Callable[[int, int], None] | None = None
) -> list[BoardView]:
    """Detect the chessboard in every frame of a group (default: of the dataset) that shows one.

    `progress` is called with (views done, total views).
    """
    frame_ids, groups = images.frame_ids, images.groups
    boards = [
        (i, marker)
        for i in range(len(images))
        if (group is None or groups[i] == group) and images.mode(i) == "images"
        for marker in images.markers(i)
        if marker["kind"] == "chessboard"
    ]

    def look(board: tuple[int, dict[str, Any]]) -> BoardView:
        i, marker = board
        layout, record = layout_of(marker["layout"]), images.records[i]
        corners = detect_corners(images.image(i), layout.columns, layout.rows)
        size = int(record["width_px"]), int(record["height_px"])
        return BoardView(frame_ids[i], groups[i], int(marker["marker_id"]), layout, size, corners)

    views = []
    # Each view depends only on its image, and OpenCV releases the interpreter lock: threads only change the time.
    with ThreadPoolExecutor() as pool:
        for done, view in enumerate(pool.map(look, boards), start=1):
            views.append(view)
            if progress is not None:
                progress(done, len(boards))
    return views


def calibration_group(images: Images, asked: str | None, kind: str = "chessboard") -> str | None:
    """The group to calibrate from: the given one, else the first that shows only boards of this kind.

    Raises
    ------
    UsageError
        If there is no such group.
    """
    groups = images.groups
    if asked is not None:
        if asked not in groups:
            raise UsageError(f"no group {asked!r} in this dataset; it has {', '.join(sorted(set(groups)))}")
        return asked
    alone = dict.fromkeys(groups, True)
    for record, group in zip(images.records, groups, strict=True):
        kinds = {marker["kind"] for marker in record["markers"]}
        alone[group] = alone[group] and kinds == {kind} and record["mode"] == "images"
    return next((group for group in groups if alone[group]), None)


def calibrate(images: Images, group: str | None = None, coefficients: int = 4) -> Calibration:
    """Calibrate a camera from the chessboards of a dataset, without access to the truth.

    Parameters
    ----------
    images : Images
    group : str, optional
        The group of views; default: the first that shows only chessboards, else all frames with a chessboard.
    coefficients : {4, 5}
        Distortion coefficients to fit: k1, k2, p1, p2, and k3 with five. Fewer are more stable with few views.

    Raises
    ------
    UsageError
        If there is no such group.
    NotComparableError
        If the board was found in fewer than three views, or the views differ in size.
    """
    return calibrate_views(look_for_boards(images, calibration_group(images, group)), coefficients)


def calibrate_views(views: list[BoardView], coefficients: int = 4) -> Calibration:
    """`calibrate`, from views with detected corners."""
    if not views:
        raise NotComparableError(
            "no frame shows a chessboard; calibrate from a group that does, as in configs/chessboard.yaml"
        )
    sizes = {view.camera_size_px for view in views}
    if len(sizes) > 1:
        raise NotComparableError(f"the views have {len(sizes)} image sizes; calibrate one camera at a time")
    found = [(view, view.corners_px) for view in views if view.corners_px is not None]
    if len(found) < MIN_CALIBRATION_VIEWS:
        raise NotComparableError(
            f"the chessboard was found in {len(found)} of {len(views)} views; a calibration needs "
            f"{MIN_CALIBRATION_VIEWS}: render more views, larger or less tilted"
        )
    layouts, corners = [view.layout for view, _ in found], [c for _, c in found]
    boards = [BoardCorners(board_points_m(layout), c) for layout, c in zip(layouts, corners, strict=True)]
    camera, rms, poses = least_squares_camera(boards, next(iter(sizes)), coefficients)
    squared = [
        np.sum((project(camera, board.points_m @ pose[:3, :3].T + pose[:3, 3]) - board.pixels) ** 2, axis=-1)
        for board, pose in zip(boards, poses, strict=True)
    ]
    # A corner outside the range in which the fitted polynomial increases has no image and no residual.
    check = float(np.sqrt(np.nanmean(np.concatenate(squared))))
    covariance, widened = least_squares_covariance(boards, camera, poses)
    missed = [view.frame_id for view in views if view.corners_px is None]
    return Calibration(camera, rms, check, [view.frame_id for view, _ in found], missed, covariance, widened)


def least_squares_camera(
    boards: Sequence[BoardCorners], size: tuple[int, int], coefficients: int = 4
) -> tuple[Camera, float, Array]:
    """`cv2.calibrateCamera`: the camera, RMS of the residuals in px, and `camera_from_board` (V, 4, 4)."""
    points = [board.points_m.astype(np.float32) for board in boards]
    pixels = [board.pixels.astype(np.float32) for board in boards]
    flags = 0 if coefficients == 5 else cv2.CALIB_FIX_K3
    # Camera and coefficients are outputs; OpenCV's type stubs require arrays for them.
    empty: Any = None
    # With several threads OpenCV 5 sums in the order in which they finish, so the last digits would vary between runs.
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        rms, k, distortion, rotations, translations = cv2.calibrateCamera(
            points, pixels, size, empty, empty, flags=flags
        )
    finally:
        cv2.setNumThreads(threads)
    coefficient_values = tuple(float(v) for v in np.ravel(distortion)[:coefficients])
    camera = Camera(size[0], size[1], np.asarray(k, dtype=np.float64), coefficient_values)
    poses = np.tile(np.eye(4), (len(boards), 1, 1))
    for pose, rotation, translation in zip(poses, rotations, translations, strict=True):
        pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(rotation)[0], np.ravel(translation)
    return camera, float(rms), poses


def first_views(views: list[BoardView], count: int | None) -> list[BoardView]:
    """The first `count` views of a calibration, with or without a detected board; all views for None.

    Raises
    ------
    UsageError
        If there are fewer views.
    """
    if count is None:
        return views
    if count > len(views):
        raise UsageError(f"{count} views are requested, but {len(views)} show a chessboard; request at most that many")
    return views[:count]


def calibration_to_json(calibration: Calibration, dataset_id: str | None, group: str | None) -> dict[str, Any]:
    """A camera file: the camera keys of `cameras.json` and their source, without truth."""
    return {
        **camera_to_json(calibration.camera),
        "calibration": {
            "rms_px": calibration.rms_px,
            "rms_check_px": calibration.rms_check_px,
            "views": len(calibration.frame_ids),
            "missed_views": len(calibration.missed_frame_ids),
            "frames": calibration.frame_ids,
            "group": group,
            "dataset_id": dataset_id,
            "opencv": cv2.__version__,
            **_uncertainty(calibration),
        },
    }


def _uncertainty(calibration: Calibration) -> dict[str, Any]:
    """The covariance of the parameters for a camera file; nothing if the views do not determine them."""
    if not np.isfinite(calibration.covariance).all():
        return {}
    return {
        "widened": calibration.widened,
        "parameters": list(parameter_names(calibration.camera)),
        "sigma": calibration.sigmas,
        "covariance": calibration.covariance.tolist(),
    }


def read_camera(path: str | Path) -> Camera:
    """The camera of a camera file.

    Raises
    ------
    UsageError
        If there is no such file.
    DataError
        If it is not a camera file.
    """
    return camera_from_json(read_camera_record(path))
