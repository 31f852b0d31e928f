"""Both poses of an ellipse that a file gives alone, as a Python method gets them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.scenes.camera.model import Camera, distort_px
from roundel.solver.pose.circle_pose import poses_from_ellipse
from roundel.validate.estimates.defaults import radii_m
from roundel.validate.estimates.row_checks import floats, is_ok
from roundel.validate.estimates.schema import CENTRE, ELLIPSE, NORMAL

Array = NDArray[np.float64]

FROM_ELLIPSE = "not given: both poses of the ellipse"


def with_both_poses(
    table: pa.Table, dataset: Dataset, camera: NDArray[np.int64], cameras: list[Camera]
) -> tuple[pa.Table, NDArray[np.int64]]:
    """The table with two candidates in place of each row that has an ellipse and no pose.

    Neither is chosen: without prior knowledge both are equally likely. The radius is the nearest printed circle's.

    Parameters
    ----------
    table : pyarrow.Table
        Valid rows, sorted.
    dataset : Dataset
    camera : (rows,) int array
        Index of each row's camera in `cameras`; -1 if it has none.
    cameras : list of Camera

    Returns
    -------
    table : pyarrow.Table
        Sorted; `choice_basis` of the new rows is `FROM_ELLIPSE`.
    camera : int array
        As above, of the new table.
    """
    ellipse, frame_id = floats(table, ELLIPSE), table["frame_id"].to_numpy()
    bare = is_ok(table) & np.isfinite(ellipse).all(axis=-1) & np.isnan(floats(table, NORMAL)).all(axis=-1)
    poses = np.full((table.num_rows, 2, 6), np.nan)
    for number, its in enumerate(cameras):
        rows = np.flatnonzero(bare & (camera == number))
        radius = radii_m(dataset, frame_id[rows], distort_px(its, ellipse[rows, :2]))
        for row, r in zip(rows.tolist(), radius.tolist(), strict=True):
            poses[row] = _poses(ellipse[row], its, r)
    posed = np.asarray(np.isfinite(poses).all(axis=(1, 2)), dtype=np.bool_)
    if not posed.any():
        return table, camera
    taken = np.repeat(np.arange(table.num_rows), np.where(posed, 2, 1))
    candidate = np.append(False, taken[1:] == taken[:-1]).astype(np.int64)
    new = pa.array(posed[taken])
    table = table.take(pa.array(taken))
    columns: dict[str, Any] = {name: poses[taken, candidate, i] for i, name in enumerate((*NORMAL, *CENTRE))}
    columns["candidate"] = candidate
    for name, values in columns.items():
        table = _replaced(table, name, new, pa.array(values, table.schema.field(name).type))
    table = _replaced(table, "chosen", new, pa.scalar(False))
    return _replaced(table, "choice_basis", new, pa.scalar(FROM_ELLIPSE)), camera[taken]


def _replaced(table: pa.Table, name: str, rows: pa.Array, values: pa.Array | pa.Scalar) -> pa.Table:
    """The table with other values in some rows of a column."""
    return table.set_column(table.column_names.index(name), name, pc.if_else(rows, values, table[name]))


def _poses(ellipse: Array, camera: Camera, radius_m: float) -> Array:
    """Both poses (2, 6), normal and centre; NaN if there is none."""
    try:
        poses = poses_from_ellipse(ellipse, camera.K, radius_m)
    except ValueError:
        return np.full((2, 6), np.nan)
    return np.concatenate([poses.normal, poses.centre_m], axis=-1)
