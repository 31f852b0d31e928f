"""Columns of truth.parquet and truth.csv, and their writers."""

from __future__ import annotations

import io
from typing import Any

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

_F = pa.float64()


def _xyz(prefix: str, suffix: str = "") -> list[tuple[str, pa.DataType]]:
    return [(f"{prefix}_{axis}{suffix}", _F) for axis in "xyz"]


def _matrix(name: str) -> list[tuple[str, pa.DataType]]:
    return [(f"{name}_{i}{j}", _F) for i in range(4) for j in range(4)]


TRUTH_SCHEMA = pa.schema(
    [
        ("frame_id", pa.int64()),
        ("marker_id", pa.int64()),
        ("group", pa.string()),
        ("kind", pa.string()),
        ("radius_m", _F),
        *_matrix("camera_from_marker"),
        *_xyz("normal"),
        *_xyz("centre", "_m"),
        ("distance_m", _F),
        ("distance_D", _F),
        ("tilt_deg", _F),
        ("azimuth_deg", _F),
        *[(f"conic_{ij}", _F) for ij in ("00", "01", "02", "11", "12", "22")],
        *[(f"ellipse_{n}", _F) for n in ("x_px", "y_px", "a_px", "b_px", "angle_deg")],
        ("centre_image_x_px", _F),
        ("centre_image_y_px", _F),
        *[(f"vanishing_line_{i}", _F) for i in range(3)],
        *_xyz("other_normal"),
        *_xyz("other_centre", "_m"),
        ("contour_x_px", pa.list_(_F)),
        ("contour_y_px", pa.list_(_F)),
        ("visible_fraction", _F),
        ("edge_contrast_dn", _F),
        ("edge_noise_dn", _F),
        ("edge_blur_px", _F),
        *_matrix("open_camera_from_marker"),
        *_matrix("close_camera_from_marker"),
        ("flags", pa.string()),
    ]
)

# The last row of a rigid pose, 0 0 0 1, is left out.
ROWS_SCHEMA = pa.schema(
    [
        ("frame_id", pa.int64()),
        ("marker_id", pa.int64()),
        ("row", pa.int64()),
        ("time_s", _F),
        *[(f"camera_from_marker_{i}{j}", _F) for i in range(3) for j in range(4)],
    ]
)

POINTS_SCHEMA = pa.schema([("frame_id", pa.int64()), ("marker_id", pa.int64()), ("x_px", _F), ("y_px", _F)])


def truth_table(rows: list[dict[str, Any]]) -> pa.Table:
    """Rows of `scenes.truth.truth_of` as a table, sorted by (frame_id, marker_id)."""
    ordered = sorted(rows, key=lambda row: (row["frame_id"], row["marker_id"]))
    return pa.Table.from_pylist(ordered, schema=TRUTH_SCHEMA)


def parquet_bytes(table: pa.Table) -> bytes:
    """A table as the bytes of a Parquet file."""
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd")
    return sink.getvalue()


def csv_bytes(table: pa.Table) -> bytes:
    """A table as CSV, without the columns that are lists."""
    flat = [f.name for f in table.schema if not pa.types.is_list(f.type)]
    sink = io.BytesIO()
    pa_csv.write_csv(table.select(flat), sink)
    return sink.getvalue()
