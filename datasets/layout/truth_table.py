"""Columns of truth.parquet and truth.csv, and their writers."""

from __future__ import annotations

import io
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

_F = pa.float64()
_INT, _TEXT, _LIST = pa.int64(), pa.string(), pa.list_(_F)


class TruthColumns(NamedTuple):
    """Columns of one quantity: their names, type and unit, what they mean, and whether boards have them."""

    names: tuple[str, ...]
    type: pa.DataType
    unit: str
    meaning: str
    boards: bool = True


def _xyz(prefix: str, suffix: str = "") -> tuple[str, ...]:
    return tuple(f"{prefix}_{axis}{suffix}" for axis in "xyz")


def _matrix(name: str, rows: int = 4) -> tuple[str, ...]:
    return tuple(f"{name}_{i}{j}" for i in range(rows) for j in range(4))


TRUTH_COLUMNS = (
    TruthColumns(("frame_id",), _INT, "", "the frame, as in cameras.json"),
    TruthColumns(("marker_id",), _INT, "", "marker 0 is the first of the sheet"),
    TruthColumns(("group", "kind"), _TEXT, "", "group of the study; kind of the marker"),
    TruthColumns(("radius_m",), _F, "m", "outer radius", boards=False),
    TruthColumns(_matrix("camera_from_marker"), _F, "m", "4x4 matrix of the pose of record"),
    TruthColumns(_xyz("normal"), _F, "1", "unit normal out of the printed face, camera frame"),
    TruthColumns(_xyz("centre", "_m"), _F, "m", "centre of the marker, camera frame"),
    TruthColumns(("distance_m",), _F, "m", "from the camera centre to the marker's centre"),
    TruthColumns(("distance_D",), _F, "D", "the same in marker diameters", boards=False),
    TruthColumns(("tilt_deg", "azimuth_deg"), _F, "deg", "angles of the normal, from the optical axis"),
    TruthColumns(
        tuple(f"conic_{ij}" for ij in ("00", "01", "02", "11", "12", "22")), _F, "",
        "upper triangle of the conic, undistorted; unit Frobenius norm, positive inside", boards=False,
    ),
    TruthColumns(("ellipse_x_px", "ellipse_y_px"), _F, "px", "centre of the ellipse, undistorted", boards=False),
    TruthColumns(("ellipse_a_px", "ellipse_b_px"), _F, "px", "semi-axes, a >= b", boards=False),
    TruthColumns(("ellipse_angle_deg",), _F, "deg", "major axis, from +x toward +y, in [0, 180)", boards=False),
    TruthColumns(
        ("centre_image_x_px", "centre_image_y_px"), _F, "px", "image of the marker's centre, **distorted**"
    ),
    TruthColumns(
        tuple(f"vanishing_line_{i}" for i in range(3)), _F, "", "vanishing line of the plane, K^-T normal, unit norm"
    ),
    TruthColumns(_xyz("other_normal"), _F, "1", "normal of the second, false candidate", boards=False),
    TruthColumns(_xyz("other_centre", "_m"), _F, "m", "centre of the second, false candidate", boards=False),
    TruthColumns(
        ("contour_x_px", "contour_y_px"), _LIST, "px", "256 points of the outline, **distorted**; a board's rectangle"
    ),
    TruthColumns(
        ("visible_fraction",), _F, "1", "fraction of the marker's area that is inside the image and not hidden"
    ),
    TruthColumns(
        ("hidden_by",), _TEXT, "",
        "what hides the rest, comma-separated: image border, occluder, lamp, sheet; empty if nothing does",
    ),
    TruthColumns(
        ("contour_visible",), pa.list_(pa.bool_()), "", "which points of the outline are in the image and not hidden"
    ),
    TruthColumns(
        ("surface",), _TEXT, "",
        "flat; cylinder or bent: pose and vanishing line are those of the tangent plane at the marker's centre, and "
        "the columns of conic, ellipse and second candidate are empty, because the image is no conic",
    ),
    TruthColumns(("curvature_radius_m",), _F, "m", "radius of curvature at the sheet's origin; null if flat"),
    TruthColumns(
        ("edge_contrast_dn",), _F, "dn of the file",
        "absolute difference of the mean levels within 4 px inside and outside the edge, of colours the mean of their "
        "channels; through the tone curve of `sensor.isp`, before its denoising and sharpening; null in points mode, "
        "or where a side is not in the image", boards=False,
    ),
    TruthColumns(
        ("edge_noise_dn",), _F, "dn of the file",
        "RMS noise of a pixel at these two levels, as in `noise_dn` of the radiance, before denoising and sharpening; "
        "null likewise", boards=False,
    ),
    TruthColumns(
        ("edge_inside_e", "edge_outside_e"), _F, "e",
        "mean electrons of a pixel within 4 px inside and outside the edge, dark signal included, without clipping; "
        "null likewise", boards=False,
    ),
    TruthColumns(
        ("edge_blur_px",), _F, "px",
        "standard deviation of the blur along one axis, two axes averaged: pixel area, defocus, diffraction, motion",
    ),
    TruthColumns(("edge_softness_m",), _F, "m", "full width of the ramp between ink and paper, on the sheet"),
    TruthColumns(_matrix("open_camera_from_marker"), _F, "m", "pose when the shutter opens"),
    TruthColumns(_matrix("close_camera_from_marker"), _F, "m", "pose when the shutter closes"),
    TruthColumns(("flags",), _TEXT, "", "flags of the frame and of this marker, comma-separated; empty without any"),
)  # fmt: skip

TRUTH_SCHEMA = pa.schema([(name, columns.type) for columns in TRUTH_COLUMNS for name in columns.names])

# The last row of a rigid pose, 0 0 0 1, is left out.
ROWS_SCHEMA = pa.schema(
    [
        ("frame_id", _INT),
        ("marker_id", _INT),
        ("row", _INT),
        ("time_s", _F),
        *[(name, _F) for name in _matrix("camera_from_marker", rows=3)],
    ]
)

POINTS_SCHEMA = pa.schema([("frame_id", _INT), ("marker_id", _INT), ("x_px", _F), ("y_px", _F)])


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
