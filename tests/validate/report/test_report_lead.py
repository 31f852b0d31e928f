"""What a report opens with: the user's method, named in every tile, and why it failed; pooled levels say so."""

import re
from pathlib import Path

import pytest
from helpers_reports import POINTS, estimate_rows, failed_row, make_dataset, write_estimates

from roundel.datasets.dataset import Dataset
from roundel.validate.report.summary_text import main_run, sentences
from roundel.validate.scores.summary import Summary, main_key
from roundel.validate.validate import validate_dataset

SWEPT = POINTS.replace(
    "frames_per_cell: 4", "frames_per_cell: 2\nsweep: {key: sensor.read_noise_e, levels: [1, 4, 16]}"
)
TRUTH = ("true", "truth")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("lead") / "ds", SWEPT)


@pytest.fixture(scope="module")
def report(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Summary]:
    folder = tmp_path_factory.mktemp("out")
    mine = [r for r in estimate_rows(dataset, ["true"], 0.1, method="mine") if r["frame_id"] not in (3, 4, 5)]
    mine += [failed_row(i, "true", "too <dark>", "mine") for i in (3, 4)]
    rows = [*estimate_rows(dataset, ["true"], 0.05, method="pixels"), *mine]
    file = write_estimates(folder / "e.parquet", rows)
    return folder / "report", validate_dataset(dataset.path, [file], folder / "report")


def test_a_method_of_the_users_leads_before_roundels() -> None:
    keys = [("ml", *TRUTH), ("pixels", *TRUTH), ("zebra", *TRUTH)]
    assert main_key(keys, ["pixels"]) == ("zebra", *TRUTH)
    assert main_key(keys[:2], ["pixels"]) == ("pixels", *TRUTH)
    assert main_key([*keys, ("ant", *TRUTH)], ["pixels", "zebra"]) == ("zebra", *TRUTH)
    # cv2's detector comes with Roundel, too.
    assert main_key([("blobs", *TRUTH), ("pixels", *TRUTH)], ["pixels"]) == ("pixels", *TRUTH)


def test_every_tile_names_the_method(report: tuple[Path, Summary]) -> None:
    folder, summary = report
    assert main_run(summary)["method"] == "mine"
    tiles = re.findall(r'<div class="card">.*?</div>', (folder / "report.html").read_text())
    assert len(tiles) == 4
    assert all("mine" in tile for tile in tiles)


def test_the_reasons_of_failures_are_in_sight(report: tuple[Path, Summary]) -> None:
    folder, summary = report
    sentence = "Circles without a pose, by reason: too <dark> (2); the estimates have no row for this frame (1)."
    assert sentence in sentences(summary)
    page = (folder / "report.html").read_text()
    assert page.index("too &lt;dark&gt; (2)") < page.index('id="results"')


def test_pooled_levels_say_so(report: tuple[Path, Summary]) -> None:
    folder, summary = report
    (said,) = [s for s in sentences(summary) if "pooled" in s]
    assert said.startswith("These numbers are over all levels of sensor.read_noise_e, pooled;")
    page = (folder / "report.html").read_text()
    assert "All levels of sensor.read_noise_e are pooled." in page
    assert "position error, median" in page
