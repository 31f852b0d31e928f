"""Scores of a dataset on disk: they are read where they are used, and memory holds those of one shard."""

from __future__ import annotations

import hashlib
import tempfile
from contextlib import suppress
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from roundel.datasets.store.writing import write_failure
from roundel.scenes.errors import DataError
from roundel.validate.scores.scores import SCORES_SCHEMA, sorted_scores

# Of the file on disk: as many as are read at once, and of a row group of scores.parquet.
_ROWS = 1 << 16


class ScoresOnDisk:
    """A temporary file to which the scores of shards are added, in order of their frames; it ends with the block.

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
        self._path = Path(self._folder.name) / "scores.arrow"
        self.parquet = self._path.with_name("scores.parquet")
        self._writer: pa.RecordBatchFileWriter | None = None

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

    def add(self, table: pa.Table) -> None:
        """Add the scores of a shard, whose frames come after those before.

        Raises
        ------
        DataError
            If they cannot be written.
        """
        try:
            if self._writer is None:
                self._writer = pa.ipc.new_file(str(self._path), SCORES_SCHEMA)
            self._writer.write_table(sorted_scores(table))
        except OSError as error:
            raise write_failure(self._path, error) from error

    def table(self) -> pa.Table:
        """All of them, in the order of their key; the columns are read from the disk when they are used.

        Raises
        ------
        DataError
            If the last of them cannot be written.
        """
        try:
            self._close()
            with pa.memory_map(str(self._path)) as opened:
                return pa.ipc.open_file(opened).read_all()
        except OSError as error:
            raise write_failure(self._path, error) from error


def write_scores(table: pa.Table, path: Path) -> str:
    """Write scores.parquet and return its sha256; the bytes depend on the rows alone.

    Raises
    ------
    DataError
        If it cannot be written.
    """
    try:
        with pq.ParquetWriter(str(path), table.schema, compression="zstd") as writer:
            for start in range(0, max(table.num_rows, 1), _ROWS):
                writer.write_table(table.slice(start, _ROWS).combine_chunks())
        with path.open("rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError as error:
        raise write_failure(path, error) from error
