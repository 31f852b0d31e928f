"""Rows of scores: what the statistics, claims and figures read of them, in memory or on disk."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Rows(Protocol):
    """The part of a `pyarrow.Table` that readers of scores use; `RowsOnDisk` is one whose columns are on disk."""

    @property
    def num_rows(self) -> int:
        """Number of rows."""

    @property
    def column_names(self) -> list[str]:
        """Names of the columns."""

    def __getitem__(self, name: str) -> pa.ChunkedArray:
        """A column."""

    def filter(self, mask: Any) -> Rows:
        """The rows where a `pyarrow` array of bool is true."""

    def take(self, indices: Any) -> Rows:
        """The rows of these numbers."""


def column(rows: Rows, name: str) -> Array:
    """A numeric column with NaN for null."""
    return np.asarray(rows[name].to_numpy(zero_copy_only=False), dtype=np.float64)


def flag_column(rows: Rows, name: str) -> Mask:
    """A column of bool without nulls."""
    return np.asarray(rows[name].to_numpy(zero_copy_only=False), dtype=bool)


def text_column(rows: Rows, name: str) -> NDArray[np.object_]:
    """A column of text; equal texts are one object, so that a million rows take little memory."""
    encoded = rows[name].combine_chunks().dictionary_encode()
    values = np.array([*encoded.dictionary.to_pylist(), None], dtype=object)
    return np.asarray(values[encoded.indices.fill_null(len(values) - 1).to_numpy(zero_copy_only=False)])


def where_text(rows: Rows, **wanted: str) -> Mask:
    """Rows whose columns have these texts.

    Examples
    --------
    >>> where_text(pa.table({"method": ["ml", "iht"]}), method="ml").tolist()
    [True, False]
    """
    found = np.ones(rows.num_rows, dtype=bool)
    for name, value in wanted.items():
        found &= np.asarray(pc.equal(rows[name], value).to_numpy(zero_copy_only=False), dtype=bool)
    return found


def those(rows: Rows, mask: Mask) -> Rows:
    """The rows of a mask."""
    return rows.filter(pa.array(mask))


def distinct(rows: Rows, names: Sequence[str]) -> list[tuple[Any, ...]]:
    """The distinct values of several columns together, in the order of their first rows."""
    found = pa.table({name: rows[name] for name in names}).group_by(list(names), use_threads=False).aggregate([])
    return list(zip(*(found[name].to_pylist() for name in names), strict=True))


def texts_of(rows: Rows, name: str) -> list[str]:
    """The distinct texts of a column, in order."""
    return sorted(rows[name].unique().to_pylist())


def circle_keys(rows: Rows) -> NDArray[np.void]:
    """Frame and marker of each row, as one array that can be sorted and matched."""
    keys = np.empty(rows.num_rows, dtype=[("frame_id", np.int64), ("marker_id", np.int64)])
    for name in ("frame_id", "marker_id"):
        keys[name] = rows[name].to_numpy()
    return keys


def shared(a: NDArray[np.void], b: NDArray[np.void]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Places of the circles that are in both, in the order of frames and markers."""
    _, i, j = np.intersect1d(a, b, return_indices=True)
    return i, j


def placed(values: Array, of: NDArray[np.void], at: NDArray[np.void]) -> Array:
    """Values of circles `of`, at the circles `at`; NaN for those that have none."""
    out = np.full(len(at), np.nan)
    i, j = shared(at, of)
    out[i] = values[j]
    return out


def in_memory(rows: Rows, indices: Any) -> pa.Table:
    """A few rows with all their columns."""
    return pa.table({name: rows[name].take(indices) for name in rows.column_names})
