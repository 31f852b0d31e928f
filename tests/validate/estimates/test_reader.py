"""Estimates read from files: Roundel's, third-party, and invalid ones."""

from pathlib import Path

import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest

from roundel.scenes.errors import DataError, UsageError
from roundel.solver.estimates import Estimate, estimates_schema, write_estimates
from roundel.validate.estimates.reader import dataset_of, read_estimates
from roundel.validate.estimates.schema import COLUMNS, columns_json, columns_markdown

FAILED = Estimate(3, 0, "mine", "true", status="failed", reason="too dark")
POSE = "frame_id,normal_x,normal_y,normal_z,centre_x_m,centre_y_m,centre_z_m\n"


def test_estimates_that_are_none(tmp_path):
    with pytest.raises(UsageError, match="no estimates found"):
        read_estimates(tmp_path)
    file = tmp_path / "estimates.parquet"
    file.write_bytes(b"PAR1")
    with pytest.raises(DataError, match="damaged or truncated Parquet file"):
        read_estimates(file)
    write_estimates([], file)
    assert read_estimates(tmp_path).num_rows == 0


def test_the_file_says_what_it_is_of(tmp_path):
    write_estimates([FAILED], tmp_path / "estimates.parquet", "abc")
    assert dataset_of(read_estimates(tmp_path)) == "abc"
    (tmp_path / "other").mkdir()
    write_estimates([FAILED], tmp_path / "other" / "estimates.parquet")
    assert dataset_of(read_estimates(tmp_path / "other")) is None


def test_what_nobody_must_give_is_filled_in(tmp_path):
    (tmp_path / "mine.csv").write_text(f"{POSE}3,0,0,-1,0.1,0,2\n4,,,,,,\n")
    table = read_estimates(tmp_path / "mine.csv")
    assert (table.schema.names, table.schema.types) == (estimates_schema().names, estimates_schema().types)
    pose, nothing = table.to_pylist()
    expected = {"method": "mine", "intrinsics": "true", "detection_id": 0, "candidate": 0, "reason": ""}
    assert expected.items() <= pose.items()
    assert expected.items() <= nothing.items()
    assert (pose["status"], pose["chosen"], pose["distortion_model"]) == ("ok", True, "opencv")
    assert (nothing["status"], nothing["chosen"]) == ("failed", False)
    assert table["fx_px"].null_count == 2
    # Of two poses, none is meant unless the file says which.
    two = POSE.replace("frame_id", "frame_id,candidate")
    (tmp_path / "mine.csv").write_text(f"{two}3,0,0,0,-1,0.1,0,2\n3,1,0,0,-1,0.2,0,2\n")
    assert read_estimates(tmp_path / "mine.csv")["chosen"].to_pylist() == [False, False]


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


@pytest.mark.parametrize("prefix", ["", "\ufeff", "\r\n\n"])
def test_csv_as_spreadsheets_write_it(tmp_path, prefix):
    rows = f"{POSE}3,0,0,-1,0.1,0,2\n".replace("\n", "\r\n").replace("frame_id,", "frame_id , ")
    (tmp_path / "mine.csv").write_bytes((prefix + rows).encode())
    assert read_estimates(tmp_path / "mine.csv")["frame_id"].to_pylist() == [3]


def test_a_folder_named_as_a_partition_adds_no_column(tmp_path):
    # Read by its path, `frame_id=7/` would be taken for the values of a column.
    write_estimates([FAILED], tmp_path / "frame_id=7" / "estimates.parquet")
    assert read_estimates(tmp_path / "frame_id=7")["frame_id"].to_pylist() == [3]


@pytest.mark.parametrize(
    ("column", "text", "message"),
    [("normal_x", "wide", "not a CSV"), ("frame_id", "three", "not a CSV"), ("distortion", "k1", "distortion")],
)
def test_csv_with_a_word_for_a_number(tmp_path, column, text, message):
    values = dict.fromkeys(POSE.strip().split(","), "0") | {"chosen": "true", column: text}
    (tmp_path / "bad.csv").write_text(",".join(values) + "\n" + ",".join(values.values()) + "\n")
    with pytest.raises(UsageError, match=message):
        read_estimates(tmp_path / "bad.csv")


def test_the_schema_that_is_printed_knows_every_column_that_is_read():
    named = {name for given in COLUMNS for name in given.names}
    # Which dataset a file is of is kept beside its rows.
    assert named <= {*estimates_schema().names, "dataset_id"}
    assert all(f"`{name}`" in columns_markdown() for name in named)
    assert {record["column"] for record in columns_json()} == named


def test_the_guide_shows_the_schema():
    guide = Path(__file__).resolve().parents[3] / "docs" / "your-own-method.md"
    assert columns_markdown() in guide.read_text(encoding="utf-8")


def test_columns_of_others_are_left_alone(tmp_path):
    (tmp_path / "estimates.parquet").touch()
    table = pa.table({"frame_id": [1], "centre_image_x_px": [3.0], "centre_image_y_px": [4.0], "mood": ["well"]})
    pq.write_table(table, tmp_path / "estimates.parquet")
    assert read_estimates(tmp_path)["centre_image_x_px"].to_pylist() == [3.0]
