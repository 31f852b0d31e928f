"""`roundel develop` with a sweep: every frame once per level of the sensor, as a study with that sweep has them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import digests, small_study

from roundel.cli.main import main
from roundel.datasets.dataset import open_dataset
from roundel.datasets.layout import files
from roundel.datasets.layout.developed import developed_of
from roundel.datasets.layout.radiance import read_radiance
from roundel.render.redevelop import develop_dataset
from roundel.render.run import render_study
from roundel.scenes.errors import StudyError
from roundel.scenes.study.sensor_file import study_with_sensor
from roundel.scenes.world.frame import frame_of, group_ranges

TINY = (
    ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 64, height_px: 48, focal_px: 128"),
    ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: {uniform: [-5, 5]}"),
    ("band_samples: 256", "band_samples: 64"),
)
# Points come first and have no levels, and boards that calibrate have one: the numbers of frames change.
GROUPS = """\
groups:
  drawn: {mode: points, frames: 2}
  seen: {frames: 2}
  boards: {frames: 1, marker: {kind: chessboard, columns: 5, rows: 4, square_m: 0.01}, pose: {distance_m: 0.6}}
solve: {calibrate_from: boards}
"""
SWEEP = "read_noise_e: 2\nsweep: {key: sensor.full_well_e, levels: [9000, 300]}\n"


def sensor_file(folder: Path, text: str) -> Path:
    path = folder / "sensor.yaml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of three groups, and it at two levels."""
    folder = tmp_path_factory.mktemp("made")
    render_study(small_study(folder, *TINY, ("frames: 4\n", GROUPS)), folder / "ds")
    develop_dataset(folder / "ds", folder / "out", sensor_file(folder, SWEEP))
    return folder


def test_it_is_what_rendering_the_sweep_would_have_made(made: Path, tmp_path: Path) -> None:
    out = open_dataset(made / "out")
    assert out.verify(full=True) == []
    swept = GROUPS.replace(
        "seen: {frames: 2}", "seen: {frames: 2, sweep: {key: sensor.full_well_e, levels: [9000, 300]}}"
    ).replace("groups:", "sensor: {read_noise_e: 2}\ngroups:")
    direct = render_study(small_study(tmp_path, *TINY, ("frames: 4\n", swept)), tmp_path / "direct")
    assert direct is not None
    assert out.manifest["dataset_id"] == direct.manifest["dataset_id"]
    assert out.manifest["files"] == direct.manifest["files"]
    assert [record["sensor"]["full_well_e"] for record in out.images.records if "sensor" in record] == [
        9000, 9000, 300, 300, 10_000
    ]  # fmt: skip


def test_the_manifest_says_whose_radiance_each_frame_has(made: Path, tmp_path: Path) -> None:
    source, out = open_dataset(made / "ds"), open_dataset(made / "out")
    origin = developed_of(out.manifest)
    assert origin is not None
    assert origin.dataset_id == origin.rendered_id == source.manifest["dataset_id"]
    groups = zip(out.images.groups, out.images.frame_ids, strict=True)
    assert [origin.source_of(group, i) for group, i in groups] == [0, 1, 2, 3, 2, 3, 4]
    for mine, theirs in ((3, 3), (4, 2), (5, 3), (6, 4)):
        np.testing.assert_array_equal(
            *(read_radiance(p / files.radiance_name(i))["Y"] for p, i in ((made / "out", mine), (made / "ds", theirs)))
        )
    # Developed once more, the frames are still those that were rendered.
    again = develop_dataset(made / "out", tmp_path / "again", sensor_file(tmp_path, "curve: srgb"))
    further = developed_of(again.manifest)
    assert further is not None
    assert (further.dataset_id, further.rendered_id) == (out.manifest["dataset_id"], origin.rendered_id)
    assert further.groups == origin.groups
    # So they are in a copy that was merged.
    assert main(["merge", str(made / "out"), str(tmp_path / "merged")]) == 0
    assert digests(tmp_path / "merged") == digests(made / "out")


def test_it_resumes(made: Path, tmp_path: Path, capsys) -> None:
    shutil.copytree(made / "out", tmp_path / "out")
    for name in (files.MANIFEST, files.image_name(4), files.image_name(6)):
        (tmp_path / "out" / name).unlink()
    command = ["develop", str(made / "ds"), str(tmp_path / "out"), "--sensor", str(sensor_file(tmp_path, SWEEP))]
    assert main(command) == 0
    assert "7 frames (2 levels of sensor.full_well_e), dataset_id" in capsys.readouterr().out
    assert digests(tmp_path / "out") == digests(made / "out")
    (tmp_path / "sensor.yaml").write_text(SWEEP.replace("300", "400"))
    assert main(command) == 2
    assert "another study" in capsys.readouterr().err


def test_levels_may_be_words(made: Path, tmp_path: Path) -> None:
    out = develop_dataset(
        made / "ds", tmp_path / "out", sensor_file(tmp_path, "sweep: {key: sensor.curve, levels: [linear, srgb]}")
    )
    seen = [record["sensor"]["curve"] for record in out.images.records if record["group"] == "seen"]
    assert seen == ["linear", "linear", "srgb", "srgb"]
    assert out.images.image(4).mean() > out.images.image(2).mean() + 20
    study = json.loads((tmp_path / "out" / files.MANIFEST).read_text())["study"]
    assert study["groups"]["seen"]["sweep"]["levels"] == ["linear", "srgb"]


