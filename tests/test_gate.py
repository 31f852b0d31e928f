"""The gate: silent for noise, loud for losses, and it refuses to compare unlike things."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from roundel.scenes.errors import DataError, NotComparableError, UsageError
from roundel.validate.baseline import Baseline, read_baseline, write_baseline
from roundel.validate.gate import Check, Frame, GateResult, gate
from roundel.validate.gate_report import SUMMARY_LIMIT_BYTES, junit_xml, lines, markdown

N = 600


def scores(seed: int, scale: float = 1.0, shift: float = 0.0, lost: int = 0, n: int = N, images: str = "") -> Baseline:
    """Errors of a solver at its bound: frames differ in difficulty by a factor of ten."""
    difficulty = np.random.default_rng(0).uniform(0.01, 0.1, n)
    g = np.random.default_rng(seed)
    xy = scale * g.normal(size=(n, 2)) * difficulty[:, None] * 0.1 + [shift, 0.0]
    solved = np.arange(n) >= lost

    def known(values):
        return pa.array(values, mask=~solved, type=pa.float32())

    rows = pa.table(
        {
            "frame_id": np.arange(n),
            "marker_id": np.zeros(n, dtype=np.int64),
            "method": ["ml"] * n,
            "intrinsics": ["true"] * n,
            "group": ["all"] * n,
            "solved": solved,
            "branch_correct": pa.nulls(n, pa.bool_()),
            "oracle_normal_error_deg": known(scale * np.linalg.norm(g.normal(size=(n, 2)), axis=1) * difficulty),
            "oracle_position_error_m": known(scale * np.linalg.norm(g.normal(size=(n, 3)), axis=1) * difficulty / 100),
            "ellipse_centre_error_px": known(np.linalg.norm(xy, axis=1)),
            "contour_error_px": known(np.abs(xy).mean(axis=1)),
            "ellipse_centre_x_error_px": known(xy[:, 0]),
            "ellipse_centre_y_error_px": known(xy[:, 1]),
            "normal_bound_deg": pa.array(difficulty * 2**0.5, pa.float32()),
            "position_bound_m": pa.array(difficulty * 3**0.5 / 100, pa.float32()),
            "ellipse_centre_bound_px": pa.array(difficulty * 0.1 * 2**0.5, pa.float32()),
        }
    )
    return Baseline(rows, "d" * 64, images or f"images {seed}", "s", 1, [{"reason": "first", "roundel": "0"}])


def worse(result: GateResult) -> list[str]:
    return [check.name for check in result.checks if check.verdict == "worse"]


def test_fresh_noise_is_no_loss():
    alarms = sum(not gate(scores(2 * i + 10), scores(2 * i + 11)).passed for i in range(60))
    # At most 1 %: two of 60 would come up once in eight seeds at that rate, three once in 45.
    assert alarms <= 2


def test_a_loss_is_found_and_a_gain_is_said():
    assert {"normal", "position"} <= set(worse(gate(scores(1, scale=1.25), scores(2))))
    gain = gate(scores(1, scale=0.75), scores(2))
    assert gain.passed
    assert "better" in {check.verdict for check in gain.checks}


def test_a_shift_is_found():
    found = worse(gate(scores(1, shift=0.5), scores(2)))
    assert "shift of the ellipse centre in x" in found
    assert "shift of the ellipse centre in y" not in found


def test_lost_frames_are_found_and_named():
    result = gate(scores(1, lost=20), scores(2))
    assert "solved" in worse(result)
    assert len(result.worst) == 10
    assert result.worst[0].sentence == "no longer solved"
    assert "--frames 0:1 --method ml --intrinsics true" in "\n".join(lines(result))


def test_the_same_images_and_scores_are_identical():
    result = gate(scores(1), scores(1))
    assert [check.verdict for check in result.checks] == ["identical"]


def test_golden_frames_need_the_same_images():
    broken = scores(1, images="the same")
    column = broken.rows["oracle_normal_error_deg"].to_numpy().copy()
    column[3] += 1.0
    at = broken.rows.column_names.index("oracle_normal_error_deg")
    rows = broken.rows.set_column(at, "oracle_normal_error_deg", pa.array(column, pa.float32()))
    assert "golden frames" in worse(gate(replace(broken, rows=rows), scores(1, images="the same")))
    assert "golden frames" not in worse(gate(replace(broken, rows=rows, images="fresh"), scores(1, images="the same")))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dataset_id": "e" * 64}, "of dataset eeeeeeeeeeee"),
        ({"metric_version": 2}, "metric version 2"),
        ({"settings": "t"}, "other settings"),
        ({"rows": scores(1).rows.slice(0, 9)}, "scores 9 circles"),
        ({"rows": scores(1).rows.slice(0, 0)}, "has no run 'ml, true'"),
    ],
)
def test_unlike_things_are_refused(change, message):
    with pytest.raises(NotComparableError, match=message):
        gate(replace(scores(1), **change), scores(2))


def test_too_few_samples_are_refused():
    with pytest.raises(NotComparableError, match="20 circles were solved by both; a verdict needs 30"):
        gate(scores(1, n=20), scores(2, n=20))
    with pytest.raises(NotComparableError, match="0 circles"):
        gate(scores(1, lost=N), scores(2))


def test_a_baseline_survives_its_file(tmp_path):
    file = tmp_path / "baseline.parquet"
    write_baseline(scores(1), file)
    again = read_baseline(file)
    assert again == replace(scores(1), rows=again.rows)
    assert again.rows.equals(scores(1).rows)
    first = file.read_bytes()
    write_baseline(again, file)
    assert file.read_bytes() == first
    assert len(first) < 70 * N  # bytes a circle: 2,000 of them are 140 kB in git


def test_what_is_no_baseline(tmp_path):
    with pytest.raises(UsageError, match="no such baseline"):
        read_baseline(tmp_path / "none.parquet")
    file = tmp_path / "baseline.parquet"
    file.write_bytes(b"PAR1")
    with pytest.raises(DataError, match="not a baseline"):
        read_baseline(file)
    pq.write_table(pa.table({"x": [1]}), file)
    with pytest.raises(DataError, match="not a baseline"):
        read_baseline(file)


def test_junit_is_xml_whatever_a_run_is_called():
    result = gate(scores(1, lost=20), scores(2))
    nasty = Check('ml, calibrated:<&"\x07>', "solved", "worse", "<script>alert(1)</script> \x00")
    xml = junit_xml(GateResult([*result.checks, nasty], result.worst))
    root = ElementTree.fromstring(xml)
    assert int(root.attrib["failures"]) == 1 + len(worse(result))
    assert len(root.findall(".//testcase")) == int(root.attrib["tests"])
    assert b"<script>" not in xml


def test_a_step_summary_stays_below_githubs_limit():
    checks = [Check("a|b", "<img>", "worse", "word " * 200) for _ in range(2000)]
    text = markdown(GateResult(checks, [Frame("ml, true", 1, 0, 2.0, "x")] * 10))
    assert len(text.encode()) < SUMMARY_LIMIT_BYTES
    assert "<img>" not in text
    assert "cut short" in text
