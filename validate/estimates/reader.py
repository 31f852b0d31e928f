"""Reading estimates from Parquet or CSV, checked against the schema column by column.

Required columns and the defaults of the others are in `validate/estimates/schema.py`, and are documented in
docs/your-own-method.md.
"""

from __future__ import annotations

import csv
import hashlib
import json
import re
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from roundel.datasets.store.folder import Folder
from roundel.datasets.store.store import MissingFile
from roundel.scenes.errors import DataError, NotComparableError, UsageError, first_line
from roundel.solver.estimates import CHECKSUM, ESTIMATES, METADATA, estimates_schema
from roundel.validate.estimates.bop_results import is_bop_results, read_bop_results
from roundel.validate.estimates.schema import (
    CENTRE,
    CENTRE_IMAGE,
    DATASET,
    ELLIPSE,
    INTRINSICS,
    KEY,
    NORMAL,
    check_columns,
)

_MAGIC = b"PAR1"
_SCHEMA = estimates_schema()
_LEAST_DIGITS = 12  # of a dataset_id, as the commands print it
_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}


def find_estimates(path: str | Path) -> Path:
    """The file given by an argument: the file itself, or the estimates file in a folder.

    Raises
    ------
    UsageError
        If there is no such file.
    """
    path = Path(path)
    for file in (path, path / ESTIMATES, path / "estimates" / ESTIMATES):
        if file.is_file():
            return file
    raise UsageError(
        f"{path}: no estimates found; give an {ESTIMATES}, a CSV file, or a folder with an {ESTIMATES} "
        "(`roundel solve` writes it)"
    )


def read_estimates(path: str | Path, frames: range | None = None) -> pa.Table:
    """Estimates of one file, with the columns and types of `estimates_schema`.

    Optional columns that need no dataset get their defaults: method (the file's name), intrinsics, detection_id,
    candidate, chosen, status, reason, skew, lens model. Other missing values are null.

    Parameters
    ----------
    path : path
        A Parquet file, a file that ends in .csv, or a folder (see `find_estimates`).
    frames : range, optional
        Only rows of these frames; of a large Parquet file only their row groups are read.

    Returns
    -------
    pyarrow.Table
        Its metadata are those of the file.

    Raises
    ------
    UsageError
        If there is no such file, or it is not a file of estimates: wrong format, missing column or wrong type.
    NotComparableError
        If it is empty.
    DataError
        If it is a damaged Parquet file.
    """
    file = find_estimates(path)
    table = _with_dataset(file, _rows_of(file, frames))
    check_columns(file, table.column_names)
    columns = []
    for field in _SCHEMA:
        if field.name not in table.column_names:
            columns.append(pa.nulls(table.num_rows, field.type))
            continue
        try:
            columns.append(table[field.name].cast(field.type))
        except (pa.ArrowException, ValueError) as error:
            raise UsageError(f"{file}: column {field.name} is not {field.type}: {first_line(error)}") from error
    whole = pa.table(dict(zip(_SCHEMA.names, columns, strict=True)))
    return _filled(whole, set(table.column_names), file.stem).replace_schema_metadata(table.schema.metadata)


def frame_ids_of(path: str | Path) -> NDArray[np.int64]:
    """The frames that a file of estimates has, each once, in order.

    Raises
    ------
    UsageError, NotComparableError, DataError
        As `read_estimates`.
    """
    file = find_estimates(path)
    if _is_parquet(file):
        opened = _opened(file)
        check_columns(file, opened.schema_arrow.names)
        try:
            column = opened.read(columns=["frame_id"], use_threads=False)["frame_id"].cast(pa.int64())
        except (OSError, ValueError, pa.ArrowException) as error:
            raise DataError(
                f"{file}: damaged or truncated Parquet file: {first_line(error)}; write it again"
            ) from error
    else:
        column = read_estimates(path)["frame_id"]
    return np.unique(column.drop_null().to_numpy())


def _rows_of(file: Path, frames: range | None) -> pa.Table:
    """The rows of some frames, or all, as they are in the file."""
    if not _is_parquet(file):
        table = _read_csv(file, _bytes_of(file))
        if frames is None or "frame_id" not in table.column_names:
            return table
        return table.filter(_within(table, frames))
    opened = _opened(file)
    try:
        groups = _groups_with(opened, frames)
        table = opened.read_row_groups(groups, use_threads=False) if groups else opened.schema_arrow.empty_table()
        table.validate(full=True)
        if frames is not None and "frame_id" in table.column_names:
            table = table.filter(_within(table, frames))
        return table.replace_schema_metadata(opened.schema_arrow.metadata)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise _damaged(file, error) from error


