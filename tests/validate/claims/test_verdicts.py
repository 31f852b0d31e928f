"""Verdicts on the paper's claims: planted laws are confirmed, planted falsehoods fail, and the rest is undecided."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from helpers_reports import POINTS, estimate_rows, make_dataset, write_estimates

from roundel.validate.claims.claim import Claim, Finding
from roundel.validate.claims.verdicts import (
    CLAIMS,
    CONDITION,
    FALSE,
    HOLDS,
    OPEN,
    decided,
    verdict_on,
    verdict_record,
    verdicts_of,
)
from roundel.validate.estimates.runs import read_runs
from roundel.validate.figures.svg import standalone_svg
from roundel.validate.figures.verdicts import verdict_pictures
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.scores.scores import score
from roundel.validate.validate import validate_dataset

DISTANCES, TILTS = (15, 20, 25, 30, 35, 40, 45, 50), (15, 30, 45)
STUDY: dict[str, Any] = {
    "groups": {"main": {"camera": {"width_px": 1280, "height_px": 720, "focal_px": 1280}}},
    "solve": {"methods": ["ml"]},
}
# The laws of the errata's section 5: error = level (r / 15)^slope (tilt / 15)^lean, by kind of intrinsics.
LAWS: dict[str, dict[str, tuple[float, float, float]]] = {
    "scaled:1": {"normal": (1.1, 1.5, -1.0), "position": (0.03, 2.5, 0.0), "reprojection": (0.9, 0.5, 0.0)},
    "scaled:0.7": {"normal": (1.1, 1.5, -1.0), "position": (4.5, 1.0, 0.0), "reprojection": (9.0, -1.5, 0.0)},
}


def table_of(
    laws: dict[str, dict[str, tuple[float, float, float]]] = LAWS,
    per_cell: int = 10,
    seed: int = 0,
    groups: tuple[str, ...] = ("main",),
    off_axis_px: float = 0.0,
    spread: bool = False,
) -> pa.Table:
    """Scores whose errors follow laws: half-normal, and the same draw in all intrinsics, as one frame's noise is."""
    rng = np.random.default_rng(seed)
    r, tilt = (x.repeat(per_cell) for x in map(np.ravel, np.meshgrid(DISTANCES, TILTS)))
    r = r.astype(float) * (rng.uniform(0.98, 1.02, len(r)) if spread else 1.0)
    tables = []
    for g, group in enumerate(groups):
        draws = {name: np.abs(rng.normal(size=len(r))) * np.sqrt(np.pi / 2) for name in ("normal", "position")}
        for label, law in laws.items():
            # Reprojection is a mean over nine points, position of a wrong focal length nearly all bias: less spread.
            draws["reprojection"] = 0.8 + 0.2 * np.abs(rng.normal(size=len(r))) * np.sqrt(np.pi / 2)
            e = {
                n: level * (r / 15) ** slope * (tilt / 15) ** lean * draws[n] for n, (level, slope, lean) in law.items()
            }
            if label != "scaled:1":
                e["position"] = e["position"] / draws["position"] * (1 + 0.02 * (draws["position"] - 1))
            n = len(r)
            tables.append(
                pa.table(
                    {
                        "frame_id": np.arange(n) + n * g,
                        "marker_id": np.zeros(n, dtype=np.int64),
                        "method": ["ml"] * n,
                        "intrinsics": [label] * n,
                        "reference": ["truth"] * n,
                        "group": [group] * n,
                        "distance_m": 0.08 * r,
                        "distance_D": r,
                        "tilt_deg": tilt.astype(float),
                        "image_x_px": np.full(n, 639.5 + off_axis_px),
                        "image_y_px": np.full(n, 359.5),
                        "oracle_normal_error_deg": e["normal"],
                        "oracle_position_error_D": e["position"],
                        "oracle_position_error_pct": 100 * e["position"] / r,
                        "oracle_reprojection_error_px": e["reprojection"],
                        "oracle_along_ray_m": 0.08 * e["position"],
                    }
                )
            )
    return pa.concat_tables(tables)


