"""Figures of reliability: a panel for each run, and what they leave out."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from roundel.validate.figures.reliability import reliability_pictures
from roundel.validate.scores.stated_uncertainty import reliability


def run_of(method: str, intrinsics: str, seed: int, reference: str = "truth") -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    stated = rng.uniform(0.5, 1.0, 60)
    found = reliability(stated, rng.random(60) < stated, np.arange(60), (0.5, 0.7, 0.9, 1.01))
    return {"method": method, "intrinsics": intrinsics, "reference": reference, "choice": found, "confidence": found}


@pytest.mark.parametrize(("count", "panels", "left"), [(1, 1, 0), (5, 5, 0), (8, 8, 0), (11, 8, 3)])
def test_a_panel_for_each_run_and_a_word_on_the_rest(count: int, panels: int, left: int) -> None:
    pictures = reliability_pictures([run_of(f"m{i}", "true", i) for i in range(count)])
    assert [p.name for p in pictures] == ["reliability", "confidence"]
    for picture in pictures:
        assert len(set(re.findall(r">(m\d+, true)<", picture.svg))) == panels
        assert (f"{left} runs are only in the table" in picture.caption) is (left > 0)


def test_intrinsics_that_share_all_numbers_share_a_panel() -> None:
    runs = [run_of("m", "true", 1), run_of("m", "default", 1), run_of("m", "exif", 2), run_of("n", "true", 1)]
    (picture, _) = reliability_pictures(runs)
    assert set(re.findall(r">([mn], [a-z, ]+)<", picture.svg)) == {"m, true, default", "m, exif", "n, true"}


def test_only_what_is_stated_against_the_truth_is_drawn() -> None:
    silent = {**run_of("m", "true", 1), "choice": None, "confidence": None}
    assert reliability_pictures([silent, run_of("m", "true", 1, reference="chessboard")]) == []
    (picture,) = reliability_pictures([{**run_of("m", "true", 1), "choice": None}])
    assert picture.name == "confidence"
