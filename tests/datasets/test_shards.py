"""Datasets of several shards, slices, merging, repair, mixed environments: the same bytes whatever the way."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from helpers_studies import digests, small_study

import roundel
from roundel.cli.main import main
from roundel.datasets import environment as environments
from roundel.datasets.dataset import open_dataset
from roundel.datasets.layout import shards
from roundel.datasets.layout.images import open_images
from roundel.datasets.layout.shards import Shard
from roundel.datasets.merge import merge_datasets
from roundel.datasets.progress import ShardProgress
from roundel.datasets.work import Participant
from roundel.render.run import render_study
from roundel.scenes.errors import DataError, NotComparableError
from roundel.scenes.study.study import Study
from roundel.solver.methods.solve import solve_dataset
from roundel.validate.validate import validate_dataset

TINY = (
    ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 64, height_px: 48, focal_px: 128"),
    ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: {uniform: [-5, 5]}"),
    ("band_samples: 256", "band_samples: 16"),
    ("frames: 4", "groups: {seen: {frames: 5}, drawn: {mode: points, frames: 6}}"),
)


@pytest.fixture
def small_shards(monkeypatch) -> None:
    """Shards of four frames, so that few frames make several."""
    monkeypatch.setattr(shards, "SHARD_FRAMES", 4)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """A dataset of three shards of four frames: of images, of both, of points."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shards, "SHARD_FRAMES", 4)
        render_study(study(folder), folder / "ds")
    return folder / "ds"


def study(folder: Path) -> Study:
    return small_study(folder, *TINY)


def test_a_dataset_of_several_shards(whole: Path) -> None:
    dataset = open_dataset(whole)
    assert sorted(p.name for p in (whole / "shards").iterdir()) == ["00000", "00001", "00002"]
    assert sorted(p.name for p in whole.iterdir()) == ["manifest.json", "shards", "study.yaml"]
    assert (whole / "shards" / "00001" / "images" / "000004.png").is_file()
    assert len(dataset) == 11
    assert dataset.images.frame_ids == list(range(11))
    assert dataset.images.groups == ["seen"] * 5 + ["drawn"] * 6
    assert dataset.truth["frame_id"].to_pylist() == list(range(11))
    assert roundel.read_truth(whole)["frame_id"].to_pylist() == list(range(11))
    assert dataset.images.image(4).shape == (48, 64)
    assert set(dataset.images.points(10)) == {0}
    assert dataset.verify(full=True) == []
    counts = {"frames": 11, "images": 5, "markers": 11, "groups": {"drawn": 6, "seen": 5}}
    assert counts.items() <= dataset.manifest["counts"].items()
    measured = dataset.manifest["fidelity"]
    assert measured["circles"] + sum(measured["unmeasured"].values()) == 5


def test_solving_and_validating_by_shard_gives_what_one_shard_gives(whole: Path, tmp_path: Path) -> None:
    render_study(study(tmp_path), tmp_path / "one")
    found = {}
    for name, dataset in (("one", tmp_path / "one"), ("many", whole)):
        solve_dataset(dataset, tmp_path / f"{name}-estimates", intrinsics=("true", "default"))
        summary = validate_dataset(dataset, [tmp_path / f"{name}-estimates"], tmp_path / f"{name}-report")
        found[name] = summary
    one, many = found["one"], found["many"]
    assert one.runs == many.runs
    assert one.groups == many.groups
    assert one.caveats == many.caveats
    assert one.dataset["circles"] == many.dataset["circles"] == 11
    assert one.checksums["scores.parquet"] == many.checksums["scores.parquet"]


@pytest.mark.usefixtures("small_shards")
def test_slices_in_any_order_give_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    made = study(tmp_path)
    for frames in (range(9, 11), range(3, 9)):
        assert render_study(made, tmp_path / "ds", frames=frames) is None
    assert not (tmp_path / "ds" / "manifest.json").exists()
    assert render_study(made, tmp_path / "ds", frames=range(3)) is not None
    assert digests(tmp_path / "ds") == digests(whole)


