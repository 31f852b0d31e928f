"""The position in its group's sweep of each row of the truth."""

from __future__ import annotations

import pyarrow as pa

from roundel.datasets.dataset import Dataset
from roundel.datasets.layout.sweeps import sweep_positions
from roundel.scenes.errors import DataError

COLUMNS = ("sweep_level", "sweep_frame")


def with_sweep(dataset: Dataset, truth: pa.Table) -> pa.Table:
    """Rows of the truth with two more columns: `sweep_level` (null without a sweep) and `sweep_frame`.

    Raises
    ------
    DataError
        If the truth has frames that the dataset does not have.
    """
    where = sweep_positions(dataset.images, dataset.manifest)
    frames = truth["frame_id"].to_pylist()
    unknown = set(frames) - set(where)
    if unknown:
        raise DataError(f"the dataset's truth has frame {min(unknown)}, which its cameras do not have; render it again")
    level = pa.array([where[f][0] for f in frames], type=pa.float64())
    position = pa.array([where[f][1] for f in frames], type=pa.int64())
    return truth.append_column(COLUMNS[0], level).append_column(COLUMNS[1], position)
