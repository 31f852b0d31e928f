"""Confidences, missed circles and false positives in the gate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from helpers_gate import method_scores, with_detections, worse

from roundel.validate.gate.baseline import Baseline, read_baseline, write_baseline
from roundel.validate.gate.gate import gate

N = 1000


def detections(seed: int, share: float = 0.1, images: str = "", power: float = 1.0) -> Baseline:
    """Confidences that hold: of the detections with confidence c, a share c is right; to a power they do not.

    A share of the frames has a detection beside the circle's own: a false positive.
    """
    g = np.random.default_rng(seed)
    # By Bayes' rule with as many false positives as `share` of the circles.
    right, wrong = g.beta(8, 2, N), g.beta(2, 8, N)

    def holds(x: np.ndarray) -> np.ndarray:
        likely, unlikely = x**7 * (1 - x), share * x * (1 - x) ** 7
        return np.asarray((likely / (likely + unlikely)) ** power)

    at = np.flatnonzero(g.random(N) < share)
    false = {int(frame): [float(value)] for frame, value in zip(at, holds(wrong)[at], strict=True)}
    return with_detections(method_scores(seed, n=N, images=images), holds(right), false)


def constant(side: Baseline, value: float) -> Baseline:
    """The same with one confidence for every detection."""
    at = side.rows.column_names.index("confidence")
    rows = side.rows.set_column(at, "confidence", pa.array(np.full(N, value), pa.float32()))
    false = side.false_positives.set_column(3, "confidence", pa.array([value] * side.false_positives.num_rows))
    return replace(side, rows=rows, false_positives=false)


def test_confidence_of_one_for_all_is_red_and_named() -> None:
    old = detections(1, images="same")
    found = worse(gate(constant(old, 1.0), old))
    assert list(found) == ["one confidence for all", "confidence"]
    assert "1 for all" in found["one confidence for all"]
    assert "-> 100.0 % stated, 91." in found["confidence"]
    # Where nothing is wrong they are no less true, and tell nothing any more.
    side = method_scores(1, n=N, images="same")
    clean = with_detections(side, np.random.default_rng(1).beta(8, 2, N), {})
    assert list(worse(gate(constant(clean, 1.0), clean))) == ["one confidence for all"]
    # A method that never told is not asked to.
    assert gate(constant(detections(1), 1.0), constant(detections(2), 1.0)).passed


def test_confidences_that_are_too_high_or_too_low_are_red() -> None:
    old = detections(1, images="same")
    for power in (0.05, 20.0):
        assert list(worse(gate(detections(1, images="same", power=power), old))) == ["confidence"]
        repaired = gate(old, detections(1, images="same", power=power))
        assert "better" in {check.verdict for check in repaired.checks if check.name == "confidence"}


def test_fresh_noise_is_no_loss() -> None:
    alarms = sum(not gate(detections(2 * i + 10), detections(2 * i + 11)).passed for i in range(60))
    # At most 1 %: three of 60 would come up once in forty seeds at that rate.
    assert alarms <= 2


def test_more_false_positives_are_red() -> None:
    found = worse(gate(detections(1, share=0.2), detections(2)))
    assert "false positives" in found
    assert "of" not in found["false positives"].split(" in ")[0].removeprefix("false positives: ")


def test_missed_circles_are_red_for_a_method_without_poses_for_some() -> None:
    old = detections(1, images="same")
    at = old.rows.column_names.index("detected")
    missed = np.arange(N) >= 40
    new = replace(detections(1), rows=old.rows.set_column(at, "detected", pa.array(missed)))
    assert "detected" in worse(gate(new, old))


def test_confidences_that_are_no_longer_given_are_a_loss() -> None:
    old = detections(1, images="same")
    at = old.rows.column_names.index("confidence")
    rows = old.rows.set_column(at, "confidence", pa.nulls(N, pa.float32()))
    false = old.false_positives.set_column(3, "confidence", pa.nulls(old.false_positives.num_rows, pa.float64()))
    assert list(worse(gate(replace(old, rows=rows, false_positives=false), old))) == ["confidence given"]


def test_false_positives_survive_the_file_and_older_files_have_none(tmp_path: Path) -> None:
    old = detections(1)
    write_baseline(old, tmp_path / "new.parquet")
    kept = read_baseline(tmp_path / "new.parquet")
    assert kept.false_positives.equals(old.false_positives)
    write_baseline(replace(old, false_positives=None), tmp_path / "old.parquet")
    before = read_baseline(tmp_path / "old.parquet")
    assert before.false_positives is None
    # Not asked: a file of an older version cannot answer.
    assert not {"confidence", "false positives"} & {c.name for c in gate(constant(detections(2), 1.0), before).checks}
