"""Splits: their fractions, what they never part, and what cannot be split."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers_reports import make_dataset
from hypothesis import given
from hypothesis import strategies as st

from roundel.datasets.dataset import Dataset
from roundel.datasets.stream.splits import Splits, parse_fractions, split_by
from roundel.scenes.errors import NotComparableError, UsageError

STUDY = """\
schema: 1
name: split
seed: 3
mode: points
camera: {width_px: 160, height_px: 120, focal_px: 160}
marker: {kind: disc, diameter_m: 0.05}
pose:
  distance_m: {uniform: [0.3, 0.5]}
  tilt_deg: {uniform: [10, 50]}
frames: 8
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("split") / "ds", STUDY)


@given(seed=st.integers(0, 1000), fractions=st.sampled_from([(0.8, 0.1, 0.1), (0.5, 0.0, 0.5), (1 / 3, 1 / 3, 1 / 3)]))
def test_splits_have_their_fractions(seed: int, fractions: tuple[float, float, float], dataset: Dataset) -> None:
    split_of = split_by(dataset, Splits(fractions, seed=seed))
    names = [split_of(i) for i in range(len(dataset))]
    for name, share in zip(("train", "val", "test"), fractions, strict=True):
        assert abs(names.count(name) - share * len(dataset)) <= 1
        assert share == 0 or name in names
    assert names == [split_by(dataset, Splits(fractions, seed=seed))(i) for i in range(len(dataset))]


def test_levels_of_a_sweep_and_groups_are_never_split(tmp_path: Path) -> None:
    text = STUDY.replace("frames: 8\n", "") + (
        "groups:\n  a: {frames: 6}\n  c: {frames: 5}\n"
        "  b: {frames: 9, sweep: {key: sensor.read_noise_e, levels: [1, 2, 3]}}\n"
    )
    mine = make_dataset(tmp_path / "ds", text)
    split_of = split_by(mine, Splits((0.5, 0.25, 0.25)))
    start = mine.images.groups.index("b")
    count = mine.images.groups.count("b") // 3
    for i in range(count):
        assert len({split_of(start + i + level * count) for level in range(3)}) == 1
    by_group = split_by(mine, Splits((0.5, 0.25, 0.25), by="group"))
    parts = {(group, by_group(i)) for i, group in enumerate(mine.images.groups)}
    assert len(parts) == 3
    assert {part for _, part in parts} == {"train", "val", "test"}
    with pytest.raises(NotComparableError, match="split by world"):
        split_by(mine, Splits((0.5, 0.5, 0.0), by="world"))


@pytest.mark.parametrize("text", ["80/10", "80/10/20", "a/b/c", "-10/60/50", "nan/50/50"])
def test_percentages_that_are_none(text: str) -> None:
    with pytest.raises(UsageError, match="add up to 100"):
        parse_fractions(text)
