"""A Dask cluster on loopback: the same bytes, whichever of its processes is killed; one line where it cannot work."""

from __future__ import annotations

import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from helpers_studies import digests, small_study

from roundel.datasets.cluster import ClusterPool
from roundel.scenes.errors import BackendError

TINY = (
    ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 64, height_px: 48, focal_px: 128"),
    ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: {uniform: [-5, 5]}"),
    ("band_samples: 256", "band_samples: 64"),
    ("frames: 4", "frames: 60"),
)
DASK = [sys.executable, "-m", "distributed.cli"]
KILLS = 20  # of each kind of process


def free_port() -> int:
    with socket.socket() as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


def started(*words: str) -> subprocess.Popen[bytes]:
    code = f"from distributed.cli.dask_{words[0]} import main; main()"
    command = [sys.executable, "-c", code, *words[1:], "--no-dashboard"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


def ended(*processes: subprocess.Popen[bytes]) -> None:
    for process in processes:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@contextmanager
def cluster(workers: int) -> Iterator[tuple[str, subprocess.Popen[bytes], subprocess.Popen[bytes]]]:
    """A scheduler and workers: the address, and the processes of both."""
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    scheduler = started("scheduler", "--host", "127.0.0.1", "--port", str(port))
    worker = started("worker", address, "--nthreads", "1", "--nworkers", str(workers), "--death-timeout", "20")
    try:
        yield address, scheduler, worker
    finally:
        ended(worker, scheduler)


def roundel(folder: Path, *words: object) -> list[str]:
    return [sys.executable, "-m", "roundel.cli.main", *map(str, words)]


def render(folder: Path, *words: object) -> list[str]:
    return roundel(folder, "render", "study.yaml", "ds", *words)


def children(pid: int) -> list[int]:
    """Processes of a group that may be killed: the workers, not their nanny."""
    listed = subprocess.run(["ps", "-eo", "pid,pgid,args"], check=True, capture_output=True, text=True).stdout
    rows = [line.split(None, 2) for line in listed.splitlines()[1:]]
    return [int(row[0]) for row in rows if row[1] == str(pid) and "spawn_main" in row[2]]


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("alone")
    small_study(folder, *TINY)
    subprocess.run(render(folder), cwd=folder, check=True, capture_output=True)
    subprocess.run(roundel(folder, "solve", "ds", "e"), cwd=folder, check=True, capture_output=True)
    return folder


def test_a_scheduler_that_is_not_there_is_one_line(monkeypatch) -> None:
    monkeypatch.setattr("roundel.datasets.cluster._CONNECT_S", 1)
    with pytest.raises(BackendError, match=r"no Dask scheduler answers there .*; start one with `dask scheduler`$"):
        ClusterPool(f"tcp://127.0.0.1:{free_port()}", print, print, ())


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2, 4])
def test_a_cluster_gives_the_bytes_of_one_process(alone: Path, tmp_path: Path, workers: int) -> None:
    shutil.copy(alone / "study.yaml", tmp_path)
    with cluster(workers) as (address, _, _):
        subprocess.run(render(tmp_path, "--scheduler", address), cwd=tmp_path, check=True, capture_output=True)
        assert digests(tmp_path / "ds") == digests(alone / "ds")
        words = roundel(tmp_path, "solve", "ds", "e", "--scheduler", address)
        subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)
        assert digests(tmp_path / "e") == digests(alone / "e")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["worker", "scheduler", "client"])
def test_killed_at_random_moments(alone: Path, tmp_path: Path, kind: str) -> None:
    chance = random.Random(kind)
    shutil.copy(alone / "study.yaml", tmp_path)
    right = digests(alone / "ds")
    for _ in range(KILLS):
        shutil.rmtree(tmp_path / "ds", ignore_errors=True)
        with cluster(2) as (address, scheduler, worker):
            words = render(tmp_path, "--scheduler", address)
            client = subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            time.sleep(chance.uniform(3.0, 9.0))
            if kind == "worker":
                for pid in children(worker.pid)[:1]:
                    os.kill(pid, signal.SIGKILL)
            else:
                os.kill({"scheduler": scheduler, "client": client}[kind].pid, signal.SIGKILL)
            _, said = client.communicate(timeout=120)
            if kind == "worker":
                assert client.returncode == 0, said
            elif client.returncode not in (0, -signal.SIGKILL):
                last = said.strip().splitlines()[-1]
                assert client.returncode == 4, said
                assert "run the command again" in last or "no Dask scheduler" in last or "no workers" in last, said
        # Nothing is falsely done: one process completes it, and every byte is right.
        subprocess.run(render(tmp_path), cwd=tmp_path, check=True, capture_output=True)
        assert digests(tmp_path / "ds") == right
