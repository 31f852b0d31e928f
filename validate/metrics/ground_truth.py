"""Reference poses: the true circles, or the same circles as placed by the chessboard beside them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.model import Camera, project
from roundel.scenes.errors import DataError
from roundel.scenes.geometry.conic import circle_points_m, conic_of_circle, ellipse_of_conic, other_candidate
from roundel.validate.metrics.sweeps import with_sweep

Array = NDArray[np.float64]

# Number of contour points that are compared: with 64 of the 256 the mean changes by less than 1e-3 of itself.
CONTOUR_POINTS = 64


@dataclass(frozen=True)
class Targets:
    """Circles to compare estimates with, row by row.

    Attributes
    ----------
    frame_id, marker_id : (N,) int arrays
    camera_from_marker : (N, 4, 4) array
        NaN without a reference.
    diameter_m : (N,) array
        NaN for boards.
    extent_m : (N,) array
        Half side of the grid of the reprojection error.
    camera : (N,) int array
        Index into `cameras`.
    cameras : list of Camera
    ellipse : (N, 5) array
        In the undistorted pixel coordinates of the camera; NaN for boards.
    contour_px : (N, n, 2) array
        In the delivered image.
    other_normal : (N, 3) array
        Normal of the other pose with the same image.
    truth : pyarrow.Table
        The rows of truth.parquet, in this order, with their position in a sweep (`sweep_level`, `sweep_frame`).
    """

    frame_id: NDArray[np.int64]
    marker_id: NDArray[np.int64]
    camera_from_marker: Array
    diameter_m: Array
    extent_m: Array
    camera: NDArray[np.int64]
    cameras: list[Camera]
    ellipse: Array
    contour_px: Array
    other_normal: Array
    truth: pa.Table

    def __len__(self) -> int:
        return len(self.frame_id)

    @property
    def placed(self) -> NDArray[np.bool_]:
        """(N,) array: which rows have a reference pose."""
        return np.asarray(np.isfinite(self.camera_from_marker).all(axis=(1, 2)))

    def take(self, rows: NDArray[np.int64]) -> Targets:
        """The selected rows."""
        return replace(
            self,
            frame_id=self.frame_id[rows],
            marker_id=self.marker_id[rows],
            camera_from_marker=self.camera_from_marker[rows],
            diameter_m=self.diameter_m[rows],
            extent_m=self.extent_m[rows],
            camera=self.camera[rows],
            ellipse=self.ellipse[rows],
            contour_px=self.contour_px[rows],
            other_normal=self.other_normal[rows],
            truth=self.truth.take(pa.array(rows)),
        )


def columns_of(table: pa.Table, names: list[str]) -> Array:
    """Columns of a table as (rows, len(names)); nulls are NaN.

    Raises
    ------
    DataError
        If a column is missing.
    """
    missing = [name for name in names if name not in table.column_names]
    if missing:
        raise DataError(f"the dataset's truth has no column {', '.join(missing)}; render it with this version")
    return np.stack([np.asarray(table[name].to_numpy(), dtype=np.float64) for name in names], axis=-1)


def poses_of(truth: pa.Table) -> Array:
    """True poses (rows, 4, 4)."""
    names = [f"camera_from_marker_{i}{j}" for i in range(4) for j in range(4)]
    return columns_of(truth, names).reshape(-1, 4, 4)


def frame_cameras(dataset: Dataset) -> tuple[dict[int, int], list[Camera]]:
    """Camera of each frame as an index into the distinct ones."""
    known: dict[tuple[object, ...], int] = {}
    cameras: list[Camera] = []
    index: dict[int, int] = {}
    for i, frame_id in enumerate(dataset.images.frame_ids):
        camera = dataset.images.camera(i)
        size = camera.width_px, camera.height_px
        key = (*size, *camera.K.ravel().tolist(), camera.distortion_model, *camera.distortion)
        if key not in known:
            known[key] = len(cameras)
            cameras.append(camera)
        index[frame_id] = known[key]
    return index, cameras


def rows_of_kind(dataset: Dataset, kinds: tuple[str, ...]) -> pa.Table:
    """Rows of the truth with one of these kinds, sorted by frame and marker."""
    wanted = pc.is_in(dataset.truth["kind"], value_set=pa.array(kinds))
    return with_sweep(dataset, _in_order(dataset.truth.filter(wanted)))


def _in_order(truth: pa.Table) -> pa.Table:
    return truth.sort_by([("frame_id", "ascending"), ("marker_id", "ascending")])


def true_targets(dataset: Dataset, extent_D: float) -> Targets:
    """Every true circle of a dataset.

    Raises
    ------
    DataError
        If the truth lacks a column, or has frames that the dataset does not have.
    """
    circular = np.isfinite(columns_of(dataset.truth, ["radius_m"])[:, 0])
    truth = with_sweep(dataset, _in_order(dataset.truth.filter(pa.array(circular))))
    index, cameras = frame_cameras(dataset)
    frame_id = truth["frame_id"].to_numpy()
    diameter = 2 * columns_of(truth, ["radius_m"])[:, 0]
    return Targets(
        frame_id,
        truth["marker_id"].to_numpy(),
        poses_of(truth),
        diameter,
        extent_D * diameter,
        np.array([index[f] for f in frame_id.tolist()], dtype=np.int64),
        cameras,
        columns_of(truth, [f"ellipse_{n}" for n in ("x_px", "y_px", "a_px", "b_px", "angle_deg")]),
        _contours(truth),
        columns_of(truth, ["other_normal_x", "other_normal_y", "other_normal_z"]),
        truth,
    )


def _contours(truth: pa.Table) -> Array:
    if truth.num_rows == 0:
        return np.empty((0, CONTOUR_POINTS, 2))
    axes = []
    for name in ("contour_x_px", "contour_y_px"):
        lengths = pc.unique(pc.list_value_length(truth[name])).to_pylist()
        if len(lengths) != 1 or not lengths[0]:
            raise DataError(f"the dataset's truth has contours of {len(lengths)} lengths in {name}; render it again")
        flat = np.asarray(pc.list_flatten(truth[name]).to_numpy(), dtype=np.float64)
        axes.append(flat.reshape(truth.num_rows, lengths[0])[:, :: max(1, lengths[0] // CONTOUR_POINTS)])
    return np.stack(axes, axis=-1)


def board_targets(targets: Targets, camera_from_marker: Array, camera: Camera | None) -> Targets:
    """The same circles with poses from a chessboard, and the camera used for them.

    Parameters
    ----------
    targets : Targets
    camera_from_marker : (N, 4, 4) array
        Poses derived from those of the board; NaN if it was not found.
    camera : Camera or None
        The intrinsics of the reference; if None, each target's own camera.
    """
    if camera is not None:
        targets = replace(targets, camera=np.zeros(len(targets), dtype=np.int64), cameras=[camera])
    targets = replace(
        targets,
        camera_from_marker=camera_from_marker,
        ellipse=np.full_like(targets.ellipse, np.nan),
        contour_px=np.full_like(targets.contour_px, np.nan),
        other_normal=np.full_like(targets.other_normal, np.nan),
    )
    for i in np.flatnonzero(targets.placed).tolist():
        pose, radius, its = camera_from_marker[i], targets.diameter_m[i] / 2, targets.cameras[targets.camera[i]]
        targets.ellipse[i] = ellipse_of_conic(conic_of_circle(pose, radius, its.K))
        targets.other_normal[i] = other_candidate(pose[:3, 2], pose[:3, 3], radius)[0]
        targets.contour_px[i] = project(its, circle_points_m(pose, radius, targets.contour_px.shape[1]))
    return targets
