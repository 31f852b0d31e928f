"""Wrong conventions in a CSV: each is named, and right or merely bad estimates never are."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from helpers_conventions import ELLIPSE, STUDY, WRONG, Row, scaled, write
from helpers_reports import estimate_rows, make_dataset, write_estimates

from roundel.datasets.dataset import Dataset
from roundel.solver.estimates import METADATA
from roundel.validate.diagnosis.diagnosis import diagnose


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("diagnosis") / "ds", STUDY)


def random_rows(dataset: Dataset, rng: np.random.Generator, noise_px: float) -> list[Row]:
    """One pose of every circle of some frames, of ellipses with noise."""
    rows = [row for row in estimate_rows(dataset, ["true"], noise_px) if row["candidate"] == 0]
    count = int(rng.integers(12, len(rows) + 1))
    kept = sorted(rng.choice(len(rows), count, replace=False).tolist())
    return [rows[i] for i in kept]


def named(dataset: Dataset, file: Path) -> list[str]:
    return [found.convention for found in diagnose(file, dataset)]


@pytest.mark.parametrize(("name", "part"), [(name, part) for name, (_, parts) in WRONG.items() for part in parts])
def test_a_convention_is_named(dataset, tmp_path, name, part):
    rows = random_rows(dataset, np.random.default_rng(1), 0.05)
    file = write(tmp_path / "mine.csv", [{**row, **WRONG[name][0](row, part)} for row in rows], part)
    assert named(dataset, file) == [name]


@pytest.mark.slow
def test_each_of_ten_conventions_is_named_in_95_of_100_files(dataset, tmp_path):
    rng = np.random.default_rng(17)
    wrong = []
    for case in range(100):
        name = list(WRONG)[case % len(WRONG)]
        change, parts = WRONG[name]
        part = parts[int(rng.integers(len(parts)))]
        rows = random_rows(dataset, rng, float(rng.uniform(0, 0.2)))
        file = write(tmp_path / "mine.csv", [{**row, **change(row, part)} for row in rows], part)
        found = named(dataset, file)
        if found != [name]:
            wrong.append((case, name, part, found))
    assert len(wrong) <= 5, wrong
    # No convention is among the misses more than once in its ten.
    assert max((sum(name == n for _, n, _, _ in wrong) for name in WRONG), default=0) <= 1, wrong


@pytest.mark.parametrize("noise_px", [0.0, 0.1, 0.3, 1.0, 10.0])
@pytest.mark.parametrize("part", ["ellipse", "pose"])
def test_a_right_file_is_never_diagnosed(dataset, tmp_path, part, noise_px):
    rng = np.random.default_rng(5)
    for _ in range(2):
        rows = random_rows(dataset, rng, noise_px)
        assert named(dataset, write(tmp_path / "mine.csv", rows, part)) == []


def test_a_bad_detector_is_not_diagnosed(dataset, tmp_path):
    rng = np.random.default_rng(3)
    rows = random_rows(dataset, rng, 0.1)
    guess = [{**row, ELLIPSE[0]: rng.uniform(0, 1280), ELLIPSE[1]: rng.uniform(0, 720)} for row in rows]
    assert named(dataset, write(tmp_path / "guess.csv", guess, "ellipse")) == []
    # Too large by a fifth, as one that fits the outer edge of a blurred border.
    large = [{**row, **scaled(ELLIPSE[2:4], 1.2)(row, "")} for row in rows]
    assert named(dataset, write(tmp_path / "large.csv", large, "ellipse")) == []
    # Of two circles, nothing is concluded.
    change = WRONG["millimetres"][0]
    few = [{**row, **change(row, "pose")} for row in rows[:2]]
    assert named(dataset, write(tmp_path / "few.csv", few, "pose")) == []


def test_a_point_alone_is_diagnosed_too(dataset, tmp_path):
    names = ["centre_image_x_px", "centre_image_y_px"]
    rows = [{n: row[n] for n in ("frame_id", *names)} for row in dataset.truth.to_pylist()]
    for name, change in {
        "half_pixel": lambda r: {n: r[n] + 0.5 for n in names},
        "y_upwards": lambda r: {names[1]: 719 - r[names[1]]},
        "swapped_xy": lambda r: {names[0]: r[names[1]], names[1]: r[names[0]]},
    }.items():
        file = tmp_path / "mine.csv"
        pa_csv.write_csv(pa.Table.from_pylist([{**r, **change(r)} for r in rows]), file)
        assert named(dataset, file) == [name]


def test_a_method_that_roundel_ran_is_not_looked_at(dataset, tmp_path):
    rows = [r for r in estimate_rows(dataset, ["true"]) if r["candidate"] == 0]
    wrong = [{**row, **WRONG["full_axes"][0](row, "")} for row in rows]
    for method, expected in (("pixels", []), ("mine", ["full_axes"])):
        file = write_estimates(tmp_path / "estimates.parquet", [{**row, "method": method} for row in wrong])
        about = {"dataset_id": dataset.manifest["dataset_id"], "images_sha256": dataset.images.images_sha256}
        pq.write_table(pq.read_table(file).replace_schema_metadata({METADATA: json.dumps(about)}), file)
        assert named(dataset, file) == expected


def test_it_says_by_how_much(dataset, tmp_path):
    rows = [row for row in estimate_rows(dataset, ["true"], 0.1) if row["candidate"] == 0]
    change = WRONG["full_axes"][0]
    (found,) = diagnose(write(tmp_path / "mine.csv", [{**r, **change(r, "")} for r in rows], "ellipse"), dataset)
    assert (found.circles, found.fit_before, found.fit_after, found.median_before_px) == (60, 0, 60, None)
    assert 0 < found.median_after_px < 0.2
    assert found.sentence.startswith(
        "mine.csv: it seems that the file has the full axes of its ellipses, not the semi-axes. With that undone, the "
        "ellipse of method mine (true) fits 60 of 60 circles, 0."
    )
    assert found.sentence.endswith("as given 0 do. To correct it, halve ellipse_a_px and ellipse_b_px")
