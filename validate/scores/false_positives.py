"""False positives: detections that match no marker, with the confidence that the method stated for each."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from roundel.validate.estimates.runs import Run

Array = NDArray[np.float64]

FALSE_POSITIVES_SCHEMA = pa.schema(
    [
        ("method", pa.string()),
        ("intrinsics", pa.string()),
        ("frame_id", pa.int64()),
        ("detection_id", pa.int64()),
        ("group", pa.string()),
        ("image_x_px", pa.float64()),
        ("image_y_px", pa.float64()),
        ("confidence", pa.float64()),
    ]
)


@dataclass(frozen=True)
class FalseDetections:
    """Detections of a run that match no marker.

    Attributes
    ----------
    method, intrinsics : str
    detections : int
        All detections of the run, right and wrong.
    table : pyarrow.Table
        A row of `FALSE_POSITIVES_SCHEMA` for each wrong one, sorted by frame and detection.
    """

    method: str
    intrinsics: str
    detections: int
    table: pa.Table

    @property
    def count(self) -> int:
        """Number of false positives."""
        return int(self.table.num_rows)

    @property
    def frame_ids(self) -> list[int]:
        """Frames that have any, in order."""
        return sorted(set(self.table["frame_id"].to_pylist()))

    def joined(self, later: FalseDetections) -> FalseDetections:
        """These and those of later frames."""
        table = pa.concat_tables([self.table, later.table])
        return FalseDetections(self.method, self.intrinsics, self.detections + later.detections, table)


def false_detections(run: Run, detections: int, rows: Sequence[int], group_of: dict[int, str]) -> FalseDetections:
    """The false positives of a run.

    Parameters
    ----------
    run : Run
    detections : int
        All detections of the run.
    rows : sequence of int
        First row in the run of each detection that matches no marker.
    group_of : dict
        Group of each frame_id.
    """
    at = np.array(sorted(rows), dtype=np.int64)
    frames = run.frame_id[at]
    # The image of the centre where there is one, else the centre of the ellipse.
    place = np.where(np.isfinite(run.centre_px[at]), run.centre_px[at], run.ellipse[at, :2])
    stated = stated_confidence(run)[at]
    data = {
        "method": [run.method] * len(at),
        "intrinsics": [run.intrinsics] * len(at),
        "frame_id": frames,
        "detection_id": run.detection_id[at],
        "group": [group_of[frame] for frame in frames.tolist()],
        "image_x_px": _nullable(place[:, 0]),
        "image_y_px": _nullable(place[:, 1]),
        "confidence": _nullable(stated),
    }
    return FalseDetections(run.method, run.intrinsics, detections, pa.table(data, schema=FALSE_POSITIVES_SCHEMA))


def stated_confidence(run: Run) -> Array:
    """The confidence (n,) of each row of a run; NaN where the method states none from 0 to 1.

    Scores of result files of BOP may have any scale: what is not from 0 to 1 is no probability.
    """
    if not len(run.confidence):
        return np.full(len(run.frame_id), np.nan)
    return np.where((run.confidence >= 0) & (run.confidence <= 1), run.confidence, np.nan)


def false_positives_parquet(every: Sequence[FalseDetections]) -> bytes:
    """The file of all runs' false positives; the same rows give the same bytes."""
    table = pa.concat_tables([FALSE_POSITIVES_SCHEMA.empty_table(), *(false.table for false in every)])
    ordered = [(name, "ascending") for name in ("method", "intrinsics", "frame_id", "detection_id")]
    sink = io.BytesIO()
    pq.write_table(table.sort_by(ordered).combine_chunks(), sink, compression="zstd")
    return sink.getvalue()


def _nullable(values: Array) -> pa.Array:
    return pa.array(values, mask=~np.isfinite(values), type=pa.float64())
