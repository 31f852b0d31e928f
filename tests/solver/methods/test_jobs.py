"""Several processes, and runs that were stopped: the same bytes in the end."""

import multiprocessing
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from roundel.render.run import render_study
from roundel.scenes.errors import UsageError
from roundel.solver.ambiguity.normal_prior import NormalPrior
from roundel.solver.estimates import ESTIMATES
from roundel.solver.methods import solved_parts
from roundel.solver.methods.solve import solve_dataset
from roundel.solver.methods.solved_parts import PARTS

STUDY = """
schema: 1
name: points
seed: 3
camera: {width_px: 640, height_px: 480, focal_px: 640}
marker: {kind: disc, diameter_m: 0.08}
pose: {distance_D: {uniform: [5, 12]}, tilt_deg: {uniform: [5, 60]}}
groups: {all: {mode: points, frames: 150}}
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("jobs")
    (folder / "study.yaml").write_text(STUDY)
    render_study(folder / "study.yaml", folder / "dataset")
    return folder / "dataset"


@pytest.fixture(scope="module")
def expected(dataset, tmp_path_factory) -> bytes:
    out = tmp_path_factory.mktemp("expected")
    solve_dataset(dataset, out)
    return (out / ESTIMATES).read_bytes()


class Stop:
    """Progress that stops the run after some frames, as Ctrl-C does, and notes where it started."""

    def __init__(self, after: int | None) -> None:
        self.after, self.first = after, None

    def __call__(self, done: int, total: int) -> None:
        self.first = done if self.first is None else self.first
        if self.after is not None and done >= self.after:
            raise KeyboardInterrupt


def test_two_processes_give_the_bytes_of_one(dataset, expected, tmp_path):
    seen = []
    counts = solve_dataset(dataset, tmp_path, jobs=2, progress=lambda *now: seen.append(now))
    assert counts == {"frames": 150, "detections": 150, "empty_frames": 0, "failed_estimates": 0}
    assert (tmp_path / ESTIMATES).read_bytes() == expected
    assert seen[0] == (0, 150)
    assert seen[-1] == (150, 150)
    assert sorted(p.name for p in tmp_path.iterdir()) == [ESTIMATES, ESTIMATES + ".sha256", "timings.jsonl"]


def test_a_stopped_run_continues(dataset, expected, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        solve_dataset(dataset, tmp_path, progress=Stop(after=101))
    assert not (tmp_path / ESTIMATES).exists()
    # 150 frames are 75 blocks of 2: the block of frame 101 is lost.
    assert len(list((tmp_path / PARTS).iterdir())) == 50
    again = Stop(None)
    solve_dataset(dataset, tmp_path, progress=again)
    assert again.first == 100
    assert (tmp_path / ESTIMATES).read_bytes() == expected
    assert not (tmp_path / PARTS).exists()
    assert len((tmp_path / "timings.jsonl").read_text().splitlines()) == 150


def test_parts_of_other_arguments_or_damaged_ones_are_not_used(dataset, expected, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        solve_dataset(dataset, tmp_path, progress=Stop(after=101))
    other = Stop(after=0)
    with pytest.raises(KeyboardInterrupt):
        solve_dataset(dataset, tmp_path, knowledge="same_side", progress=other)
    assert other.first == 0
    damaged = min((tmp_path / PARTS).iterdir())
    damaged.write_bytes(damaged.read_bytes()[:-20])
    again = Stop(None)
    solve_dataset(dataset, tmp_path, progress=again)
    assert again.first == 98
    assert (tmp_path / ESTIMATES).read_bytes() == expected


def test_many_rows_are_several_row_groups(dataset, expected, tmp_path, monkeypatch):
    monkeypatch.setattr(solved_parts, "_ROWS", 100)
    solve_dataset(dataset, tmp_path / "out")
    file = pq.ParquetFile(tmp_path / "out" / ESTIMATES)
    assert file.num_row_groups == 3
    (tmp_path / "whole.parquet").write_bytes(expected)
    assert file.read().equals(pq.read_table(tmp_path / "whole.parquet"))


def test_a_killed_worker_is_replaced(dataset, expected, tmp_path):
    def kill(done: int, total: int) -> None:
        if done in (4, 40):
            multiprocessing.active_children()[0].kill()

    assert solve_dataset(dataset, tmp_path, jobs=2, progress=kill)["frames"] == 150
    assert (tmp_path / ESTIMATES).read_bytes() == expected


DEADLY = """
import dataclasses, os, signal
from roundel.solver.ambiguity.normal_prior import NormalPrior

@dataclasses.dataclass(frozen=True, eq=False)
class Deadly(NormalPrior):
    of: float = 0.0

    def verdict(self, observation):
        if observation.normal[0, 0] == self.of:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().verdict(observation)
"""


def test_a_frame_that_its_processes_die_of_is_set_aside(dataset, expected, tmp_path, monkeypatch):
    # Knowledge that ends the process at one normal, as a frame might for which the memory does not suffice.
    (tmp_path / "deadly.py").write_text(DEADLY)
    monkeypatch.syspath_prepend(tmp_path)
    import deadly

    before = pq.read_table(pa.BufferReader(expected)).to_pylist()
    (normal,) = [row["normal_x"] for row in before if row["frame_id"] == 7 and row["candidate"] == 0]
    counts = solve_dataset(dataset, tmp_path / "out", jobs=2, knowledge=deadly.Deadly([0.0, 0.0, -1.0], of=normal))
    assert counts["frames"] == 150
    assert counts["failed_estimates"] == 1
    after = pq.read_table(tmp_path / "out" / ESTIMATES).to_pylist()
    assert [row["frame_id"] for row in after if row["candidate"] == 0] == list(range(150))
    failed = [(row["frame_id"], row["reason"]) for row in after if row["status"] == "failed"]
    assert failed == [(7, "its process was killed twice (SIGKILL), perhaps for lack of memory")]


class Local(NormalPrior):
    """Knowledge of a class that another process cannot find, as in a notebook."""


Local.__qualname__ = "nowhere.Local"


def test_knowledge_that_cannot_be_sent(dataset, expected, tmp_path):
    knowledge = Local([0.0, 0.0, -1.0])
    with pytest.raises(UsageError, match="cannot be sent to other processes"):
        solve_dataset(dataset, tmp_path, knowledge=knowledge, jobs=2)
    assert solve_dataset(dataset, tmp_path, knowledge=knowledge)["frames"] == 150
