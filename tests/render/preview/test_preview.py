"""Previews: the small frame is the same scene, the choice of frames, the facts, the page."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import SMALL, small_study
from PIL import Image

from roundel.cli.main import main
from roundel.configs.shipped import study_names, study_path
from roundel.render.preview.frame_facts import facts_of, field_of_view_deg
from roundel.render.preview.frame_selection import MOST_FRAMES, chosen_ids, placed_ids
from roundel.render.preview.group_facts import describe_light, describe_spread
from roundel.render.preview.preview import preview_study
from roundel.render.preview.small_frame import small_frame
from roundel.render.scene.textures import TILE_M, coarse_textures, texture
from roundel.scenes.camera.model import project
from roundel.scenes.study.study import load_study
from roundel.scenes.study.values import Spread
from roundel.scenes.world.frame import frame_of, total_frames


def test_a_small_frame_sees_the_same_scene(tmp_path: Path) -> None:
    lens = ("focal_px: 320", "focal_px: 320, distortion: [-0.2, 0.05, 0.001, 0.002]")
    frame = frame_of(small_study(tmp_path, lens), 1)
    small = small_frame(frame, 80)
    assert (small.camera.width_px, small.camera.height_px) == (80, 60)
    points = np.array([[0.02, -0.01, 0.5], [-0.1, 0.06, 0.8]])
    full, half = project(frame.camera, points), project(small.camera, points)
    # Corners of pixels scale, not centres: the corner of the image is at -0.5.
    assert half + 0.5 == pytest.approx((full + 0.5) / 2, abs=1e-9)


def test_rows_are_exposed_at_the_same_time(tmp_path: Path) -> None:
    rolling = ("frames: 4", "frames: 4\nmotion: {readout_s: 0.02, frame_s: 0.1, exposure_s: 0.01}")
    frame = frame_of(small_study(tmp_path, rolling), 0)
    small = small_frame(frame, 80)
    for y in (0.0, 60.0, 119.0):
        assert small.motion.row_time_s((y + 0.5) / 2 - 0.5) == pytest.approx(frame.motion.row_time_s(y), abs=1e-12)


def test_noise_is_that_of_binned_pixels(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path), 0)
    small = small_frame(frame, 80).settings.sensor
    assert small.full_well_e == 4 * frame.settings.sensor.full_well_e
    assert small.read_noise_e == 2 * frame.settings.sensor.read_noise_e


def test_small_images_are_not_enlarged(tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path), 0)
    same = small_frame(frame, 320).camera
    assert (same.width_px, same.height_px) == (160, 120)
    assert np.array_equal(same.K, frame.camera.K)


@pytest.mark.parametrize("name", study_names())
def test_every_shipped_study_has_frames_to_show_from_its_groups(name: str) -> None:
    study = load_study(study_path(name))
    chosen = chosen_ids(study)
    assert 1 <= sum(map(len, chosen.values())) <= MOST_FRAMES
    assert len(chosen) == min(len(study.groups), MOST_FRAMES)
    assert set(placed_ids(study)) == set(study.groups)
    assert max(i for ids in chosen.values() for i in ids) < total_frames(study)


def test_facts_of_a_head_on_disc(tmp_path: Path) -> None:
    head_on = (("{uniform: [7, 9]}", "8"), ("{uniform: [10, 50]}", "0"))
    offset = ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: 0")
    facts = facts_of(frame_of(small_study(tmp_path, *head_on, offset), 0))
    (marker,) = facts.markers
    # 320 px of focal length at 8 diameters: 40 px.
    assert marker.size_px == pytest.approx(40.0, rel=1e-6)
    assert (marker.distance_m, marker.distance_D, marker.tilt_deg) == pytest.approx((0.64, 8.0, 0.0), abs=1e-6)
    # 160 and 120 px behind 320 px.
    assert facts.view_deg == pytest.approx((28.0725, 21.2393), abs=1e-4)
    assert facts.caption == "40 px, 0.64 m (8 D), 0 deg"


def test_the_field_of_view_of_a_fisheye_may_exceed_180_degrees(tmp_path: Path) -> None:
    camera = frame_of(small_study(tmp_path), 0).camera
    k = camera.K.copy()
    k[0, 0] = k[1, 1] = 45.0
    wide = replace(camera, K=k, distortion_model="fisheye", distortion=(0.0, 0.0, 0.0, 0.0))
    assert field_of_view_deg(wide)[0] == pytest.approx(np.degrees(160 / 45), abs=1e-6)


def test_distributions_and_lights_in_words(tmp_path: Path) -> None:
    assert describe_spread(Spread("loguniform", (5.0, 50.0))) == "loguniform, 5 to 50"
    assert describe_spread(Spread("choice", (1.8, 2.8))) == "choice of 1.8, 2.8"
    assert describe_light(small_study(tmp_path).groups["main"]) == "uniform 0.7, 1 area lamp"


def test_coarse_textures_are_the_same_pattern_and_leave_the_fine_ones_alone() -> None:
    for kind in ("wood", "brick", "fabric"):
        fine = texture(kind, (0.3, 0.4, 0.5), 7)
        with coarse_textures(256):
            coarse = texture(kind, (0.3, 0.4, 0.5), 7)
        assert coarse.shape == (256, 256, 3)
        assert kind in TILE_M
        # Point samples of one pattern: equal where both have a sample.
        assert np.corrcoef(coarse[..., 1].ravel(), fine[::2, ::2, 1].ravel())[0, 1] > 0.9
        assert np.array_equal(texture(kind, (0.3, 0.4, 0.5), 7), fine)


def test_a_preview_is_a_sheet_and_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "small.yaml", tmp_path / "out"
    path.write_text(SMALL.replace("name: small", "name: a <b> & c").replace("diameter_m: 0.08", "diameter_m: 8"))
    lines = preview_study(load_study(path), out)
    assert len(lines) == 1
    assert lines[0].startswith("main: 4 frames; 160x120 px, 28 deg x 21 deg; disc, 8000 mm: ")
    assert "uniform 0.7, 1 area lamp" in lines[0]
    sheet = Image.open(io.BytesIO((out / "contact_sheet.png").read_bytes()))
    # Four tiles of 160x120 px in a row.
    assert sheet.width == 4 * 168 + 8
    tile = np.asarray(sheet)[8:128, 8:168]
    assert tile.min() < 60
    assert tile.max() > 150
    page = (out / "preview.html").read_text()
    assert "a &lt;b&gt; &amp; c" in page
    assert "uniform, 10 to 50" in page
    assert "a print of 8 m; lengths are in metres" in page
    assert page.count("data:image/jpeg") == 4
    assert main(["preview", str(path), str(path)]) == 2
    assert "is a file" in capsys.readouterr().err


def test_points_are_drawn_without_the_renderer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("roundel.render.preview.preview.render_small", refuse)
    study = small_study(tmp_path, ("frames: 4", "frames: 4\nmode: points"))
    assert "no light: points" in preview_study(study, tmp_path / "out")[0]
