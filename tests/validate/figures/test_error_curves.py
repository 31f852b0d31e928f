"""Figures: deterministic, for light and dark themes, with the right shape for grids and for drawn values."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pyarrow as pa
import pytest
from helpers_reports import POINTS, estimate_rows, make_dataset, write_estimates

from roundel.validate.estimates.runs import read_runs
from roundel.validate.figures.error_curves import pictures
from roundel.validate.figures.svg import inlined
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.scores.scores import score
from roundel.validate.scores.summary import grid_of

DRAWN = POINTS.replace("{grid: [15, 25, 40]}", "{uniform: [15, 40]}").replace(
    "frames_per_cell: 4", "frames_per_cell: 10"
)


def table_of(folder: Path, text: str) -> pa.Table:
    dataset = make_dataset(folder / "ds", text)
    rows = estimate_rows(dataset, ["scaled:0.7", "true", "scaled:1.3"], noise_px=0.1)
    runs = read_runs([write_estimates(folder / "estimates.parquet", rows)], dataset)
    return score(dataset, true_targets(dataset, 3.0), runs).table


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> pa.Table:
    return table_of(tmp_path_factory.mktemp("grid"), POINTS)


def texts(svg: str) -> list[str]:
    return re.findall(r"<text[^>]*>([^<]*)</text>", svg)


def test_the_paper_s_figure(grid: pa.Table) -> None:
    (picture,) = pictures(grid)
    ElementTree.fromstring(picture.svg)  # well-formed
    shown = texts(picture.svg)
    for label in ("tilt 15\N{DEGREE SIGN}", "tilt 30\N{DEGREE SIGN}", "tilt 45\N{DEGREE SIGN}", "normal [deg]",
                  "position [D]", "reprojection [px]", "distance [D]", "true", "scaled:0.7", "scaled:1.3"):  # fmt: skip
        assert label in shown
    # Known intrinsics come first.
    assert [t for t in shown if t in ("true", "scaled:0.7", "scaled:1.3")] == ["true", "scaled:0.7", "scaled:1.3"]
    assert len(picture.svg) < 200_000


def test_the_same_scores_give_the_same_bytes(grid: pa.Table) -> None:
    assert pictures(grid) == pictures(grid)


def test_a_figure_loads_nothing_and_knows_no_date_and_no_fixed_ink(grid: pa.Table) -> None:
    svg = pictures(grid)[0].svg
    assert "metadata" not in svg
    assert "DOCTYPE" not in svg
    assert "<script" not in svg
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", svg)
    assert "var(--ink)" in svg
    assert "var(--grid)" in svg
    assert "var(--curve-0)" in svg
    # Text and lines without a variable would be black on black in the dark.
    assert not re.search(r"(stroke|fill): #0", svg)


def test_ids_of_two_figures_do_not_meet() -> None:
    svg = '<?xml version="1.0"?><svg width="3pt" height="4pt"><g id="a"/><use href="#a" clip-path="url(#a)"/></svg>'
    one, two = inlined(svg, "one", "One"), inlined(svg, "two", 'A "<b>"')
    assert 'id="one-a"' in one
    assert 'href="#one-a"' in one
    assert "url(#one-a)" in one
    assert 'id="two-a"' in two
    assert 'aria-label="A &quot;&lt;b&gt;&quot;"' in two
    assert "width=" not in one


def test_drawn_distances_are_scattered(tmp_path: Path) -> None:
    table = table_of(tmp_path, DRAWN)
    # Three intrinsics repeat each frame's distance three times, and are no grid for it.
    assert grid_of(table) is None
    (picture,) = pictures(table)
    assert "each frame's error" in picture.caption
    assert "distance [D]" in texts(picture.svg)


def test_nothing_solved_draws_nothing(grid: pa.Table) -> None:
    blank = grid.set_column(
        grid.column_names.index("oracle_normal_error_deg"), "oracle_normal_error_deg", pa.nulls(len(grid), pa.float64())
    )
    assert pictures(blank) == []
