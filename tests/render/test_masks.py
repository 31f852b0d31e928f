"""Depth and coverage without the radiance: the same planes; such datasets resume, verify, repair, join and travel."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers_studies import digests, small_study

from roundel.cli.cost import disk_bytes
from roundel.cli.main import main
from roundel.datasets.dataset import open_dataset
from roundel.datasets.layout import files, shards
from roundel.datasets.layout.contents import read_contents
from roundel.datasets.layout.masks import decode_masks, masks_of
from roundel.datasets.layout.radiance import Planes
from roundel.datasets.merge import merge_datasets
from roundel.datasets.pull import pull_dataset
from roundel.datasets.store.folder import Folder
from roundel.datasets.store.records import document_of, record_of_document
from roundel.render import backend
from roundel.render.redevelop import develop_dataset
from roundel.render.run import render_study
from roundel.scenes.errors import DataError, StudyError, UsageError
from roundel.scenes.study.study import Study

# Two shards of two frames, with a card in front of the print.
CARD = "occluders: [{shape: rectangle, x_m: -0.05, y_m: 0.02, z_m: 0.06, width_m: 0.06, height_m: 0.12}]\nlight:"
TINY = (
    ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 64, height_px: 48, focal_px: 128"),
    ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: {uniform: [-5, 5]}"),
    ("light:", CARD),
)
BAND = "band_samples: 256"


def study_of(folder: Path, keys: str) -> Study:
    return small_study(folder, *TINY, (BAND, f"band_samples: 16{keys}"))


def render(folder: Path, keys: str) -> Path:
    render_study(study_of(folder, keys), folder / "ds")
    return folder / "ds"


def planes_of(dataset: Path, frame_id: int) -> Planes | None:
    contents = read_contents(Folder(dataset))
    return masks_of(contents, contents.parts[contents.place_of(frame_id)[0]], frame_id)


@pytest.fixture(autouse=True)
def small_shards(monkeypatch) -> None:
    """Shards of two frames."""
    monkeypatch.setattr(shards, "SHARD_FRAMES", 2)


@pytest.fixture(scope="module")
def masks(tmp_path_factory) -> Path:
    """A dataset with masks and no radiance."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shards, "SHARD_FRAMES", 2)
        return render(tmp_path_factory.mktemp("masks"), ", radiance: false, masks: true")


