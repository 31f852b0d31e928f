"""Invalid estimates and baselines, through the command: exit status 2 or 3 (4 for damaged Parquet), and one line."""

import io
import json
import os
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers_reports import POINTS, estimate_rows, make_dataset, write_estimates
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from roundel.cli.main import main
from roundel.scenes.errors import RoundelError
from roundel.solver.estimates import METADATA, Estimate
from roundel.solver.estimates import write_estimates as write_records
from roundel.validate.estimates.reader import read_estimates
from roundel.validate.estimates.runs import read_runs
from roundel.validate.gate.baseline import read_baseline

SMALL = POINTS.replace("frames_per_cell: 4", "frames_per_cell: 1")
POSE = "frame_id,normal_x,normal_y,normal_z,centre_x_m,centre_y_m,centre_z_m"
GOOD = "0,0,0,-1,0,0,1.2"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return make_dataset(tmp_path_factory.mktemp("bad") / "ds", SMALL)


@pytest.fixture(scope="module")
def rows(dataset):
    return estimate_rows(dataset, ["true"])


def refused(capsys, code, sentence, dataset, *files):
    """The command ends with this code and says one line, with what was wrong and in which file."""
    out = files[0].parent / "report"
    assert main(["validate", str(dataset.path), *map(str, files), "--out", str(out)]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert sentence in captured.err
    assert captured.err.startswith("roundel: ")
    assert captured.err.count("\n") == 1
    assert "internal error" not in captured.err
    assert not out.exists()
    return captured.err


def csv_of(tmp_path, *lines, name="mine.csv", encoding="utf-8", end="\n"):
    file = tmp_path / name
    file.write_bytes((end.join(lines) + end).encode(encoding))
    return file


@pytest.mark.parametrize(
    ("change", "code", "sentence"),
    [
        ({"frame_id": 99}, 3, "the estimates have frame 99, which"),
        ({"frame_id": -1}, 3, "the estimates have frame -1, which"),
        ({"frame_id": 2**62}, 3, f"the estimates have frame {2**62}, which"),
        ({"candidate": 1}, 2, "two rows for frame 0"),
        ({"normal_x": float("nan")}, 2, "a number of its pose is missing or not finite"),
        ({"centre_z_m": float("inf")}, 2, "a number of its pose is missing or not finite"),
        ({"ellipse_a_px": None}, 2, "a number of its ellipse is missing or not finite"),
        ({"normal_z": -2.0}, 2, "normal is not of unit length"),
        ({"centre_z_m": -1.0}, 2, "centre is behind the camera"),
        ({"normal_x": 0.0, "normal_y": 0.0, "normal_z": 1.0}, 2, "normal points away"),
        ({"fx_px": 0.0}, 2, "focal lengths are not positive"),
        ({"status": "great"}, 2, "neither ok nor failed"),
        ({"chosen": None}, 2, "column chosen has empty values, the first in row 1"),
    ],
)
def test_rows_that_cannot_be(dataset, rows, tmp_path, capsys, change, code, sentence):
    file = write_estimates(tmp_path / "mine.parquet", [{**rows[0], **change}, *rows[1:]])
    assert str(file) in refused(capsys, code, sentence, dataset, file)


def test_the_same_file_twice(dataset, rows, tmp_path, capsys):
    file = write_estimates(tmp_path / "mine.parquet", rows)
    refused(capsys, 2, "has method ml with true intrinsics", dataset, file, file)


@pytest.mark.parametrize(
    ("lines", "code", "sentence"),
    [
        ((POSE,), 3, "no rows"),
        (("",), 3, "the file is empty"),
        ((POSE, GOOD, GOOD), 2, "two rows for frame 0"),
        ((POSE.replace("normal_y,", ""), "0,0,-1,0,0,1.2"), 2, "has no column normal_y"),
        (("frame_id,mood", "0,well"), 2, "has no columns of a pose (normal_x .. centre_z_m), nor ellipse"),
        (("normal_x,normal_y", "0,0"), 2, "has no column frame_id"),
        ((POSE.replace("centre_x_m", "center_x_m"), GOOD), 2, "'center_x_m'; did you mean centre_x_m?"),
        ((POSE.replace("normal_y", "normal_x"), GOOD), 2, "column 'normal_x' appears twice"),
        ((POSE, "0,nan,nan,nan,nan,nan,nan"), 2, "missing or not finite"),
        ((POSE, "0,0,0,-1,0,0,"), 2, "missing or not finite"),
        ((POSE, "0,0,0,-1,0,0,inf"), 2, "missing or not finite"),
        ((POSE, "0,0,0,-1.001,0,0,1.2"), 2, "not of unit length"),
        ((POSE, "0,0,0,1,0,0,-1.2"), 2, "behind the camera"),
        ((POSE, "0,0,0,-1,0,0,1200"), 2, "is its centre in metres?"),
        ((POSE, "99999999999999999999,0,0,-1,0,0,1.2"), 2, "not a CSV file of estimates"),
        ((POSE, "0.5,0,0,-1,0,0,1.2"), 2, "not a CSV file of estimates"),
        ((POSE, ",0,0,-1,0,0,1.2"), 2, "column frame_id has empty values"),
        ((POSE, "0,0,0,-1,0,0,1,2"), 2, "not a CSV file of estimates"),
        ((POSE, '0,0,0,-1,0,0,"1,2"'), 2, "not a CSV file of estimates"),
        ((POSE.replace(",", ";"), GOOD.replace(",", ";")), 2, "separated by semicolons; use commas"),
        ((POSE.replace(",", "\t"), GOOD.replace(",", "\t")), 2, "separated by tabs"),
        ((f"{POSE},intrinsics", f"{GOOD},default"), 2, "they are optional only for intrinsics `true`"),
        ((f"{POSE},fx_px", f"{GOOD},900"), 2, "has no column fy_px, cx_px, cy_px"),
        ((f"{POSE},status", "0,,,,,,,ok"), 2, "pose, ellipse and centre are missing"),
        ((f"{POSE},candidate", f"{GOOD},2"), 2, "neither 0 nor 1"),
        ((f"{POSE},candidate", f"{GOOD},200"), 2, "not a CSV file of estimates"),
        (
            ("frame_id,ellipse_x_px,ellipse_y_px,ellipse_a_px,ellipse_b_px,ellipse_angle_deg", "0,9,9,2,3,0"),
            2,
            "a >= b",
        ),
        (("frame_id,centre_image_x_px", "0,9"), 2, "has no column centre_image_y_px"),
        (("frame_id,centre_image_x_px,centre_image_y_px", "0,9,nan"), 2, "a number of its centre is missing"),
        (
            ("frame_id,candidate,centre_image_x_px,centre_image_y_px", "0,0,9,9", "0,1,9,9"),
            2,
            "no pose to distinguish them",
        ),
    ],
)
def test_csv_that_cannot_be(dataset, tmp_path, capsys, lines, code, sentence):
    file = csv_of(tmp_path, *lines)
    # A separator or a decimal comma is the file's; what a row says is said with its place.
    assert "mine" in refused(capsys, code, sentence, dataset, file)


def test_csv_in_another_alphabet(dataset, tmp_path, capsys):
    named = (f"{POSE},method", f"{GOOD},Möller")
    refused(capsys, 2, "not UTF-8", dataset, csv_of(tmp_path, *named, encoding="latin-1"))
    refused(capsys, 2, "not UTF-8", dataset, csv_of(tmp_path, *named, encoding="utf-16"))


def test_another_datasets_estimates(dataset, rows, tmp_path, capsys):
    file = tmp_path / "estimates.parquet"
    write_records([Estimate(0, -1, "mine", "true", "failed", "too dark")], file, "0" * 64)
    refused(capsys, 3, "estimates are of dataset 000000000000", dataset, file)
    # CSV says nothing of its dataset: its frames alone tell.
    file.with_name("estimates.parquet.sha256").unlink()
    table = pq.read_table(write_estimates(file, rows))
    pq.write_table(table.replace_schema_metadata({METADATA: b"not JSON"}), file)
    assert len(read_runs([file], dataset)) == 1


def test_a_changed_byte_is_named(dataset, tmp_path, capsys):
    file = tmp_path / "estimates.parquet"
    write_records([Estimate(0, -1, "mine", "true", "failed", "too dark")], file, dataset.manifest["dataset_id"])
    whole = file.read_bytes()
    for at in range(0, len(whole), 400):
        file.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        refused(capsys, 4, "altered: its sha256 is not that in estimates.parquet.sha256", dataset, file)


def test_files_of_another_kind(dataset, rows, tmp_path, capsys):
    none = tmp_path / "none.parquet"
    refused(capsys, 2, "no estimates found", dataset, none)
    none.touch()
    refused(capsys, 3, "the file is empty", dataset, none)
    none.write_text("frame_id is no magic number\n")
    refused(capsys, 2, "not a Parquet file; give Parquet, or CSV", dataset, none)
    folder = tmp_path / "folder"
    folder.mkdir()
    refused(capsys, 2, "no estimates found", dataset, folder)
    (tmp_path / "folder.csv").mkdir()
    refused(capsys, 2, "no estimates found", dataset, tmp_path / "folder.csv")
    whole = write_estimates(tmp_path / "whole.parquet", rows).read_bytes()
    none.write_bytes(whole[: len(whole) // 2])
    refused(capsys, 4, "damaged or truncated Parquet file", dataset, none)
    refused(capsys, 3, "no rows", dataset, write_estimates(tmp_path / "no_rows.parquet", []))


def test_columns_of_another_type(dataset, tmp_path, capsys):
    file = tmp_path / "mine.parquet"
    good = {name: [value] for name, value in zip(POSE.split(","), (0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.2), strict=True)}
    for column, value in (("frame_id", 2.5), ("frame_id", [1]), ("normal_x", "wide"), ("centre_z_m", {"z": 1.0})):
        pq.write_table(pa.table({**good, column: [value]}), file)
        refused(capsys, 2, f"column {column} is not", dataset, file)
    pq.write_table(pa.table({**good, "frame_id": pa.array([2**63], pa.uint64())}), file)
    refused(capsys, 2, "column frame_id is not int64", dataset, file)
    twice = pa.Table.from_arrays([pa.array([0])] * 2, names=["frame_id", "frame_id"])
    pq.write_table(twice, file)
    refused(capsys, 2, "column 'frame_id' appears twice", dataset, file)


def test_a_hostile_name_stays_on_its_line(dataset, tmp_path, capsys):
    file = csv_of(tmp_path, f"{POSE},method", '0,0,0,-2,0,0,1.2,"two\nlines"')
    refused(capsys, 2, "not of unit length", dataset, file)


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads what nobody may")
def test_a_file_that_may_not_be_read(dataset, rows, tmp_path, capsys):
    file = write_estimates(tmp_path / "mine.parquet", rows)
    file.chmod(0)
    refused(capsys, 2, "cannot be read", dataset, file)


def test_baselines_that_are_none(tmp_path, capsys):
    """Of another format: not comparable. The rest of the gate's refusals are tests of the gate."""
    file = tmp_path / "baseline.parquet"
    facts = json.dumps({"schema": 99}).encode()
    pq.write_table(pa.table({"frame_id": [0]}).replace_schema_metadata({b"roundel_baseline": facts}), file)
    with pytest.raises(RoundelError, match="format 99") as caught:
        read_baseline(file)
    assert caught.value.exit_code == 3


# What follows asks only that nothing but a RoundelError comes out.
FUZZ = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)


def _survives(read, file: Path, data: bytes) -> None:
    file.write_bytes(data)
    with suppress(RoundelError):
        read(file)


@FUZZ
@given(data=st.binary(max_size=400), head=st.sampled_from([b"", b"PAR1", POSE.encode() + b"\n", b"\xef\xbb\xbf"]))
@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
def test_any_bytes(dataset, tmp_path, name, head, data):
    _survives(lambda file: read_runs([file], dataset), tmp_path / name, head + data)
    _survives(read_baseline, tmp_path / name, head + data)


@FUZZ
@given(text=st.text(alphabet="0123456789.,-+eE\n\r\"' \tnaif;#", max_size=200))
def test_any_numbers_in_csv(dataset, tmp_path, text):
    _survives(lambda file: read_runs([file], dataset), tmp_path / "a.csv", f"{POSE}\n{text}".encode())


@FUZZ
@given(seed=st.integers(0, 2**32 - 1))
def test_mutated_parquet(dataset, rows, tmp_path, seed):
    rng = np.random.default_rng(seed)
    sink = io.BytesIO()
    pq.write_table(pq.read_table(write_estimates(tmp_path / "good.parquet", rows[:4])), sink)
    data = bytearray(sink.getvalue())
    for _ in range(int(rng.integers(1, 6))):
        # The footer is where a reader's decisions are.
        at = (
            int(rng.integers(max(4, len(data) - 3000), len(data)))
            if rng.random() < 0.7
            else int(rng.integers(len(data)))
        )
        data[at] = int(rng.integers(256))
    _survives(read_estimates, tmp_path / "a.parquet", bytes(data))
    _survives(read_baseline, tmp_path / "a.parquet", bytes(data))
