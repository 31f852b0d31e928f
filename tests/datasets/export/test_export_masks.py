"""Masks and depth of rendered frames in exports: what an occluder hides, and what formats cannot hold."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.cli.main import main
from roundel.datasets.dataset import Dataset
from roundel.datasets.export import bop
from roundel.datasets.stream.frames import frame_source
from roundel.datasets.stream.masks import mask_of_runs, run_lengths
from roundel.render.run import render_study
from roundel.scenes.study.study import load_study

STUDY = """\
schema: 1
name: hidden
seed: 3
camera: {width_px: 96, height_px: 72, focal_px: 96}
marker: {kind: disc, diameter_m: 0.08}
pose: {distance_m: 0.4, tilt_deg: 25, azimuth_deg: {uniform: [-180, 180]}}
light: {environment: 0.7}
render: {radiance: true}
groups:
  free: {frames: 2}
  hidden:
    frames: 2
    occluders:
      - {shape: rectangle, x_m: 0.05, y_m: 0.0, z_m: 0.005, width_m: 0.08, height_m: 0.12, reflectance: 0.5}
"""


def rendered(folder: Path, text: str) -> Dataset:
    folder.mkdir()
    (folder / "study.yaml").write_text(text)
    dataset = render_study(load_study(folder / "study.yaml"), folder / "ds")
    assert dataset is not None
    return dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return rendered(tmp_path_factory.mktemp("masks") / "kept", STUDY)


def test_the_visible_mask_is_what_an_occluder_leaves(dataset: Dataset) -> None:
    source = frame_source(dataset, lambda index: "train", masks=True)
    for index in range(len(dataset)):
        frame = source(index)
        (marker,) = frame.markers
        full, visible = marker.full_mask, marker.visible_mask
        assert not np.any(visible & ~full)
        if frame.group == "free":
            # To the pixel, whatever the noise of the coverage at the edge.
            assert np.array_equal(full, visible)
            continue
        # Pixels against areas: half a pixel along both borders.
        share = visible.sum() / full.sum()
        assert share == pytest.approx(marker.truth["visible_fraction"], abs=1.5 * np.sqrt(full.sum()) / full.sum())
        assert 0.1 < share < 0.95


def test_without_coverage_what_is_hidden_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare = rendered(tmp_path / "bare", STUDY.replace("radiance: true", "radiance: false"))
    for name in ("coco", "bop", "yolo", "webdataset", "huggingface"):
        assert main(["export", str(bare.path), str(tmp_path / name), "--format", name]) == 3
        error = capsys.readouterr().err.splitlines()[-1]
        assert "occluder hides a part of marker 0" in error
        assert not (tmp_path / name).exists()
    assert main(["export", str(bare.path), str(tmp_path / "free"), "--format", "coco", "--groups", "free"]) == 0
    found = json.loads((tmp_path / "free" / "annotations" / "instances_train.json").read_text())
    assert len(found["annotations"]) == 2
    # With masks alone, everything is there.
    kept = rendered(tmp_path / "kept", STUDY.replace("radiance: true", "radiance: false, masks: true"))
    assert main(["export", str(kept.path), str(tmp_path / "bop"), "--format", "bop"]) == 0
    assert len(list((tmp_path / "bop").rglob("depth/*.png"))) == len(kept)
    assert main(["verify", str(tmp_path / "bop"), "--against", str(kept.path)]) == 0
    # Nothing of what is hidden is needed for these.
    assert main(["export", str(bare.path), str(tmp_path / "croissant"), "--format", "croissant"]) == 0


def test_depth_that_does_not_fit_is_refused(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bop, "_DEPTH_MM", (1e-4,))
    out = tmp_path / "bop"
    assert main(["export", str(dataset.path), str(out), "--format", "bop"]) == 2
    assert "does not fit into BOP's 16 bits" in capsys.readouterr().err
    assert not out.exists()
    assert main(["export", str(dataset.path), str(out), "--format", "bop", "--no-depth"]) == 0
    assert not list(out.rglob("depth"))
    assert main(["verify", str(out), "--against", str(dataset.path)]) == 0


@given(st.lists(st.booleans(), max_size=60), st.integers(1, 6))
def test_run_lengths_are_read_back(pixels: list[bool], height: int) -> None:
    width = len(pixels) // height
    mask = np.array(pixels[: height * width], dtype=bool).reshape(height, width)
    counts = run_lengths(mask)
    assert sum(counts) == mask.size
    assert np.array_equal(mask_of_runs(counts, height, width), mask)
    assert not mask.size or (counts[0] == 0) == bool(mask[0, 0])
