"""A method that returns one pose a circle: which solution it returns, and how accurate it is, are questions apart."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers_gate import method_scores, worse
from numpy.typing import NDArray

from roundel.validate.gate.baseline import Baseline
from roundel.validate.gate.gate import gate
from roundel.validate.gate.output import lines

N = 3250
SHARES = (0.0, 0.3, 0.5, 0.6)
# Most frames decide the solution; the noise of a side decides it in this share.
UNDECIDED = 0.2


def wrong(share: float, seed: int) -> NDArray[np.bool_]:
    """Where a method returns the second solution; the same frames at each seed, but for those that noise decides."""
    by_frame = np.random.default_rng(7).random(N)
    side = np.random.default_rng([1, seed])
    return np.where(side.random(N) < UNDECIDED, side.random(N), by_frame) < share


def test_the_share_is_what_it_says() -> None:
    both = wrong(0.5, 1) != wrong(0.5, 2)
    # 36 % of the frames have noise on a side, and half of them differ; four standard deviations.
    assert both.mean() == pytest.approx(0.18, abs=4 * np.sqrt(0.18 * 0.82 / N))


@pytest.mark.parametrize("share", SHARES)
def test_normal_noise_doubled_is_found_whatever_the_share(share: float) -> None:
    for seed in range(5):
        old = method_scores(2 * seed, wrong=wrong(share, 2 * seed))
        new = method_scores(2 * seed + 1, normal_scale=2.0, wrong=wrong(share, 2 * seed + 1))
        found = worse(gate(new, old))
        assert {"pose", "normal"} <= set(found)
        # The figure is that of the poses that are beside the truth: twice, less what chance allows.
        assert float(re.search(r"group \+(\S+) %", found["normal"])[1]) == pytest.approx(100, abs=20)


def test_a_baseline_of_an_older_version_tells_by_the_choice() -> None:
    def older(side: Baseline) -> Baseline:
        return replace(side, rows=side.rows.drop_columns(["oracle_branch_correct", "detected"]))

    old = older(method_scores(2, wrong=wrong(0.5, 2)))
    assert {"pose", "normal"} <= set(worse(gate(method_scores(1, normal_scale=2.0, wrong=wrong(0.5, 1)), old)))
    assert gate(method_scores(1, wrong=wrong(0.5, 1)), old).passed


@pytest.mark.parametrize("share", SHARES)
def test_a_rate_worse_by_five_points_is_found_and_named(share: float) -> None:
    for seed in range(5):
        old = method_scores(2 * seed, wrong=wrong(share, 2 * seed))
        new = method_scores(2 * seed + 1, wrong=wrong(share + 0.05, 2 * seed + 1))
        assert list(worse(gate(new, old))) == ["right candidate"]


@pytest.mark.parametrize("share", SHARES)
def test_fresh_noise_is_no_loss(share: float) -> None:
    alarms = 0
    for seed in range(25):
        sides = (method_scores(s, wrong=wrong(share, s)) for s in (2 * seed + 100, 2 * seed + 101))
        alarms += not gate(*sides).passed
    # At most 1 %: two of 25 would come up once in forty seeds at that rate.
    assert alarms <= 1


def test_what_can_be_detected_is_said_of_the_poses_beside_the_truth() -> None:
    some = gate(method_scores(1, wrong=wrong(0.6, 1)), method_scores(2, wrong=wrong(0.6, 2)))
    every = gate(method_scores(1), method_scores(2))
    losses = [float(re.search(r"a loss of (\S+) % in pose", "\n".join(r.notes))[1]) for r in (every, some)]
    # Some 30 % of the pairs are right on both sides: nearly twice the standard error, and never nothing.
    assert losses[1] == pytest.approx(losses[0] / np.sqrt(0.3), rel=0.25)
    # The same errors, but for one: certain to the last digit, and what does not count is not promised.
    old = method_scores(1)
    values = old.rows["oracle_pose_error_bounds"].to_numpy().copy()
    values[5] *= 1.001
    at = old.rows.column_names.index("oracle_pose_error_bounds")
    new = replace(old, images="other", rows=old.rows.set_column(at, "oracle_pose_error_bounds", [values]))
    result = gate(new, old)
    assert "a loss of 2.0 % in pose" in "\n".join(result.notes)


def test_a_method_that_is_right_nowhere_twice_is_not_called_accurate() -> None:
    half = np.arange(N) % 2 == 0
    result = gate(method_scores(1, wrong=half), method_scores(2, wrong=~half))
    # As many right as before, and no circle whose accuracy could be compared: said, and nothing is claimed.
    assert not {"pose", "normal", "position"} & {check.name for check in result.checks}
    assert "mine, true: pose not compared: 0 circles are right on both sides" in result.notes


def test_circles_that_changed_sides_are_listed_if_that_is_what_is_worse() -> None:
    old, flipped = method_scores(2, wrong=wrong(0.3, 2)), method_scores(1, wrong=wrong(0.4, 1))
    assert "beside the second solution" in "\n".join(lines(gate(flipped, old)))
    noisy = method_scores(1, normal_scale=2.0, wrong=wrong(0.3, 1))
    assert "beside the second solution" not in "\n".join(lines(gate(noisy, old)))


def test_golden_frames_ask_for_no_side() -> None:
    old = method_scores(1, wrong=wrong(0.3, 1), images="same")
    new = method_scores(3, wrong=wrong(0.3, 3), images="same")
    assert gate(new, old).passed


def test_gross_errors_neither_fill_the_rms_nor_move_their_own_limit() -> None:
    # Six of ten poses are wild, others on each side; the rest loses a half.
    def wild(seed: int, scale: float) -> Baseline:
        side = method_scores(seed, scale=scale)
        at = side.rows.column_names.index("oracle_pose_error_bounds")
        g = np.random.default_rng(seed + 50)
        values = np.where(g.random(N) < 0.6, 1e4 * g.random(N) + 1e3, side.rows[at].to_numpy())
        return replace(side, rows=side.rows.set_column(at, "oracle_pose_error_bounds", [values]))

    found = worse(gate(wild(1, 1.5), wild(2, 1.0)))
    assert "RMS 1" in found["pose"]
    assert float(re.search(r"group \+(\S+) %", found["pose"])[1]) == pytest.approx(50, abs=10)


def test_errors_below_what_counts_are_not_gross() -> None:
    # Rounding: most errors are of 1e-9 of what counts, and one in four of another solver's is a thousand times larger.
    def rounded(seed: int, share: float) -> Baseline:
        side = method_scores(seed, scale=1e-9)
        at = side.rows.column_names.index("oracle_pose_error_bounds")
        more = np.where(np.random.default_rng(seed).random(N) < share, 1e3, 1.0)
        values = side.rows[at].to_numpy() * more
        return replace(side, rows=side.rows.set_column(at, "oracle_pose_error_bounds", [values]))

    assert gate(rounded(1, 0.25), rounded(2, 0.0)).passed
