"""What a method reads beside the pose, scored: a focal length measured from the image alone, and an identity."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from roundel.validate.estimates.runs import Run
from roundel.validate.metrics.focal_errors import focal_errors
from roundel.validate.metrics.ground_truth import Targets
from roundel.validate.metrics.metric import IMAGE_METRICS

Array = NDArray[np.float64]

READINGS: dict[str, pa.DataType] = {**dict.fromkeys(IMAGE_METRICS, pa.float64()), "identity_correct": pa.bool_()}

# Keys of a layout that hold the identity of a single marker.
IDENTITIES = ("id", "first_id")


def identity_of(marker: dict[str, Any]) -> int | None:
    """The identity of a printed marker, from cameras.json; None if it has none."""
    layout = marker["layout"]
    single = layout.get("columns", 1) == layout.get("rows", 1) == 1
    found = next((layout[key] for key in IDENTITIES if key in layout), None) if single else None
    return None if found is None else int(found)


def with_readings(
    table: pa.Table, run: Run, rows: NDArray[np.int64], targets: Targets, identities: dict[tuple[int, int], int]
) -> pa.Table:
    """The scores of a run with the columns of `READINGS` filled in.

    Parameters
    ----------
    table : pyarrow.Table
        A row for each target.
    run : Run
    rows : (N, 2) int array
        Row of each target's candidates in the run; -1 if there is none.
    targets : Targets
    identities : dict
        By (frame_id, marker_id), of the markers that have one.
    """
    if not (np.isfinite(run.focal_px).any() or np.isfinite(run.identity).any()):
        return table
    found: dict[str, list[Any]] = {name: [None] * len(targets) for name in READINGS}
    for i, row in enumerate(rows.max(axis=1).tolist()):
        if row < 0:
            continue
        errors = focal_errors(
            float(run.focal_px[row]), float(run.focal_sigma_px[row]), targets.cameras[targets.camera[i]]
        )
        for name, value in zip(IMAGE_METRICS, (errors.measured, errors.fused), strict=True):
            found[name][i] = value if np.isfinite(value) else None
        known = identities.get((int(targets.frame_id[i]), int(targets.truth["marker_id"][i].as_py())))
        if known is not None and np.isfinite(run.identity[row]):
            found["identity_correct"][i] = bool(run.identity[row] == known)
    for name, kind in READINGS.items():
        table = table.set_column(table.column_names.index(name), name, pa.array(found[name], kind))
    return table
