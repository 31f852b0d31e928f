"""How well estimates fit the true circles: the distance of the nearest contour, circle by circle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.datasets.dataset import Dataset
from roundel.validate.diagnosis.conventions import COLUMNS, PARTS, Convention, Part
from roundel.validate.estimates.row_checks import is_ok
from roundel.validate.estimates.runs import runs_of
from roundel.validate.estimates.schema import COVARIANCE, KEY
from roundel.validate.metrics.ground_truth import Targets
from roundel.validate.scores.assignment import contour_errors, gates_px

Array = NDArray[np.float64]


def detections_of(table: pa.Table, part: Part) -> pa.Table:
    """One row of each detection that has this part, and nothing of the other parts.

    Both poses of a detection have the same image, so that the first is enough.
    """
    there = is_ok(table) & np.all([table[name].is_valid().to_numpy() for name in COLUMNS[part]], axis=0)
    keys = list(zip(*(table[name].to_pylist() for name in KEY[:-1]), strict=True))
    first: dict[tuple[object, ...], int] = {}
    for row in np.flatnonzero(there).tolist():
        first.setdefault(keys[row], row)
    table = table.take(pa.array(list(first.values()), pa.int64()))
    others = [name for other in PARTS if other != part for name in COLUMNS[other]]
    for name in (*others, *COVARIANCE):
        at = table.column_names.index(name)
        table = table.set_column(at, name, pa.nulls(table.num_rows, table.schema.field(at).type))
    at = table.column_names.index("candidate")
    return table.set_column(at, "candidate", pa.array([0] * table.num_rows, table.schema.field(at).type))


def errors_px(
    table: pa.Table, part: Part, convention: Convention | None, dataset: Dataset, targets: Targets, path: Path
) -> Array:
    """Distance of each target from the nearest detection of its frame, (targets,) px; infinite where none matches.

    Parameters
    ----------
    table : pyarrow.Table
        See `detections_of`; of one run.
    convention : Convention, optional
        The convention that is undone first; default: as given.

    Raises
    ------
    UsageError
        See `runs_of`.
    """
    changed = table if convention is None else convention.undo(table, part, dataset)
    out = np.full(len(targets), np.inf)
    gate = gates_px(targets)
    for run in runs_of(changed, dataset, path):
        rows_of: dict[int, list[int]] = {}
        for row in np.flatnonzero(run.ok).tolist():
            rows_of.setdefault(int(run.frame_id[row]), []).append(row)
        pairs = [(t, row) for t, frame in enumerate(targets.frame_id.tolist()) for row in rows_of.get(frame, [])]
        error = contour_errors(targets, run, pairs)
        if pairs:
            np.fmin.at(out, np.array(pairs)[:, 0], error)
    return np.where(out <= gate, out, np.inf)