@pytest.fixture(scope="module")
def radiance(tmp_path_factory) -> Path:
    """The same frames with their radiance."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shards, "SHARD_FRAMES", 2)
        return render(tmp_path_factory.mktemp("radiance"), ", masks: true")


def test_masks_are_planes_of_the_radiance_bit_for_bit(masks: Path, radiance: Path) -> None:
    assert open_dataset(masks).verify(full=True) == open_dataset(radiance).verify(full=True) == []
    for i in range(4):
        folder = f"shards/0000{i // 2}"
        assert not (masks / folder / files.RADIANCE).exists()
        # With the radiance no second file is written.
        assert not (radiance / folder / files.MASKS).exists()
        found, wanted = planes_of(masks, i), planes_of(radiance, i)
        assert set(found) == set(wanted) == {"Z", "coverage.0"}
        for name, plane in found.items():
            np.testing.assert_array_equal(plane.view(np.uint32), wanted[name].view(np.uint32))
        own = masks / folder / files.masks_name(i)
        assert set(decode_masks(own.read_bytes(), str(own))) == {"Z", "coverage.0"}
        image = files.image_name(i)
        assert (masks / folder / image).read_bytes() == (radiance / folder / image).read_bytes()


def test_neither_is_kept_unless_asked_for(tmp_path: Path) -> None:
    assert planes_of(render(tmp_path, ", radiance: false"), 0) is None


def test_the_key_at_its_default_is_no_other_study(tmp_path: Path, masks: Path) -> None:
    plain = study_of(tmp_path, ", radiance: false").digest()
    assert study_of(tmp_path, ", radiance: false, masks: false").digest() == plain
    assert open_dataset(masks).manifest["dataset_id"] != plain


def test_an_altered_mask_is_refused_found_and_made_again(masks: Path, tmp_path: Path, capsys) -> None:
    name = f"shards/00001/{files.masks_name(3)}"
    for damage in (b"", b"half", None):
        copy = tmp_path / "ds"
        shutil.copytree(masks, copy)
        if damage is None:
            data = bytearray((copy / name).read_bytes())
            data[len(data) // 2] ^= 0xFF
            (copy / name).write_bytes(data)
        elif damage:
            (copy / name).write_bytes(damage)
        else:
            (copy / name).unlink()
        with pytest.raises(DataError, match=r"masks/000003\.exr"):
            planes_of(copy, 3)
        assert [f.name for f in open_dataset(copy).verify(full=True)] == [name]
        stray = copy / "shards/00000" / files.MASKS / "000007.exr"
        stray.write_bytes(b"x")
        assert str(stray.relative_to(copy)) in [f.name for f in open_dataset(copy).verify()]
        assert main(["repair", str(copy)]) == 0
        assert "1 frames rendered anew" in capsys.readouterr().out
        assert digests(copy) == digests(masks)
        shutil.rmtree(copy)


def test_parts_resume_and_join_to_the_same_bytes(masks: Path, tmp_path: Path) -> None:
    study = study_of(tmp_path, ", radiance: false, masks: true")
    assert render_study(study, tmp_path / "ds", frames=range(1, 3)) is None
    # A torn file of a frame that was not recorded, and one that is missing.
    (tmp_path / "ds/shards/00001" / files.masks_name(2)).unlink()
    (tmp_path / "ds/shards/00000" / files.MASKS / ".000000.exr.x.part").write_bytes(b"half")
    assert render_study(study, tmp_path / "ds") is not None
    assert digests(tmp_path / "ds") == digests(masks)
    for i, some in enumerate((range(2), range(2, 4))):
        render_study(study, tmp_path / f"part{i}", frames=some)
    assert merge_datasets([tmp_path / "part0", tmp_path / "part1"], tmp_path / "joined") == (0, 4)
    assert digests(tmp_path / "joined") == digests(masks)


def test_pulled_frames_have_their_masks(masks: Path, tmp_path: Path) -> None:
    pull_dataset(masks, tmp_path / "some", range(1, 3))
    assert sorted(p.name for p in (tmp_path / "some").rglob("*.exr")) == ["000001.exr", "000002.exr"]
    assert open_dataset(tmp_path / "some").verify(full=True) == []
    pull_dataset(masks, tmp_path / "some")
    assert digests(tmp_path / "some") == digests(masks)


def test_masks_cannot_be_developed_but_stay_with_the_radiance(masks: Path, radiance: Path, tmp_path: Path) -> None:
    sensor = tmp_path / "sensor.yaml"
    sensor.write_text("bits: 12\n")
    with pytest.raises(UsageError, match=r"without its radiance; render it with render\.radiance: true"):
        develop_dataset(masks, tmp_path / "out", sensor)
    developed = develop_dataset(radiance, tmp_path / "out", sensor)
    assert developed.verify(full=True) == []
    for name, plane in planes_of(tmp_path / "out", 2).items():
        np.testing.assert_array_equal(plane, planes_of(radiance, 2)[name])


@pytest.mark.parametrize("value", ["often", "3", "[true]"])
def test_a_value_that_is_no_choice_is_one_line(tmp_path: Path, value: str) -> None:
    with pytest.raises(StudyError, match=r"render\.masks") as error:
        study_of(tmp_path, f", masks: {value}")
    assert "\n" not in str(error.value)


def test_the_cost_counts_masks(tmp_path: Path) -> None:
    none, masks, radiance = (
        disk_bytes(study_of(tmp_path, f", {keys}"))
        for keys in ("radiance: false", "radiance: false, masks: true", "masks: true")
    )
    assert none < masks < radiance == disk_bytes(study_of(tmp_path, ""))


def test_depth_of_an_older_version_is_not_taken_for_that_of_surfaces(radiance: Path, tmp_path: Path) -> None:
    shutil.copytree(radiance, tmp_path / "ds")
    path = tmp_path / "ds" / files.MANIFEST
    manifest = record_of_document(path.read_bytes())
    assert manifest["environment"].pop("rendering_version") == 2
    path.write_bytes(document_of(manifest))
    assert set(planes_of(tmp_path / "ds", 0)) == {"coverage.0"}


def test_frames_of_an_older_version_are_not_mixed_with_new_ones(tmp_path: Path, monkeypatch) -> None:
    study = study_of(tmp_path, ", masks: true")
    with monkeypatch.context() as patch:
        patch.setattr(backend, "_RENDERING", 1)
        render_study(study, tmp_path / "ds", frames=range(1))
    with pytest.raises(DataError, match=r"another environment \(rendering version 1, not 2\)"):
        render_study(study, tmp_path / "ds")