def _damaged(file: Path, error: Exception) -> DataError:
    return DataError(f"{file}: damaged or truncated Parquet file: {first_line(error)}; write it again")


def _within(table: pa.Table, frames: range) -> pa.ChunkedArray:
    ids = table["frame_id"]
    return pc.and_(pc.greater_equal(ids, frames.start), pc.less(ids, frames.stop))


def _groups_with(opened: pq.ParquetFile, frames: range | None) -> list[int]:
    """Row groups that may have rows of some frames, by the statistics of the file."""
    every = list(range(opened.num_row_groups))
    if frames is None or "frame_id" not in opened.schema_arrow.names:
        return every
    at = opened.schema_arrow.names.index("frame_id")
    kept = []
    for group in every:
        known = opened.metadata.row_group(group).column(at).statistics
        if known is None or not known.has_min_max or (known.min < frames.stop and known.max >= frames.start):
            kept.append(group)
    return kept


def _bytes_of(file: Path) -> bytes:
    try:
        data = file.read_bytes()
    except OSError as error:
        raise UsageError(f"{file}: cannot be read: {error.strerror}") from error
    if not data.strip():
        raise NotComparableError(f"{file}: the file is empty, so there is nothing to score")
    if file.suffix.lower() != ".csv":
        raise UsageError(f"{file}: not a Parquet file; give Parquet, or CSV in a file whose name ends in .csv")
    return data


def _is_parquet(file: Path) -> bool:
    """Whether a file, held against its checksum, is Parquet."""
    try:
        about = file.stat()
        _check_checksum(file, (about.st_ino, about.st_size, about.st_mtime_ns))
        with file.open("rb") as opened:
            return opened.read(len(_MAGIC)) == _MAGIC
    except OSError as error:
        raise UsageError(f"{file}: cannot be read: {error.strerror}") from error


def _opened(file: Path) -> pq.ParquetFile:
    """A Parquet file, to read parts of."""
    try:
        # By its bytes, not its path, which is searched for partitions (`run=3/estimates.parquet` gets a column).
        return pq.ParquetFile(pa.OSFile(str(file)))
    except (OSError, ValueError, pa.ArrowException) as error:
        raise _damaged(file, error) from error


@lru_cache(maxsize=64)
def _check_checksum(file: Path, version: tuple[int, int, int]) -> None:
    """Refuse a file that is not the one that its checksum was written for; without a checksum nothing is known.

    `version` tells the file from a later one of the same name: it is read once for all its shards.
    """
    del version
    beside = file.with_name(file.name + CHECKSUM)
    try:
        known = Folder(beside.parent).read(beside.name, most=4096).decode("ascii").split()[0]
    except MissingFile:
        return
    except (DataError, ValueError, IndexError) as error:
        raise DataError(f"{beside}: not a checksum ({first_line(error)}); solve again, or delete it") from error
    with file.open("rb") as opened:
        digest = hashlib.file_digest(opened, "sha256").hexdigest()
    if known != digest:
        raise DataError(
            f"{file}: altered: its sha256 is not that in {beside.name}; solve again, or delete {beside.name} if the "
            "change was intended"
        )


def _with_dataset(file: Path, table: pa.Table) -> pa.Table:
    """The table with the dataset that its column `dataset_id` names in its metadata, where `roundel solve` has it."""
    if DATASET not in table.column_names:
        return table
    named = [value for value in pc.unique(table[DATASET]).to_pylist() if value is not None]
    for value in named:
        if not re.fullmatch(f"[0-9a-f]{{{_LEAST_DIGITS},64}}", str(value)):
            raise UsageError(
                f"{file}: dataset_id is {value!r}; give that of manifest.json, or {_LEAST_DIGITS} of its digits"
            )
    if len(named) > 1:
        raise UsageError(
            f"{file}: rows of {len(named)} datasets ({named[0][:12]}, {named[1][:12]}); give a file of one"
        )
    about = {METADATA: json.dumps({"dataset_id": named[0]})} if named else {}
    return table.drop_columns([DATASET]).replace_schema_metadata({**(table.schema.metadata or {}), **about})


def dataset_of(table: pa.Table) -> str | None:
    """The dataset_id of a file of estimates, or its first digits; None if the file does not say it."""
    try:
        return str(json.loads((table.schema.metadata or {})[METADATA])["dataset_id"])
    except (KeyError, TypeError, ValueError):
        return None