def test_the_radiance_may_be_left_out(made: Path, tmp_path: Path, capsys) -> None:
    sensor = str(sensor_file(tmp_path, SWEEP))
    out = tmp_path / "out"
    assert main(["develop", str(made / "ds"), str(out), "--sensor", sensor, "--no-radiance"]) == 0
    dataset, whole = open_dataset(out), open_dataset(made / "out")
    assert dataset.verify(full=True) == []
    assert not (out / files.RADIANCE).exists()
    # All else is the same.
    ours = {name: its for name, its in dataset.manifest["files"].items() if name.startswith("images/")}
    assert ours == {name: its for name, its in whole.manifest["files"].items() if name.startswith("images/")}
    assert dataset.truth.equals(whole.truth)
    assert developed_of(dataset.manifest) == developed_of(whole.manifest)
    capsys.readouterr()
    assert main(["develop", str(out), str(tmp_path / "again"), "--sensor", sensor]) == 2
    assert "was rendered without its radiance" in capsys.readouterr().err


def test_levels_of_whole_numbers_and_of_nested_keys(tmp_path: Path) -> None:
    study = small_study(tmp_path, ("frames: 4", "frames: 2\nsensor: {exposure_ph: 20000, isp: phone}"))
    for key, levels, value in (
        ("bits", "[8, 12]", lambda s: s.bits == 12),
        ("isp.contrast", "[0, 0.5]", lambda s: s.isp.contrast == 0.5 and s.isp.saturation == 1.15),
        ("isp", "[phone, none]", lambda s: not s.isp.active),
        ("exposure_e", "[100, 900]", lambda s: (s.exposure_e, s.exposure_ph) == (900, None)),
    ):
        swept = study_with_sensor(study, sensor_file(tmp_path, f"sweep: {{key: sensor.{key}, levels: {levels}}}"))
        assert value(frame_of(swept, 3).settings.sensor), key
        assert group_ranges(swept) == {"main": range(4)}
        # The scene is the same.
        np.testing.assert_array_equal(frame_of(swept, 3).camera_from_sheet, frame_of(study, 1).camera_from_sheet)


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("sweep: {key: camera.f_number, levels: [2]}", 1, 9, "camera.f_number: needs rendering; these keys of the"),
        ("bits: 8\nsweep: {key: pose.tilt_deg, levels: [2]}", 2, 9, "can be re-exposed: white_level, exposure_e"),
        ("sweep: {key: sensor.mosaic, levels: [rggb]}", 1, 9, "determines which rays are traced, and needs rendering"),
        ("sweep: {key: full_well_e, levels: [2]}", 1, 9, "write sensor.full_well_e"),
        ("sweep: {key: sensor.full_wel_e, levels: [2]}", 1, 9, "no such key, did you mean full_well_e?"),
        ("sweep: {key: sensor.bits.x, levels: [2]}", 1, 9, "no key 'sensor.bits.x' in this sensor"),
        ("sweep: {key: sensor.curve, levels: [srgb, sgrb]}", 1, 43, "sgrb: curve: input should be 'linear', 'srgb'"),
        ("sweep: {key: sensor.jpeg_quality, levels: [90, 300]}", 1, 48, "300: jpeg_quality: 300 is out of range"),
        ("sweep: {key: sensor.bits, levels: [8, srgb]}", 1, 1, "levels are numbers or words, not both"),
        ("sweep: {key: sensor.bits, levels: [true]}", 1, 36, "give a number, or a word that the key takes"),
        ("sweep: {key: sensor.bits, levels: []}", 1, 27, "at least 1 item"),
        ("sweep: {key: sensor.bits, level: [8]}", 1, 1, "levels: required key is missing"),
        ("\nbits: 8\nsweep: {key: sensor.bits, levels: [8]}", 2, 1, "bits: is swept as well"),
        ("sweep: {key: sensor.white_level, levels: [0.5]}", 1, 1, "fixed exposure; add `exposure_ph: null`"),
        ("sweep: 3", 1, 1, "a mapping of keys"),
        ("sensor: {bits: 8}\nsweeep: {}", 1, 1, "sensor: unknown key"),
    ],
)
def test_what_cannot_be_swept_is_said_at_its_place(
    tmp_path: Path, text: str, line: int, column: int, words: str
) -> None:
    study = small_study(tmp_path, ("frames: 4", "frames: 2\nsensor: {exposure_ph: 20000}"))
    with pytest.raises(StudyError) as caught:
        study_with_sensor(study, sensor_file(tmp_path, text))
    assert words in str(caught.value)
    assert (caught.value.line, caught.value.column) == (line, column)


def test_a_group_has_one_sweep(tmp_path: Path) -> None:
    swept = "frames: 2\nsweep: {key: camera.f_number, levels: [2, 8]}"
    study = small_study(tmp_path, ("frames: 4", swept))
    with pytest.raises(StudyError, match=r"sweep: group main sweeps camera\.f_number, and a group has one sweep"):
        study_with_sensor(study, sensor_file(tmp_path, SWEEP))
    gridded = small_study(tmp_path, ("frames: 4", "frames: 2\nsensor: {full_well_e: {grid: [2000, 4000]}}"))
    with pytest.raises(StudyError, match=r"sweep: group main has a grid of sensor\.full_well_e"):
        study_with_sensor(gridded, sensor_file(tmp_path, SWEEP))
    points = small_study(tmp_path, ("frames: 4", "frames: 2\nmode: points"))
    with pytest.raises(StudyError, match="sweep: no group has images to repeat"):
        study_with_sensor(points, sensor_file(tmp_path, SWEEP))