def changed(label: str, name: str, law: tuple[float, float, float]) -> dict[str, dict[str, tuple[float, float, float]]]:
    """The laws of the errata but for one."""
    return {k: {**v, name: law} if k == label else v for k, v in LAWS.items()}


def records_of(table: pa.Table, study: dict[str, Any]) -> list[dict[str, Any]]:
    return [verdict_record(verdict) for verdict in verdicts_of(table, study)]


def outcomes(table: pa.Table, study: dict[str, Any] = STUDY) -> dict[str, str]:
    return {v["key"]: v["outcome"] for v in records_of(table, study)}


def test_the_laws_of_the_errata_give_its_verdicts() -> None:
    assert outcomes(table_of()) == {
        "normal-distance": HOLDS,
        "normal-tilt": HOLDS,
        "position-calibrated": FALSE,  # only on the scale of the uncalibrated curves it looks constant
        "position-uncalibrated": HOLDS,
        "reprojection-calibrated": CONDITION,
        "reprojection-uncalibrated": HOLDS,
        "reprojection-meets": CONDITION,
        "normal-focal": CONDITION,
    }


@pytest.mark.parametrize(
    ("key", "laws"),
    [
        ("normal-distance", changed("scaled:1", "normal", (1.1, -0.5, -1.0))),
        ("normal-tilt", changed("scaled:1", "normal", (1.1, 1.5, 1.0))),
        ("position-uncalibrated", changed("scaled:0.7", "position", (4.5, 1.3, 0.0))),
        ("reprojection-calibrated", changed("scaled:1", "reprojection", (0.9, 0.0, 0.0))),
        ("reprojection-uncalibrated", changed("scaled:0.7", "reprojection", (9.0, 0.0, 0.0))),
        ("reprojection-meets", changed("scaled:0.7", "reprojection", (9.0, -0.5, 0.0))),
        ("normal-focal", changed("scaled:0.7", "normal", (1.5, 1.5, -1.0))),
    ],
)
def test_a_law_planted_false_is_found_false(key: str, laws: dict) -> None:
    assert outcomes(table_of(laws, per_cell=20))[key] == FALSE


def test_a_false_claim_names_the_weaker_one_that_holds() -> None:
    # The claim asks for a slope within 0.1; 2.5 was planted. The rise is 0.6 of 15 diameters, and 60 % of them if 15
    # times as high.
    for level, holds in ((0.03, True), (0.45, False)):
        laws = changed("scaled:1", "position", (level, 2.5, 0.0))
        (v,) = (v for v in records_of(table_of(laws), STUDY) if v["key"] == "position-calibrated")
        assert v["outcome"] == FALSE
        main, rise = v["sides"]
        assert (main["holds"], rise["holds"]) == (False, holds)
        assert ("A weaker claim holds: on an axis" in v["qualifier"]) is holds
        assert v["qualifier"] or not holds


def test_a_planted_constant_is_not_called_false() -> None:
    flat = changed("scaled:1", "position", (0.03, 0.0, 0.0))
    assert outcomes(table_of(flat, per_cell=150))["position-calibrated"] == HOLDS


def finding_of(where: str, holds: bool | None, on_axis: bool = True, main: bool = True) -> Finding:
    return Finding(where, on_axis, f"statistic of {where}", 1.0, 0.9, 1.1, 40, "above 1", 0.01, True, "", main,
                   p_adjusted=0.01, holds=holds)  # fmt: skip


