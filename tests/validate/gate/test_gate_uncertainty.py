"""The gate asks whether stated covariances hold as before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from roundel.validate.gate.baseline import Baseline, read_baseline, write_baseline
from roundel.validate.gate.gate import GateResult, gate
from roundel.validate.gate.quantities import CHI2, CHOICE, SCORE
from roundel.validate.statistics.paired_tests import mean_growth_test

N = 600


def scores(seed: int, factor: float = 1.0, images: str = "", bare: int = 0, swap: int = 0) -> Baseline:
    """An efficient solver whose covariances are right, times a factor; the first `bare` poses have none.

    The candidates of the first `swap` are exchanged.
    """
    g = np.random.default_rng(seed)
    noise = g.normal(size=(N, 5))
    chi2 = np.sum(noise**2, axis=1) / factor
    # The volume of the covariance differs from frame to frame.
    volume = np.random.default_rng(0).uniform(-60, -40, N) + 5 * np.log(factor)
    none = np.arange(N) < bare
    error = np.linalg.norm(noise, axis=1) / 5**0.5

    def numbers(values: np.ndarray, mask: np.ndarray | None = None) -> pa.Array:
        return pa.array(values, mask=mask, type=pa.float32())

    rows = pa.table(
        {
            "frame_id": np.arange(N),
            "marker_id": np.zeros(N, dtype=np.int64),
            "method": ["ml"] * N,
            "intrinsics": ["true"] * N,
            "group": ["all"] * N,
            "solved": np.ones(N, dtype=bool),
            "branch_correct": pa.nulls(N, pa.bool_()),
            "oracle_pose_error_bounds": numbers(error),
            "oracle_normal_error_deg": numbers(0.05 * np.abs(noise[:, 0])),
            "oracle_position_error_m": numbers(0.001 * np.abs(noise[:, 2])),
            "contour_error_px": numbers(0.01 * np.abs(noise[:, 3])),
            "ellipse_centre_x_error_px": numbers(0.01 * noise[:, 3]),
            "ellipse_centre_y_error_px": numbers(0.01 * noise[:, 4]),
            "normal_bound_deg": numbers(np.full(N, 0.05)),
            "position_bound_m": numbers(np.full(N, 0.001)),
            "ellipse_centre_bound_px": numbers(np.full(N, 0.01)),
            SCORE: numbers(0.5 * (chi2 + volume), none),
            CHI2: numbers(chi2, none),
            # The likelier candidate is right as often as is said, but for `swap` of them.
            CHOICE[0]: numbers(np.full(N, 0.9)),
            CHOICE[1]: (g.random(N) < 0.9) ^ (np.arange(N) < swap),
        }
    )
    return Baseline(rows, "d" * 64, images or f"images {seed}", "s", 1, [{"reason": "first", "roundel": "0"}])


def red(result: GateResult) -> dict[str, str]:
    return {check.name: check.sentence for check in result.checks if check.verdict == "worse"}


@pytest.mark.parametrize(
    ("factor", "names", "words"),
    [
        (1e-6, ["stated uncertainty", "over-confidence"], "-> 0.0 % of 600 truths within the 95 % region"),
        (0.7, ["stated uncertainty", "over-confidence"], "truths within the 95 % region"),
        (1.5, ["stated uncertainty", "under-confidence", "sharpness"], "truths within the 50 % region"),
    ],
)
def test_covariances_that_do_not_hold_are_red_and_named(factor: float, names: list[str], words: str) -> None:
    found = red(gate(scores(1, factor, images="same"), scores(1, images="same")))
    assert list(found) == names
    assert words in found[names[1]]
    # Where they were wrong before, making them right is better.
    repaired = gate(scores(1, images="same"), scores(1, factor, images="same"))
    assert repaired.passed
    assert "better" in {check.verdict for check in repaired.checks if check.name == "stated uncertainty"}


def test_sharpness_is_lost_only_where_it_was_not_needed() -> None:
    # Larger regions where they were too small are no loss; where they held, they are, and by how much is said.
    assert "sharpness" not in red(gate(scores(1, 1.0, images="same"), scores(1, 0.5, images="same")))
    found = red(gate(scores(1, 1.5, images="same"), scores(1, images="same")))
    # The square root of 1.5.
    assert "+22.5 % of 600" in found["sharpness"]
    # Covariances that grow by 5 % are 2.5 % larger standard deviations: below what counts.
    assert gate(scores(1, 1.05, images="same"), scores(1, images="same")).passed


def test_exchanged_probabilities_are_red_and_named() -> None:
    found = red(gate(scores(1, swap=N, images="same"), scores(1, images="same")))
    assert list(found) == ["probability of the likelier candidate"]
    assert "90.0 % stated" in found["probability of the likelier candidate"]
    assert red(gate(scores(1, swap=60, images="same"), scores(1, images="same")))
    assert gate(scores(2), scores(3)).passed


def test_fresh_noise_is_no_loss() -> None:
    alarms = sum(not gate(scores(2 * i + 10), scores(2 * i + 11)).passed for i in range(100))
    # At most 1 %: three of 100 would come up once in 50 seeds at that rate.
    assert alarms <= 2


def test_covariances_that_are_no_longer_given_are_a_loss() -> None:
    assert "covariance given" in red(gate(scores(1, bare=40), scores(1)))
    # Those that never were are not missed.
    assert gate(scores(1, bare=40), scores(2, bare=40)).passed


def test_few_poses_are_not_asked() -> None:
    # Twenty with a covariance are too few for a verdict, on either side; losing nearly all of them is one.
    names = {check.name for check in gate(scores(1, bare=N - 20), scores(2, bare=N - 20)).checks}
    assert not {"stated uncertainty", "over-confidence", "sharpness"} & names
    assert list(red(gate(scores(1, bare=N - 20, images="same"), scores(1, images="same")))) == ["covariance given"]


def test_probabilities_that_are_no_longer_given_are_a_loss() -> None:
    def silent(side: Baseline, rows: int) -> Baseline:
        at = side.rows.column_names.index(CHOICE[0])
        none = np.arange(N) < rows
        column = pa.array(side.rows[at].to_numpy(), mask=none, type=pa.float32())
        return replace(side, rows=side.rows.set_column(at, CHOICE[0], column))

    old = scores(1, images="same")
    for rows in (40, N - 20):
        assert list(red(gate(silent(old, rows), old))) == ["probability of the likelier candidate given"]
    assert not [c for c in gate(silent(scores(2), N - 20), silent(old, N - 20)).checks if "likelier" in c.name]


def test_a_group_whose_covariances_do_not_hold_is_named() -> None:
    groups = pa.array(["first" if i < 100 else "second" for i in range(N)])

    def grouped(side: Baseline) -> Baseline:
        return replace(side, rows=side.rows.set_column(side.rows.column_names.index("group"), "group", groups))

    old, other = grouped(scores(1, images="same")), grouped(scores(1, 0.3, images="same"))
    parts = [other.rows.slice(0, 100), old.rows.slice(100)]
    found = red(gate(replace(other, rows=pa.concat_tables(parts).combine_chunks()), old))
    assert "stated uncertainty in first" in found
    assert "stated uncertainty in second" not in found


def test_a_baseline_of_an_older_version_is_compared_in_what_it_has(tmp_path: Path) -> None:
    old = scores(1)
    before = replace(old, rows=old.rows.drop_columns([SCORE, CHI2, *CHOICE]))
    write_baseline(before, tmp_path / "old.parquet")
    kept = read_baseline(tmp_path / "old.parquet")
    assert SCORE not in kept.rows.column_names
    result = gate(scores(1, factor=1e-6), kept)
    assert [check.verdict for check in result.checks] == ["identical"]
    write_baseline(old, tmp_path / "new.parquet")
    assert read_baseline(tmp_path / "new.parquet").rows.equals(old.rows)


def test_the_test_of_a_mean_is_students() -> None:
    g = np.random.default_rng(3)
    a, b = g.normal(0.1, 1, 200), g.normal(0, 1, 200)
    found = mean_growth_test(a, b, alpha=0.05)
    expected = stats.ttest_rel(a, b, alternative="greater")
    assert found.p_value == pytest.approx(expected.pvalue, rel=1e-12)
    assert found.effect == pytest.approx(np.mean(a - b))
    same = mean_growth_test(b, b, alpha=0.05)
    assert (same.effect, same.standard_error, same.p_value) == (0.0, 0.0, 1.0)
