"""Scores of a dataset on disk: the few of a small dataset are read at once, of a large one a column when it is used."""

from __future__ import annotations

import hashlib
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from roundel.datasets.store.writing import write_failure
from roundel.scenes.errors import DataError, first_line
from roundel.validate.metrics.rows import Rows
from roundel.validate.scores.scores import SCORES_SCHEMA, sorted_scores

# Of a row group of scores.parquet, and the most that are kept in memory: some 12 MB.
_ROWS = 1 << 14


class RowsOnDisk:
    """Rows of a Parquet file, each column read when it is asked for; see `Rows`."""

    def __init__(self, path: Path, rows: NDArray[np.int64] | None = None) -> None:
        self._path = path
        self._rows = rows

    @property
    def num_rows(self) -> int:
        """Number of rows."""
        return int(pq.read_metadata(self._path).num_rows) if self._rows is None else len(self._rows)

    @property
    def column_names(self) -> list[str]:
        """Names of the columns."""
        return list(pq.read_schema(self._path).names)

    def __getitem__(self, name: str) -> pa.ChunkedArray:
        """A column, from the disk."""
        try:
            with pq.ParquetFile(self._path) as file:
                column = file.read(columns=[name], use_threads=False)[name]
        except OSError as error:
            raise DataError(f"{self._path}: cannot be read ({first_line(error)}); run the command again") from error
        return column if self._rows is None else column.take(pa.array(self._rows))

    def filter(self, mask: Any) -> RowsOnDisk:
        """The rows where a `pyarrow` array of bool is true."""
        wanted = np.flatnonzero(mask.to_numpy(zero_copy_only=False))
        return self if len(wanted) == self.num_rows else self.take(wanted)

    def take(self, indices: Any) -> RowsOnDisk:
        """The rows of these numbers."""
        mine = np.asarray(indices)
        return RowsOnDisk(self._path, mine if self._rows is None else self._rows[mine])


class ScoresOnDisk:
    """A temporary scores.parquet to which the scores of shards are added, in order of their frames.

    Its bytes depend on the rows alone. It ends with the block.

    Raises
    ------
    DataError
        If there is no room for temporary files.
    """

    def __init__(self) -> None:
        try:
            self._folder = tempfile.TemporaryDirectory(prefix="roundel-")
        except OSError as error:
            raise DataError(
                f"{tempfile.gettempdir()}: cannot write there ({error.strerror}); free some space, or set TMPDIR"
            ) from error
        self.parquet = Path(self._folder.name) / "scores.parquet"
        self._writer: pq.ParquetWriter | None = None
        self._waiting: pa.Table = SCORES_SCHEMA.empty_table()
        self.sha256 = ""

    def __enter__(self) -> ScoresOnDisk:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # of a full disk, which was said
            self._close()
        self._folder.cleanup()

    def _close(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def _write(self, rows: pa.Table) -> None:
        if self._writer is None:
            self._writer = pq.ParquetWriter(str(self.parquet), SCORES_SCHEMA, compression="zstd")
        self._writer.write_table(rows.combine_chunks())

    def add(self, table: pa.Table) -> None:
        """Add the scores of a shard, whose frames come after those before.

        Raises
        ------
        DataError
            If they cannot be written.
        """
        rows = pa.concat_tables([self._waiting, sorted_scores(table)])
        try:
            while rows.num_rows >= _ROWS:
                self._write(rows.slice(0, _ROWS))
                rows = rows.slice(_ROWS)
        except OSError as error:
            raise write_failure(self.parquet, error) from error
        # A copy, because a slice keeps what was written in memory.
        self._waiting = pa.concat_tables([rows]).combine_chunks() if rows.num_rows else SCORES_SCHEMA.empty_table()

    def finish(self) -> Rows:
        """All rows in the order of their key, when the last are added; `sha256` is that of the file then.

        Raises
        ------
        DataError
            If the last rows cannot be written, or the file not be read.
        """
        few = self._writer is None
        try:
            if few or self._waiting.num_rows:
                self._write(self._waiting)
            self._close()
            with self.parquet.open("rb") as opened:
                self.sha256 = hashlib.file_digest(opened, "sha256").hexdigest()
        except OSError as error:
            raise write_failure(self.parquet, error) from error
        return self._waiting if few else RowsOnDisk(self.parquet)
