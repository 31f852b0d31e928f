"""Scores on disk: the same rows, whatever is read at once; reports do not depend on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers_reports import BOARDS, estimate_rows, failed_row, make_dataset, write_estimates
from hypothesis import given
from hypothesis import strategies as st

from roundel.datasets.store.records import record_of_document
from roundel.scenes.errors import DataError
from roundel.validate.metrics.rows import (
    circle_keys,
    distinct,
    in_memory,
    placed,
    shared,
    texts_of,
    those,
    where_text,
)
from roundel.validate.scores import scores_on_disk
from roundel.validate.scores.scores_on_disk import RowsOnDisk, ScoresOnDisk
from roundel.validate.validate import validate_dataset


@pytest.fixture(scope="module")
def table() -> pa.Table:
    n = 40
    return pa.table(
        {
            "frame_id": np.repeat(np.arange(n // 2), 2),
            "marker_id": np.tile([0, 1], n // 2),
            "method": ["ml" if i % 3 else "iht" for i in range(n)],
            "error": [None if i % 7 == 0 else i / 3 for i in range(n)],
        }
    )


@pytest.fixture(scope="module")
def on_disk(table: pa.Table, tmp_path_factory: pytest.TempPathFactory) -> RowsOnDisk:
    path = tmp_path_factory.mktemp("rows") / "rows.parquet"
    pq.write_table(table, path, row_group_size=9)
    return RowsOnDisk(path)


masks = st.lists(st.booleans(), min_size=40, max_size=40).map(lambda m: np.array(m, dtype=bool))


@given(first=masks, second=masks)
def test_rows_on_disk_are_those_of_the_table(
    first: np.ndarray, second: np.ndarray, table: pa.Table, on_disk: RowsOnDisk
) -> None:
    theirs, ours = those(table, first), those(on_disk, first)
    assert (ours.num_rows, ours.column_names) == (theirs.num_rows, theirs.column_names)
    theirs, ours = (those(rows, second[: rows.num_rows]) for rows in (theirs, ours))
    for name in table.column_names:
        assert ours[name].to_pylist() == theirs[name].to_pylist()
    assert texts_of(ours, "method") == texts_of(theirs, "method")
    assert distinct(ours, ["method", "marker_id"]) == distinct(theirs, ["method", "marker_id"])
    assert where_text(ours, method="ml").tolist() == where_text(theirs, method="ml").tolist()
    last = pa.array(range(ours.num_rows)[-2:], pa.int64())
    assert in_memory(ours, last).to_pylist() == in_memory(theirs, last).to_pylist() == theirs.take(last).to_pylist()


@given(first=masks, second=masks)
def test_circles_are_matched_by_frame_and_marker(first: np.ndarray, second: np.ndarray, table: pa.Table) -> None:
    a, b = (circle_keys(those(table, mask)) for mask in (first, second))
    i, j = shared(a, b)
    assert a[i].tolist() == b[j].tolist() == sorted(set(a.tolist()) & set(b.tolist()))
    known = dict(zip(a.tolist(), range(len(a)), strict=True))
    expected = [known.get(key, np.nan) for key in b.tolist()]
    np.testing.assert_array_equal(placed(np.arange(len(a), dtype=float), a, b), expected)


@pytest.mark.parametrize("at_once", [5, 16])
def test_a_report_does_not_depend_on_what_is_read_at_once(
    at_once: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = make_dataset(tmp_path / "ds", BOARDS)
    rows = estimate_rows(dataset, ["true", "default", "calibrated:5"], noise_px=0.1, chosen=True)
    rows += estimate_rows(dataset, ["true", "default"], noise_px=0.3, method="other")
    rows = [row for row in rows if row["frame_id"] != 1] + [failed_row(1, "true"), failed_row(1, "default")]
    estimates = write_estimates(tmp_path / "e.parquet", rows)
    summaries = []
    for out in ("whole", "parts"):
        validate_dataset(dataset.path, [estimates], tmp_path / out)
        summary = record_of_document((tmp_path / out / "summary.json").read_bytes())
        # The file's row groups are as long as what is kept in memory.
        del summary["checksums"]["scores.parquet"]
        summaries.append(summary)
        monkeypatch.setattr(scores_on_disk, "_ROWS", at_once)
    assert summaries[0] == summaries[1]
    assert pq.read_table(tmp_path / "whole/scores.parquet") == pq.read_table(tmp_path / "parts/scores.parquet")
    assert pq.ParquetFile(tmp_path / "parts/scores.parquet").num_row_groups > 1
    for folder in ("figures", "tables"):
        names = sorted(path.name for path in (tmp_path / "whole" / folder).iterdir())
        assert names == sorted(path.name for path in (tmp_path / "parts" / folder).iterdir())
        for name in names:
            assert (tmp_path / "whole" / folder / name).read_bytes() == (
                tmp_path / "parts" / folder / name
            ).read_bytes(), name


def test_a_column_that_cannot_be_read_is_one_line(table: pa.Table, tmp_path: Path) -> None:
    pq.write_table(table, tmp_path / "rows.parquet")
    rows = RowsOnDisk(tmp_path / "rows.parquet")
    (tmp_path / "rows.parquet").unlink()
    with pytest.raises(DataError, match=r"rows\.parquet: cannot be read"):
        rows["error"]


def test_the_file_ends_with_the_block() -> None:
    with ScoresOnDisk() as rows:
        rows.finish()
        folder = rows.parquet.parent
        assert pq.read_metadata(rows.parquet).num_rows == 0
    assert not folder.exists()
