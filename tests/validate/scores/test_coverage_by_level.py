"""`benchmarks/uncertainty/coverage.py`: shares of truths by level, and its verdict on each."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pyarrow as pa
import pytest

FRAMES = 200


@pytest.fixture(scope="module")
def script() -> Iterator[ModuleType]:
    path = Path(__file__).resolve().parents[3] / "benchmarks" / "uncertainty" / "coverage.py"
    spec = importlib.util.spec_from_file_location("coverage_by_level", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["coverage_by_level"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["coverage_by_level"]


def scores(factors: dict[float, float]) -> pa.Table:
    """Levels of a nuisance, whose standard deviations are stated too small by a factor each."""
    rng = np.random.default_rng(1)
    chi2 = [rng.chisquare(5, FRAMES) * factor**2 for factor in factors.values()]
    return pa.table(
        {
            "group": ["default"] * FRAMES * len(factors),
            "frame_id": np.arange(FRAMES * len(factors)),
            "sweep_level": np.repeat(list(factors), FRAMES),
            "sweep_frame": np.tile(np.arange(FRAMES), len(factors)),
            "oracle_pose_chi2": np.concatenate(chi2),
        }
    )


def test_levels_are_judged_apart(script: ModuleType) -> None:
    rows = {row[1]: row for row in script.rows_of("study", scores({0.1: 1.0, 0.2: 2.0, 0.3: 0.2}))}
    assert list(rows) == ["0.1", "0.2", "0.3", "all"]
    assert rows["0.1"][-1] == "yes"
    assert rows["0.2"][-1] == "**too few**"
    assert rows["0.3"][-1] == "**too many**"
    # Chi-square of five degrees of freedom: the median is 4.35, and known to 0.3 from 200.
    assert float(rows["0.1"][-2]) == pytest.approx(4.35, abs=0.9)
    assert rows["all"][2:4] == ("600", "600")


def test_a_pose_without_covariance_is_not_counted(script: ModuleType) -> None:
    table = scores({0.1: 1.0})
    chi2 = table["oracle_pose_chi2"].to_pylist()
    chi2[:150] = [None] * 150
    table = table.set_column(table.column_names.index("oracle_pose_chi2"), "oracle_pose_chi2", pa.array(chi2))
    assert [row[2:4] for row in script.rows_of("study", table)] == [("200", "50")] * 2


def test_a_few_poses_may_be_chance(script: ModuleType) -> None:
    table = scores({0.1: 0.2}).slice(0, 40)
    assert next(script.rows_of("study", table))[-1] == "too many; may be chance"
