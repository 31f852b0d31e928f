"""The matrix of varied quantities against errors."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pytest
from helpers_reports import POINTS, estimate_rows, failed_row, make_dataset, write_estimates

from roundel.validate.estimates.runs import read_runs
from roundel.validate.figures.errors_by_variable import _bins, variable_pictures
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.scores.scores import score


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> pa.Table:
    folder = tmp_path_factory.mktemp("matrix")
    dataset = make_dataset(folder / "ds", POINTS)
    rows = [r for r in estimate_rows(dataset, ["true"], noise_px=0.1) if r["frame_id"] != 5]
    file = write_estimates(folder / "e.parquet", [*rows, failed_row(5, "true")])
    return score(dataset, true_targets(dataset, 3.0), read_runs([file], dataset)).table


def texts(svg: str) -> list[str]:
    return re.findall(r"<text[^>]*>([^<]*)</text>", svg)


def test_what_was_varied_and_what_went_wrong(table: pa.Table) -> None:
    (picture,) = variable_pictures(table, "ml", "true")
    shown = texts(picture.svg)
    for label in ("distance [D]", "tilt [deg]", "azimuth [deg]", "image x [px]",
                  "normal [deg]", "position [% of distance]", "reprojection [px]",
                  "ellipse centre [px]", "not solved [%]"):  # fmt: skip
        assert label in shown
    # Half a pixel of aim is no variation.
    assert "image y [px]" not in shown
    assert len(picture.svg) < 400_000
    assert variable_pictures(table, "ml", "true") == [picture]


def test_nothing_varied_and_too_few_draw_nothing(table: pa.Table) -> None:
    assert variable_pictures(table.slice(0, 10), "ml", "true") == []
    assert variable_pictures(table, "ml", "default") == []


def test_bins_are_levels_of_a_grid_or_equal_parts() -> None:
    grid = np.repeat([15.0, 30.0, 45.0], 12)
    assert [np.unique(grid[rows]).tolist() for rows in _bins(grid)] == [[15.0], [30.0], [45.0]]
    drawn = np.random.default_rng(1).uniform(0, 1, 160)
    drawn[3] = np.nan
    bins = _bins(drawn)
    assert sum(map(len, bins)) == 159
    assert all(drawn[a].max() < drawn[b].min() for a, b in pairwise(bins))
    crowded = np.concatenate([np.linspace(-1, 1, 80), np.linspace(-500, 500, 80)])
    bins = _bins(crowded)
    assert sum(map(len, bins)) == 160
    assert all(np.median(crowded[b]) - np.median(crowded[a]) > 20 for a, b in pairwise(bins))
    assert len(_bins(np.geomspace(1e-3, 1e3, 160))) == 10
