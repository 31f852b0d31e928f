"""A loss in one group alone is found, and the group is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
from helpers_gate import method_scores, worse

from roundel.validate.gate.baseline import Baseline
from roundel.validate.gate.checks import FAMILIES, answers
from roundel.validate.gate.gate import gate
from roundel.validate.gate.output import lines
from roundel.validate.gate.questions import questions

N, GROUPS = 3250, 13


def test_a_loss_of_a_fifth_in_one_group_is_found_and_named() -> None:
    found = 0
    for seed in range(20):
        scale = np.ones(N)
        scale[:250] = 1.2
        named = worse(
            gate(method_scores(2 * seed + 1, groups=GROUPS, scale=scale), method_scores(2 * seed, groups=GROUPS))
        )
        found += "pose in group 0" in named
        assert not [name for name in named if "group" in name and name != "pose in group 0"]
    # 95 of 100 are asked for: fewer than 17 of 20 would come up once in sixty at that rate.
    assert found >= 17


def test_thirteen_groups_alarm_no_more_than_one() -> None:
    sides = ((method_scores(2 * s + 300, groups=GROUPS), method_scores(2 * s + 301, groups=GROUPS)) for s in range(50))
    # At most 1 %: two of 50 would come up once in eleven seeds at that rate, three once in seventy.
    assert sum(not gate(*pair).passed for pair in sides) <= 2


def test_groups_and_the_whole_share_the_false_alarms() -> None:
    new, old = method_scores(1, groups=GROUPS), method_scores(2, groups=GROUPS)
    tested, _, _ = questions("mine, true", new.rows, old.rows)
    ours = [t for t in tested if t.group and t.could_differ]
    assert len({t.group for t in ours}) == GROUPS
    p = {check.name: check.p_value for check in answers(tested)}
    first = min(ours, key=lambda t: t.test.p_value)
    assert p[first.name] == min(1.0, FAMILIES * len(ours) * first.test.p_value)
    # Without groups nothing is shared.
    tested, _, _ = questions("mine, true", method_scores(1).rows, method_scores(2).rows)
    assert not [t for t in tested if t.group]
    some = [t for t in tested if t.could_differ]
    least = min(some, key=lambda t: t.test.p_value)
    assert {c.name: c.p_value for c in answers(tested)}[least.name] == min(1.0, len(some) * least.test.p_value)


def test_groups_in_which_nothing_changed_are_one_line() -> None:
    scale = np.ones(N)
    scale[:250] = 1.5
    result = gate(method_scores(1, groups=GROUPS, scale=scale), method_scores(2, groups=GROUPS))
    said = [line for line in lines(result) if "group" in line and "would be detected" not in line and "%" in line]
    assert any(line.startswith("worse     mine, true: pose in group 0: RMS") for line in said)
    quiet = sum(bool(check.group) and check.verdict == "same" for check in result.checks)
    assert f"same      mine, true: {quiet} checks of single groups" in lines(result)
    assert quiet == GROUPS - 1


def test_the_detectable_loss_of_a_group_is_said() -> None:
    notes = gate(method_scores(1, groups=GROUPS), method_scores(2, groups=GROUPS)).notes
    alone = [note for note in notes if " alone would be detected" in note]
    assert len(alone) == 1
    assert "in pose in group" in alone[0]


def test_without_bounds_groups_are_asked_for_the_normal() -> None:
    def bare(side: Baseline) -> Baseline:
        rows = side.rows
        for name in ("oracle_pose_error_bounds", "normal_bound_deg", "position_bound_m", "ellipse_centre_bound_px"):
            rows = rows.set_column(rows.column_names.index(name), name, pa.nulls(N, pa.float32()))
        return replace(side, rows=rows)

    scale = np.ones(N)
    scale[:250] = 2.0
    sides = [bare(method_scores(s, groups=GROUPS, scale=f)) for s, f in ((1, scale), (2, 1.0))]
    named = [name for name in worse(gate(*sides)) if "group" in name]
    assert named == ["normal in group 0"]