@pytest.mark.parametrize(
    ("findings", "conditional", "outcome", "qualifier"),
    [
        ([finding_of("a", True)], "", HOLDS, ""),
        ([finding_of("a", True)], "at night", CONDITION, "It holds at night."),
        ([finding_of("a", True), finding_of("b", False)], "", CONDITION,
         "It holds for a; it does not hold for b."),
        ([finding_of("a", True), finding_of("c", True), finding_of("d", True), finding_of("b", False, on_axis=False)],
         "", CONDITION, "It holds for a, c and d; it does not hold for b."),
        ([finding_of("a", True), finding_of("b", False, main=False)], "", CONDITION,
         "It holds, but not in this respect: statistic of b."),
        # In the paper's setting the claim is false: a condition elsewhere does not save it.
        ([finding_of("a", False), finding_of("b", True, on_axis=False)], "at night", FALSE, "It holds only for b."),
        ([finding_of("a", False), finding_of("b", True, main=False)], "at night", FALSE,
         "A weaker claim holds: it is nearly so."),
        ([finding_of("a", False), finding_of("b", None, main=False)], "at night", FALSE,
         "By theory it holds only at night."),
        ([finding_of("a", False), finding_of("b", False, main=False)], "", FALSE, ""),
        ([finding_of("a", None), finding_of("b", False, main=False)], "at night", OPEN, ""),
    ],
)  # fmt: skip
def test_an_outcome_is_that_of_the_claim_itself(
    findings: list[Finding], conditional: str, outcome: str, qualifier: str
) -> None:
    verdict = verdict_on(Claim("key", "It is so.", "", findings, "", conditional, "it is nearly so"))
    assert (verdict.outcome, verdict.qualifier) == (outcome, qualifier)


def test_the_planted_slope_is_in_its_interval() -> None:
    for key, slope in (("normal-distance", 1.5), ("position-calibrated", 2.5), ("reprojection-calibrated", 0.5)):
        (v,) = (v for v in records_of(table_of(per_cell=30), STUDY) if v["key"] == key)
        assert v["low"] < slope < v["high"]
        assert v["high"] - v["low"] < 0.35


def test_distances_that_were_drawn_decide_as_a_grid_does() -> None:
    assert outcomes(table_of(spread=True)) == outcomes(table_of())


def test_too_few_frames_decide_nothing() -> None:
    found = records_of(table_of(per_cell=1), STUDY)
    trends = [v for v in found if v["key"] != "normal-focal"]
    assert len(trends) == len(CLAIMS) - 1
    assert {v["outcome"] for v in trends} == {OPEN}
    assert all("24 circles are too few; 30 are needed" in v["sentence"] for v in trends)
    assert all(v["value"] is None and v["p"] is None for v in trends)


def test_frames_that_were_lost_decide_nothing() -> None:
    table = table_of()
    name = "oracle_normal_error_deg"
    values = np.where(np.arange(table.num_rows) % 5 == 0, np.nan, table[name].to_numpy())
    lost = table.set_column(table.column_names.index(name), name, pa.array(values))
    (v,) = (v for v in records_of(lost, STUDY) if v["key"] == "normal-distance")
    assert v["outcome"] == OPEN
    assert "only 192 of 240 circles are solved" in v["sentence"]


def test_a_noisy_border_is_left_open() -> None:
    flat = changed("scaled:1", "normal", (1.1, 0.12, -1.0))
    assert outcomes(table_of(flat, per_cell=4))["normal-distance"] == OPEN


def test_what_is_left_open_says_why() -> None:
    found = Finding("g", True, "ratio", 1.9, 1.1, 3.3, 42, "above 1", 0.02, True)
    assert decided(found, 0.03).holds is True
    among_many, near = decided(found, 0.08), decided(replace(found, low=0.9, p=0.2), 0.4)
    assert (among_many.holds, among_many.reason) == (None, "it is not significant after Holm's correction")
    assert (near.holds, near.reason) == (None, "the interval crosses the limit")


def test_groups_that_disagree_make_a_condition() -> None:
    flat = changed("scaled:1", "reprojection", (0.9, 0.0, 0.0))
    study = {**STUDY, "groups": {"perimeter": STUDY["groups"]["main"], "n200": STUDY["groups"]["main"]}}
    tables = [table_of(groups=("perimeter",)), table_of(flat, groups=("n200",))]
    (v,) = (v for v in records_of(pa.concat_tables(tables), study) if v["key"] == "reprojection-calibrated")
    assert v["outcome"] == CONDITION
    assert {s["where"]: s["holds"] for s in v["sides"]} == {"perimeter": True, "n200": False}
    assert v["qualifier"] == "It holds for perimeter; it does not hold for n200."