def images_of(table: pa.Table) -> str | None:
    """The checksum of the images in the metadata of a file of estimates; None if there is none."""
    try:
        return str(json.loads((table.schema.metadata or {})[METADATA])["images_sha256"])
    except (KeyError, TypeError, ValueError):
        return None


def _read_csv(file: Path, data: bytes) -> pa.Table:
    try:
        # A byte order mark is not part of the first column's name.
        text = data.decode("utf-8-sig").lstrip("\r\n")
    except UnicodeDecodeError as error:
        raise UsageError(f"{file}: not UTF-8 at byte {error.start}; save it as UTF-8") from error
    # What a comment above the header names is that of all rows.
    made_of, text = _comment(text)
    names = _header(file, text)
    if is_bop_results(names):
        return read_bop_results(file, text)
    types = {field.name: field.type for field in _SCHEMA if not pa.types.is_list(field.type)}
    try:
        table = pa_csv.read_csv(
            pa.BufferReader(text.encode()),
            read_options=pa_csv.ReadOptions(column_names=names, skip_rows=1),
            convert_options=pa_csv.ConvertOptions(
                column_types={**types, "distortion": pa.string(), DATASET: pa.string()},
                # NaN is kept and rejected later: missing values must be empty.
                null_values=[""],
                strings_can_be_null=True,
                quoted_strings_can_be_null=False,
            ),
        )
    except (OSError, ValueError, pa.ArrowException) as error:
        raise UsageError(f"{file}: not a CSV file of estimates: {first_line(error)}") from error
    if made_of is not None and DATASET not in table.column_names:
        table = table.append_column(DATASET, pa.array([made_of] * table.num_rows, pa.string()))
    if "distortion" in table.column_names:
        try:
            lists = [[float(number) for number in (text or "").split()] for text in table["distortion"].to_pylist()]
        except ValueError as error:
            raise UsageError(f"{file}: column distortion must be numbers separated by spaces: {error}") from error
        at = table.column_names.index("distortion")
        table = table.set_column(at, "distortion", pa.array(lists, pa.list_(pa.float64())))
    return table


def _comment(text: str) -> tuple[str | None, str]:
    """The dataset_id in comments above the header, such as `# dataset_id: 0123456789ab`, and the text without them."""
    made_of = None
    while text.startswith("#"):
        line, _, text = text.partition("\n")
        found = re.match(r"#\s*dataset_id\s*[:=]?\s*(\S+)", line)
        made_of = found[1] if found else made_of
    return made_of, text


def _header(file: Path, text: str) -> list[str]:
    line = next(iter(text.splitlines()), "")
    try:
        names = [name.strip() for name in next(csv.reader([line]), [])]
    except csv.Error as error:
        raise UsageError(f"{file}: the header is not CSV: {error}") from error
    other = next((what for mark, what in _SEPARATORS.items() if len(names) == 1 and mark in line), None)
    if other:
        raise UsageError(f"{file}: columns are separated by {other}; use commas, and decimal points")
    return names


def _filled(table: pa.Table, given: set[str], stem: str) -> pa.Table:
    """The table with the defaults of missing columns, see `validate/estimates/schema.py`."""
    rows = table.num_rows

    def put(name: str, values: object) -> None:
        nonlocal table
        at = _SCHEMA.get_field_index(name)
        table = table.set_column(at, name, pa.array(values, _SCHEMA.field(at).type))

    if "status" not in given:
        there = [table[name].is_valid() for name in (*NORMAL, *CENTRE, *ELLIPSE, *CENTRE_IMAGE)]
        anything = there[0]
        for column in there[1:]:
            anything = pc.or_(anything, column)
        put("status", ["ok" if some else "failed" for some in anything.to_pylist()])
    for name, value in (("method", stem), ("intrinsics", "true"), ("detection_id", 0), ("candidate", 0)):
        if name not in given:
            put(name, [value] * rows)
    if "chosen" not in given:
        # A single pose is the chosen one; of two poses none is.
        keys = list(zip(*(table[name].to_pylist() for name in KEY[:-1]), strict=True))
        counts: dict[object, int] = {}
        for key in keys:
            counts[key] = counts.get(key, 0) + 1
        status = table["status"].to_pylist()
        put("chosen", [counts[key] == 1 and its == "ok" for key, its in zip(keys, status, strict=True)])
    put("reason", [reason or "" for reason in table["reason"].to_pylist()])
    put("distortion_model", [model or "opencv" for model in table["distortion_model"].to_pylist()])
    if "skew_px" not in given and INTRINSICS[0] in given:
        put("skew_px", [None if focal is None else 0.0 for focal in table[INTRINSICS[0]].to_pylist()])
    return table
