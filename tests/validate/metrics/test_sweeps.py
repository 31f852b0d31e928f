"""Sweeps: which frames are the same frame at another level."""

from __future__ import annotations

from pathlib import Path

from helpers_reports import POINTS, estimate_rows, make_dataset, write_estimates

from roundel.datasets.layout.sweeps import sweep_keys, sweep_positions
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import frame_of
from roundel.validate.estimates.runs import read_runs
from roundel.validate.metrics.ground_truth import true_targets
from roundel.validate.scores.scores import score

SWEPT = POINTS.replace(
    "solve: {",
    "groups:\n  z_first: {}\n  a_swept:\n    sweep: {key: points.sigma_px, levels: [0.5, 1, 4]}\nsolve: {",
)


def test_a_frame_keeps_its_position_over_the_levels(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "ds", SWEPT)
    study = load_study(tmp_path / "ds.yaml")
    # Frames themselves know: their level, and their index within it.
    expected = {i: (frame_of(study, i).level, frame_of(study, i).index) for i in range(0, 144, 7)}
    found = sweep_positions(dataset.images, dataset.manifest)
    assert {i: found[i] for i in expected} == expected
    assert sweep_keys(dataset.manifest) == {"a_swept": "points.sigma_px"}
    estimates = write_estimates(tmp_path / "e.parquet", estimate_rows(dataset, ["true"]))
    rows = score(dataset, true_targets(dataset, 3.0), read_runs([estimates], dataset)).table.to_pylist()
    assert [(r["sweep_level"], r["sweep_frame"]) for r in rows] == [found[i] for i in range(144)]
    paired = {r["sweep_frame"]: r["distance_D"] for r in rows if r["sweep_level"] == 0.5}
    assert all(r["distance_D"] == paired[r["sweep_frame"]] for r in rows if r["sweep_level"] == 4)