def test_off_axis_frames_stand_beside_the_papers() -> None:
    study = {**STUDY, "groups": {"near": STUDY["groups"]["main"], "far": STUDY["groups"]["main"]}}
    turned = changed("scaled:0.7", "normal", (3.0, 1.5, -1.0))
    aside = table_of(turned, groups=("far",), off_axis_px=466.0)
    (v,) = (v for v in records_of(pa.concat_tables([table_of(groups=("near",)), aside]), study) if "focal" in v["key"])
    assert v["outcome"] == CONDITION
    assert [(s["where"], s["holds"]) for s in v["sides"]] == [("near", True), ("far", False)]
    assert "20.0 deg off axis" in v["sentence"]
    # Off the axis alone nothing of the paper's can be decided, and nothing is said.
    assert records_of(aside, study) == []


@pytest.mark.parametrize(
    "change",
    [
        {"sweep": {"key": "sensor.read_noise_e", "levels": [1, 2]}},
        {"camera": {"width_px": 1280, "height_px": 720, "focal_px": {"uniform": [900, 1300]}}},
    ],
)
def test_a_study_of_something_else_gets_no_verdict(change: dict) -> None:
    study = {**STUDY, "groups": {"main": {**STUDY["groups"]["main"], **change}}}
    assert records_of(table_of(), study) == []


@pytest.mark.parametrize("label", ["scaled:1", "scaled:0.7"])
def test_without_a_pair_of_intrinsics_there_is_no_verdict(label: str) -> None:
    assert records_of(table_of({label: LAWS[label]}), STUDY) == []


@pytest.mark.slow
def test_false_verdicts_are_rare() -> None:
    # Every claim at its border: whichever way a side is decided, it is wrong.
    level = 1.25 * 0.9 * (50 / 15) ** 0.2  # a quarter above the calibrated error at 50 D
    laws = {
        "scaled:1": {"normal": (1.1, 0.1, 0.0), "position": (0.03, 0.1, 0.0), "reprojection": (0.9, 0.1, 0.0)},
        "scaled:0.7": {"normal": (1.1, 0.1, 0.0), "position": (4.5, 1.05, 0.0), "reprojection": (level, -0.1, 0.0)},
    }
    keys = ("normal-distance", "position-calibrated", "position-uncalibrated", "reprojection-calibrated")
    keys += ("reprojection-uncalibrated", "reprojection-meets", "normal-tilt")
    wrong, single = 0, dict.fromkeys(keys, 0)
    for seed in range(200):
        sides = {v["key"]: v["sides"][0] for v in records_of(table_of(laws, seed=seed), STUDY)}
        decided = [key for key in keys if sides[key]["holds"] is not None]
        wrong += bool(decided)
        for key in keys:
            single[key] += not (sides[key]["low"] <= border(key) <= sides[key]["high"])
    # Holm keeps the family at 5 %: 10 of 200, with a binomial's three standard errors above.
    assert wrong <= 10 + 3 * np.sqrt(10)
    # Each interval alone misses its border in 5 %; the lower of two ratios (tilt) misses more often, on the safe side.
    assert all(n <= 10 + 4 * np.sqrt(10) for key, n in single.items() if key != "normal-tilt"), single


def border(key: str) -> float:
    named = {"normal-tilt": 1.0, "position-uncalibrated": 1.05, "reprojection-uncalibrated": -0.1}
    return {**named, "reprojection-meets": 1.25}.get(key, 0.1)