@pytest.mark.usefixtures("small_shards")
def test_merged_parts_give_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    made = study(tmp_path)
    for number, frames in enumerate((range(2), range(2, 5), range(5, 11))):
        render_study(made, tmp_path / f"part{number}", frames=frames)
    parts = [tmp_path / f"part{number}" for number in range(3)]
    before = [digests(part) for part in parts]
    assert merge_datasets(parts[:1], tmp_path / "ds") == (3, 5)
    assert merge_datasets([parts[2], parts[1]], tmp_path / "ds") == (0, 5)
    assert digests(tmp_path / "ds") == digests(whole)
    assert [digests(part) for part in parts] == before
    # From finished datasets, too.
    assert merge_datasets([whole], tmp_path / "again") == (0, 5)
    assert digests(tmp_path / "again") == digests(whole)
    other = small_study(tmp_path, *TINY, ("seed: 3", "seed: 4"), name="other.yaml")
    render_study(other, tmp_path / "other", frames=range(1))
    with pytest.raises(NotComparableError, match="of another study"):
        merge_datasets([parts[0], tmp_path / "other"], tmp_path / "mixed")


@pytest.mark.usefixtures("small_shards")
def test_every_kind_of_damage_is_found_and_repaired(whole: Path, tmp_path: Path) -> None:
    right = digests(whole)
    for name in [*right, "none"]:
        copy = tmp_path / "ds"
        shutil.copytree(whole, copy)
        # The first byte of everything is changed in some, the last cut off in others, others are removed.
        data = (whole / name).read_bytes() if name != "none" else b""
        kind = len(name) % 3
        if name != "none":
            (copy / name).unlink()
        if name != "none" and kind:
            (copy / name).write_bytes(bytes([data[0] ^ 1]) + data[1:] if kind == 1 else data[:-1])
        (copy / "shards" / "00001" / "images" / "stray.png").write_bytes(b"x")
        (copy / "shards" / "00001" / "images" / ".000004.png.x.part").write_bytes(b"x")
        assert main(["verify", str(copy), "--full"]) == 4, name
        assert main(["repair", str(copy)]) == 0, name
        assert digests(copy) == right, name
        assert main(["verify", str(copy), "--full"]) == 0, name
        shutil.rmtree(copy)


@pytest.mark.usefixtures("small_shards")
def test_frames_of_another_environment_are_kept_apart(whole: Path, tmp_path: Path, monkeypatch) -> None:
    made, folder = study(tmp_path), tmp_path / "ds"
    assert render_study(made, folder, frames=range(2)) is None
    monkeypatch.setattr(environments, "_versions", lambda: (("roundel", "9.9"),))
    with pytest.raises(DataError, match=r"frames 0-1 were made by another environment \(\w+ .*, not none\)"):
        render_study(made, folder)
    dataset = render_study(made, folder, mix_environments=True)
    assert dataset is not None
    assert len(dataset.manifest["environments"]) == 2
    assert dataset.verify(full=True) == []
    kept = {k: v for k, v in digests(folder).items() if k.startswith("shards/00000/images")}
    assert kept == {k: v for k, v in digests(whole).items() if k.startswith("shards/00000/images")}


def test_an_unfinished_dataset_can_be_used(tmp_path: Path, capsys) -> None:
    made = study(tmp_path)
    assert render_study(made, tmp_path / "ds", frames=range(3)) is None
    with pytest.raises(DataError, match="not finished"):
        open_images(tmp_path / "ds")
    assert main(["solve", str(tmp_path / "ds"), str(tmp_path / "e")]) == 0
    assert "not finished: 9 of 11 frames are there, and are used" in capsys.readouterr().err
    assert main(["validate", str(tmp_path / "ds"), str(tmp_path / "e"), "--out", str(tmp_path / "r")]) == 0
    assert main(["verify", str(tmp_path / "ds"), "--full"]) == 0
    assert len(open_images(tmp_path / "ds")) == 9
    # More frames later: the estimates are of fewer images, which is said.
    assert render_study(made, tmp_path / "ds") is not None
    assert main(["validate", str(tmp_path / "ds"), str(tmp_path / "e"), "--out", str(tmp_path / "r")]) == 3
    assert "made from other images" in capsys.readouterr().err


