"""Estimates from a file, our own or anyone's: Parquet or CSV, checked against the schema column by column."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from roundel.scenes.errors import DataError, UsageError
from roundel.solver.estimates import ESTIMATES, SCHEMA

KEY = ("frame_id", "detection_id", "method", "intrinsics", "candidate")
NORMAL = ("normal_x", "normal_y", "normal_z")
CENTRE = ("centre_x_m", "centre_y_m", "centre_z_m")
ELLIPSE = ("ellipse_x_px", "ellipse_y_px", "ellipse_a_px", "ellipse_b_px", "ellipse_angle_deg")
INTRINSICS = ("fx_px", "fy_px", "skew_px", "cx_px", "cy_px")

# What a score needs. Other people's solvers may leave out the rest: lens model, edge residuals, covariance.
REQUIRED = (*KEY, "chosen", *NORMAL, *CENTRE, *ELLIPSE, *INTRINSICS, "status", "reason")


def find_estimates(path: str | Path) -> Path:
    """The file that an argument means: itself, or the one in the folder it names.

    Raises
    ------
    UsageError
        If there is none.
    """
    path = Path(path)
    for file in (path, path / ESTIMATES, path / "estimates" / ESTIMATES):
        if file.is_file():
            return file
    raise UsageError(
        f"{path}: no estimates there; give an {ESTIMATES}, a CSV file, or a folder that holds the first "
        "(`roundel solve` writes it)"
    )


def read_estimates(path: str | Path) -> pa.Table:
    """Estimates of one file, with the columns and types of `SCHEMA`.

    A column that nobody is bound to give is null where it is missing; `distortion_model` then is `opencv`. CSV has a
    header, `true` and `false`, empty fields for what is missing, and coefficients of `distortion` between spaces.

    Parameters
    ----------
    path : path
        A Parquet file, a file that ends in .csv, or a folder (see `find_estimates`).

    Raises
    ------
    UsageError
        If there is no such file.
    DataError
        If it cannot be read, or a column is missing or of another type.
    """
    file = find_estimates(path)
    try:
        table = _read_csv(file) if file.suffix.lower() == ".csv" else pq.read_table(file)
    except (OSError, pa.ArrowException) as error:
        kind = "CSV with a header" if file.suffix.lower() == ".csv" else "Parquet"
        raise DataError(f"{file}: not a {kind} file, or cut short: {str(error).splitlines()[0]}") from error
    missing = [name for name in REQUIRED if name not in table.column_names]
    if missing:
        raise DataError(f"{file}: has no column {', '.join(missing)}; docs/dataset-format.md lists them all")
    columns = []
    for field in SCHEMA:
        if field.name not in table.column_names:
            columns.append(pa.nulls(table.num_rows, field.type))
            continue
        try:
            columns.append(table[field.name].cast(field.type))
        except (pa.ArrowException, ValueError) as error:
            raise DataError(f"{file}: column {field.name} is not {field.type}: {str(error).splitlines()[0]}") from error
    whole = pa.table(dict(zip(SCHEMA.names, columns, strict=True)))
    at = SCHEMA.get_field_index("distortion_model")
    models = [model or "opencv" for model in whole["distortion_model"].to_pylist()]
    return whole.set_column(at, "distortion_model", pa.array(models, pa.string()))


def _read_csv(file: Path) -> pa.Table:
    types = {field.name: field.type for field in SCHEMA if not pa.types.is_list(field.type)}
    table = pa_csv.read_csv(
        file,
        convert_options=pa_csv.ConvertOptions(
            column_types={**types, "distortion": pa.string()},
            null_values=["", "nan", "NaN"],
            strings_can_be_null=True,
            quoted_strings_can_be_null=False,
        ),
    )
    if "distortion" in table.column_names:
        try:
            lists = [[float(number) for number in (text or "").split()] for text in table["distortion"].to_pylist()]
        except ValueError as error:
            raise DataError(f"{file}: column distortion is not numbers between spaces: {error}") from error
        at = table.column_names.index("distortion")
        table = table.set_column(at, "distortion", pa.array(lists, pa.list_(pa.float64())))
    return table