def test_every_verdict_names_its_own_picture_and_is_plain_json() -> None:
    verdicts = verdicts_of(table_of(), STUDY)
    drawn = verdict_pictures(table_of(), STUDY, verdicts)
    assert [p.name for p in drawn] == [v.picture for v in verdicts]
    assert len({p.name for p in drawn}) == len(drawn)
    records = [verdict_record(v) for v in verdicts]
    assert json.loads(json.dumps(records, allow_nan=False)) == records
    assert [r["picture"] for r in records] == [v.picture for v in verdicts]
    assert verdict_pictures(table_of(), STUDY, []) == []
    again = verdict_pictures(table_of(), STUDY, verdicts)
    assert [p.svg for p in again] == [p.svg for p in drawn]
    for picture in drawn:
        assert "distance [D]" in picture.svg or "focal length used / true" in picture.svg
        assert "var(--curve-" in picture.svg
        assert standalone_svg(picture).startswith("<svg")


def test_a_small_study_is_decided_through_the_scores(tmp_path: Path) -> None:
    # True ellipses moved by 0.1 px: 36 frames near the axis at 15, 25 and 40 D.
    dataset = make_dataset(tmp_path / "data", POINTS.replace("[-5, 5]", "[-2, 2]"))
    rows = estimate_rows(dataset, ["scaled:0.7", "scaled:1", "scaled:1.3"], noise_px=0.1)
    runs = read_runs([write_estimates(tmp_path / "est.parquet", rows)], dataset)
    table = score(dataset, true_targets(dataset, 3.0), runs).table
    found = {v["key"]: v for v in records_of(table, dataset.study)}
    assert len(found) == len(CLAIMS)
    assert found["position-uncalibrated"]["outcome"] == HOLDS
    assert found["position-uncalibrated"]["value"] == pytest.approx(1.0, abs=0.05)
    assert found["normal-focal"]["outcome"] == CONDITION


@pytest.mark.slow
def test_a_report_carries_its_verdicts(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", POINTS.replace("[-5, 5]", "[-2, 2]"))
    rows = estimate_rows(dataset, ["scaled:0.7", "scaled:1", "scaled:1.3"], noise_px=0.1)
    write_estimates(tmp_path / "est" / "estimates.parquet", rows)
    summary = validate_dataset(tmp_path / "data", [tmp_path / "est"], tmp_path / "report")
    html = (tmp_path / "report" / "report.html").read_text()
    assert len(summary.verdicts) == len(CLAIMS)
    for verdict in summary.verdicts:
        assert f'aria-label="{verdict["claim"]}"' in html
        assert verdict["outcome"] in html


@pytest.mark.parametrize(
    ("key", "laws", "per_cell", "outcome"),
    [
        # A slope of 0.2 grows: more than 0.1, which is what the claim asks for.
        ("normal-distance", changed("scaled:1", "normal", (1.1, 0.2, -1.0)), 150, HOLDS),
        # A wrong focal length that adds 0.2 degrees matters: "does not depend" means less than 0.1.
        (
            "normal-focal",
            {
                "scaled:1": {**LAWS["scaled:1"], "normal": (0.5, 0.0, 0.0)},
                "scaled:0.7": {**LAWS["scaled:0.7"], "normal": (0.7, 0.0, 0.0)},
            },
            20,
            FALSE,
        ),
        # A slope of 1.1 is not linear: within 0.05 of 1 is.
        ("position-uncalibrated", changed("scaled:0.7", "position", (4.5, 1.1, 0.0)), 20, FALSE),
    ],
)
def test_the_limits_of_the_verdicts_are_those_that_are_published(
    key: str, laws: dict, per_cell: int, outcome: str
) -> None:
    assert outcomes(table_of(laws, per_cell=per_cell))[key] == outcome


def test_a_focal_length_off_by_four_percent_is_no_uncalibrated_case() -> None:
    wrong = {"scaled:1": LAWS["scaled:1"], "scaled:0.96": LAWS["scaled:0.7"]}
    assert verdicts_of(table_of(wrong), STUDY) == []
    wrong = {"scaled:1": LAWS["scaled:1"], "scaled:0.94": LAWS["scaled:0.7"]}
    assert len(verdicts_of(table_of(wrong), STUDY)) == len(CLAIMS)
