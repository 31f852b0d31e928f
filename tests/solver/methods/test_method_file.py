"""`--method file.py:function`: named, refused in one line, in several processes, and after a run that was stopped."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from helpers_reports import make_dataset

from roundel.cli.main import main
from roundel.datasets.dataset import Dataset
from roundel.scenes.errors import UsageError
from roundel.solver.estimates import ESTIMATES
from roundel.solver.methods.locate import locate
from roundel.solver.methods.method_file import MethodFile
from roundel.solver.methods.registry import load_methods
from roundel.solver.methods.solve import solve_dataset
from roundel.solver.methods.solved_parts import PARTS

STUDY = """\
schema: 1
name: own
seed: 3
camera: {width_px: 320, height_px: 240, focal_px: 400}
marker: {kind: disc, diameter_m: 0.08}
pose:
  distance_D: {uniform: [4, 6]}
  tilt_deg: {uniform: [20, 45]}
  azimuth_deg: {uniform: [-180, 180]}
frames: 6
"""
SOURCE = """\
from neighbour import SHAPE
from roundel.solver.methods.plugin import Found

def find(view):
    return [Found(ellipse=SHAPE, confidence=0.5)]

def other(view):
    return [Found(centre_px=(1, 2))]

def number(view):
    return 3

CONSTANT = 3
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Dataset:
    return make_dataset(tmp_path_factory.mktemp("files") / "ds", STUDY)


@pytest.fixture
def mine(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "neighbour.py").write_text("SHAPE = [160, 120, 40, 30, 0]\n")
    (folder / "blobber.py").write_text(SOURCE)
    monkeypatch.setattr("sys.path", list(sys.path))
    yield folder / "blobber.py"
    sys.modules.pop("neighbour", None)


def methods_of(folder: Path) -> set[str]:
    return set(pq.read_table(folder / ESTIMATES)["method"].to_pylist())


def test_a_function_is_called_by_its_name_and_find_by_its_file(mine):
    assert list(load_methods([f"{mine}:other", f"{mine}:find", "pixels"])) == ["other", "blobber", "pixels"]
    assert list(load_methods([str(mine)])) == ["blobber"]
    assert MethodFile.of("pixels") is None
    assert MethodFile.of("my_package.my_module:find") is None


def test_one_line_solves_and_scores(dataset, mine, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(mine.parent)
    asked = ["--method", "blobber.py:find", "--method", "blobber.py:number"]
    assert main(["solve", str(dataset.path), str(tmp_path / "est"), *asked]) == 0
    (said,) = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
    assert said == (
        "roundel: warning: method number failed in 6 of the frames; first in frame 0: it returned int, not a list of "
        "Found"
    )
    assert methods_of(tmp_path / "est") == {"blobber", "number"}
    assert main(["validate", str(dataset.path), str(tmp_path / "est"), "--out", str(tmp_path / "report")]) == 0
    assert "blobber" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ("absent.py:find", "absent.py cannot be read: No such file or directory"),
        ("blobber.py:otter", "has no function 'otter'; did you mean other?"),
        ("blobber.py:CONSTANT", "'CONSTANT' is not callable"),
        ("broken.py", "cannot be imported: ModuleNotFoundError: No module named 'no_such_module'"),
        ("wrong.py", "cannot be imported: SyntaxError"),
        ("pixels.py", "would be called 'pixels', and that is an installed method; rename"),
    ],
)
def test_what_cannot_be_loaded_is_one_line(dataset, mine, tmp_path, monkeypatch, capsys, asked, sentence):
    monkeypatch.chdir(mine.parent)
    Path("broken.py").write_text("import no_such_module\n")
    Path("wrong.py").write_text("def find(view:\n")
    Path("pixels.py").write_text(SOURCE)
    assert main(["solve", str(dataset.path), str(tmp_path / "est"), "--method", asked]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1


def test_run_refuses_a_method_before_it_renders(tmp_path, capsys):
    study = tmp_path / "study.yaml"
    study.write_text(STUDY)
    assert main(["run", str(study), str(tmp_path / "out"), "--method", str(tmp_path / "absent.py")]) == 2
    assert "absent.py cannot be read" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_two_methods_of_one_name_are_refused(mine):
    again = mine.with_name("again")
    again.mkdir()
    (again / "blobber.py").write_text(SOURCE)
    with pytest.raises(UsageError, match=r"would be called 'blobber', and .*blobber.py:find is, too"):
        load_methods([str(mine), str(again / "blobber.py")])


def test_several_processes_give_the_same_bytes(dataset, mine, tmp_path, monkeypatch):
    monkeypatch.chdir(mine.parent)
    solve_dataset(dataset.path, tmp_path / "one", methods=["blobber.py", "blobber.py:other"])
    solve_dataset(dataset.path, tmp_path / "two", methods=["blobber.py", "blobber.py:other"], jobs=2)
    assert (tmp_path / "one" / ESTIMATES).read_bytes() == (tmp_path / "two" / ESTIMATES).read_bytes()


def test_a_stopped_run_continues_and_a_changed_file_starts_again(dataset, mine, tmp_path):
    def stopped_and_continued() -> Iterator[int | None]:
        seen: list[int] = []

        def stop(done: int, total: int) -> None:
            if done >= 4:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            solve_dataset(dataset.path, tmp_path / "est", methods=[str(mine)], progress=stop)
        assert len(list((tmp_path / "est" / PARTS).iterdir())) >= 4
        yield None
        solve_dataset(
            dataset.path, tmp_path / "est", methods=[str(mine)], progress=lambda done, total: seen.append(done)
        )
        yield seen[0]

    run = stopped_and_continued()
    next(run)
    assert next(run) == 4
    run = stopped_and_continued()
    next(run)
    mine.write_text(SOURCE.replace("0.5", "0.25"))
    assert next(run) == 0
    assert set(pq.read_table(tmp_path / "est" / ESTIMATES)["confidence"].to_pylist()) == {0.25}
    # So do weights beside it.
    run = stopped_and_continued()
    next(run)
    (mine.parent / "weights.bin").write_bytes(os.urandom(8))
    assert next(run) == 0


def test_an_image_is_searched_by_a_file_too(dataset, mine):
    image = dataset.images.image(0)
    (found,) = locate(image, 0.08, dataset.images.camera(0), method=f"{mine}:find")
    assert found.method == "blobber"
    mine.write_text("def find(view):\n    return []\n")
    assert locate(image, 0.08, dataset.images.camera(0), method=str(mine)) == []