def test_processes_that_render_at_the_same_time_finish_together(tmp_path: Path) -> None:
    study(tmp_path)
    render_study(tmp_path / "study.yaml", tmp_path / "alone")
    words = [sys.executable, "-m", "roundel.cli.main", "render", "study.yaml", "ds", "--threads", "1"]
    many = [subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    said = [process.communicate()[0] for process in many]
    assert [process.returncode for process in many] == [0] * 3
    assert all("11 frames" in text for text in said)
    assert digests(tmp_path / "ds") == digests(tmp_path / "alone")


def test_a_shard_that_another_finishes_between_two_looks_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The logs of whoever finishes a shard are removed: what they said is to be found in its journal.
    made = study(tmp_path)
    render_study(made, tmp_path / "alone")
    enter, first = Participant.enter, [True]

    def late(participant: Participant, shard: Shard) -> ShardProgress:
        if first:
            first.clear()
            render_study(made, tmp_path / "ds")
        return enter(participant, shard)

    monkeypatch.setattr(Participant, "enter", late)
    assert render_study(made, tmp_path / "ds") is not None
    assert digests(tmp_path / "ds") == digests(tmp_path / "alone")


def test_what_a_process_killed_at_the_very_end_leaves_is_removed(tmp_path: Path) -> None:
    made = study(tmp_path)
    render_study(made, tmp_path / "ds")
    right = digests(tmp_path / "ds")
    (tmp_path / "ds" / "log").mkdir()
    (tmp_path / "ds" / "log" / "00000000-1-1-0.jsonl").write_bytes(b'{"log":1')
    (tmp_path / "ds" / ".lock").touch()
    (tmp_path / "ds" / "images" / ".000001.png.x.part").write_bytes(b"half")
    assert render_study(made, tmp_path / "ds") is not None
    assert digests(tmp_path / "ds") == right


def test_another_study_does_not_repair(whole: Path, tmp_path: Path, capsys) -> None:
    shutil.copytree(whole, tmp_path / "ds")
    small_study(tmp_path, *TINY, ("seed: 3", "seed: 4"), name="other.yaml")
    assert main(["repair", str(tmp_path / "ds"), "--study", str(tmp_path / "other.yaml")]) == 2
    assert "is not the study of this dataset" in capsys.readouterr().err
    assert digests(tmp_path / "ds") == digests(whole)


@pytest.mark.slow
def test_several_processes_give_the_bytes_of_one(whole: Path, tmp_path: Path) -> None:
    # Processes are started fresh, with shards as large as they are by default: two of them, of points.
    edits = (*TINY[:3], ("frames: 4", "groups: {drawn: {mode: points, frames: 1100}, seen: {frames: 2}}"))
    small_study(tmp_path, *edits)
    (tmp_path / "sensor.yaml").write_text("read_noise_e: 9\nsweep: {key: sensor.full_well_e, levels: [4000, 400]}\n")

    def run(*words: str) -> None:
        command = [sys.executable, "-m", "roundel.cli.main", *words]
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)

    for jobs in ("1", "2"):
        run("render", "study.yaml", f"ds{jobs}", "--jobs", jobs)
        run("develop", f"ds{jobs}", f"dev{jobs}", "--sensor", "sensor.yaml", "--jobs", jobs)
        run("solve", f"ds{jobs}", f"e{jobs}", "--jobs", jobs)
        run("validate", f"ds{jobs}", f"e{jobs}", "--out", f"r{jobs}", "--jobs", jobs)
    for name in ("ds", "dev", "e", "r"):
        assert digests(tmp_path / f"{name}1") == digests(tmp_path / f"{name}2")
    assert len(open_dataset(tmp_path / "ds1").contents.parts) == 2
