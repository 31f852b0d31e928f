"""Estimates read from files: ours, other people's, and what is none."""

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest

from roundel.scenes.errors import DataError, UsageError
from roundel.solver.estimates import SCHEMA, Estimate, write_estimates
from roundel.validate.estimates_file import REQUIRED, read_estimates

FAILED = Estimate(3, 0, "mine", "true", status="failed", reason="too dark")


def test_estimates_that_are_none(tmp_path):
    with pytest.raises(UsageError, match="no estimates there"):
        read_estimates(tmp_path)
    file = tmp_path / "estimates.parquet"
    file.write_bytes(b"PAR1")
    with pytest.raises(DataError, match="not a Parquet file"):
        read_estimates(file)
    write_estimates([], file)
    assert read_estimates(tmp_path).num_rows == 0


def test_what_nobody_must_give_is_filled_in(tmp_path):
    file = tmp_path / "estimates.parquet"
    write_estimates([FAILED], file)
    ours = read_estimates(file)
    assert (ours.schema.names, ours.schema.types) == (SCHEMA.names, SCHEMA.types)
    pq.write_table(ours.select(list(REQUIRED)), file)
    theirs = read_estimates(file)
    assert theirs.schema == ours.schema
    assert theirs["distortion_model"].to_pylist() == ["opencv"]
    assert theirs["cov_05"].null_count == 1
    pq.write_table(ours.drop_columns(["normal_y", "status"]), file)
    with pytest.raises(DataError, match="has no column normal_y, status"):
        read_estimates(file)


def test_csv_says_the_same(tmp_path):
    write_estimates([FAILED], tmp_path / "estimates.parquet")
    ours = read_estimates(tmp_path)
    text = ours.set_column(
        ours.column_names.index("distortion"), "distortion", pa.array(["-0.1 0.02 0 0"], pa.string())
    )
    pa_csv.write_csv(text, tmp_path / "mine.csv")
    found = read_estimates(tmp_path / "mine.csv")
    assert found.schema == ours.schema
    assert found["distortion"].to_pylist() == [[-0.1, 0.02, 0.0, 0.0]]
    assert found.drop_columns(["distortion"]).equals(ours.drop_columns(["distortion"]))


@pytest.mark.parametrize(
    ("column", "text", "message"),
    [("normal_x", "wide", "not a CSV"), ("frame_id", "three", "not a CSV"), ("distortion", "k1", "distortion")],
)
def test_csv_with_a_word_for_a_number(tmp_path, column, text, message):
    values = dict.fromkeys(REQUIRED, "0") | {"chosen": "true", column: text}
    (tmp_path / "bad.csv").write_text(",".join(values) + "\n" + ",".join(values.values()) + "\n")
    with pytest.raises(DataError, match=message):
        read_estimates(tmp_path / "bad.csv")
