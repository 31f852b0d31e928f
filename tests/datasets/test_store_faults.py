"""An object store that fails one request in twenty: nothing is wrong, nothing falsely done, and all of it ends."""

from __future__ import annotations

import contextlib
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers_s3 import BUCKET, Faults, faulty_proxy, s3_server, settings, use_s3
from helpers_studies import digests, small_study

from roundel.cli.main import main
from roundel.datasets.layout import shards
from roundel.datasets.store.bucket import client_of
from roundel.datasets.store.writing import sha256

TINY = (
    ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 64, height_px: 48, focal_px: 128"),
    ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: {uniform: [-5, 5]}"),
    ("band_samples: 256", "band_samples: 16"),
    ("frames: 4", "groups: {seen: {frames: 5}, drawn: {mode: points, frames: 6}}"),
)
RUNS = {"render": 70, "solve": 50, "verify": 30, "develop": 30, "merge": 20}


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """A server of S3."""
    with s3_server() as address:
        yield address


@pytest.fixture(autouse=True)
def small_shards(monkeypatch) -> None:
    """Shards of four frames."""
    monkeypatch.setattr(shards, "SHARD_FRAMES", 4)


@contextlib.contextmanager
def using(address: str) -> Iterator[None]:
    """This process uses a server in this block."""
    with pytest.MonkeyPatch.context() as patch:
        use_s3(patch, address)
        yield
    client_of.cache_clear()


def objects(address: str) -> dict[str, str]:
    """sha256 of every object but the timings."""
    client = client_of(address)
    names = [found["path"] for page in client.list() for found in page]
    return {n: sha256(bytes(client.get(n).bytes())) for n in sorted(names) if not n.endswith("timings.jsonl")}


@pytest.fixture(scope="module")
def made(server: str, tmp_path_factory) -> Path:
    """What the commands should give, on disk; the inputs of those that need some are also in the store."""
    folder = tmp_path_factory.mktemp("made")
    study = str(folder / "study.yaml")
    small_study(folder, *TINY)
    (folder / "sensor.yaml").write_text("sensor: {full_well_e: 4000}\n")
    with pytest.MonkeyPatch.context() as patch, using(server):
        patch.setattr(shards, "SHARD_FRAMES", 4)
        for out in (folder / "ds", f"s3://{BUCKET}/ds"):
            assert main(["render", study, str(out)]) == 0
        for i in (1, 2):
            assert main(["render", study, f"s3://{BUCKET}/part{i}", "--slice", f"{i}/2"]) == 0
        assert main(["develop", str(folder / "ds"), str(folder / "dev"), "--sensor", str(folder / "sensor.yaml")]) == 0
        assert main(["solve", str(folder / "ds"), str(folder / "estimates")]) == 0
    return folder


def words(command: str, made: Path, out: str) -> list[str]:
    ds = f"s3://{BUCKET}/ds"
    return {
        "render": ["render", str(made / "study.yaml"), out],
        "solve": ["solve", ds, out],
        "verify": ["verify", ds, "--full"],
        "develop": ["develop", ds, out, "--sensor", str(made / "sensor.yaml")],
        "merge": ["merge", f"s3://{BUCKET}/part1", f"s3://{BUCKET}/part2", out],
    }[command]


def check(command: str, server: str, made: Path, out: str) -> None:
    """What a command has left is what it leaves without faults."""
    if command == "solve":
        assert digests(Path(out)) == digests(made / "estimates")
    elif command != "verify":
        with using(server):
            assert objects(out) == digests(made / ("dev" if command == "develop" else "ds"))


@pytest.mark.slow
@pytest.mark.parametrize("command", RUNS)
def test_one_request_in_twenty_fails(command: str, server: str, made: Path, tmp_path: Path, capsys) -> None:
    counts: dict[str, int] = {}
    for run in range(RUNS[command]):
        out = str(tmp_path / str(run)) if command == "solve" else f"s3://{BUCKET}/{command}-{run}"
        faults = Faults(20, seed=run)
        with faulty_proxy(server, faults) as proxy, using(proxy):
            # Requests are repeated: not one command should fail.
            assert main(words(command, made, out)) == 0, capsys.readouterr().err
        check(command, server, made, out)
        for kind, number in faults.counts.items():
            counts[kind] = counts.get(kind, 0) + number
    assert set(counts) == {"", *Faults(20).kinds}


@pytest.mark.slow
@pytest.mark.parametrize("command", RUNS)
def test_what_a_store_says_wrongly_is_never_believed(
    command: str, server: str, made: Path, tmp_path: Path, capsys
) -> None:
    """One answer in ten is half of what it should be, and says that it is whole."""
    for run in range(8):
        out = str(tmp_path / str(run)) if command == "solve" else f"s3://{BUCKET}/{command}-lie-{run}"
        with faulty_proxy(server, Faults(10, seed=run, kinds=("lie",))) as proxy, using(proxy):
            code = main(words(command, made, out))
        said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("roundel: ")]
        assert code in (0, 4), said
        assert len([line for line in said if not line.startswith("roundel: warning: ")]) == bool(code), said
        if command != "verify":
            # Whether it ended with an error or not: the same command once more finds nothing wrong, and ends it.
            with using(server):
                assert main(words(command, made, out)) == 0, capsys.readouterr().err
        check(command, server, made, out)


@pytest.mark.slow
def test_a_store_that_hardly_answers(server: str, made: Path, capsys) -> None:
    """Nine requests in ten fail: the command ends with one line, and goes on once the store is well."""
    draw = random.Random(1)
    for run in range(10):
        out = f"s3://{BUCKET}/hardly-{run}"
        faults = Faults(1, seed=run, kinds=("drop",))
        faults.every = draw.choice((1, 1, 2))
        with faulty_proxy(server, faults) as proxy, using(proxy):
            code = main(words("render", made, out))
        said = capsys.readouterr().err
        assert code in (0, 4)
        assert "Traceback" not in said
        with using(server):
            assert main(words("render", made, out)) == 0
        check("render", server, made, out)


@pytest.mark.slow
def test_killed_at_random_moments(server: str, tmp_path: Path) -> None:
    small_study(tmp_path, *TINY[:2], ("band_samples: 256", "band_samples: 64"), ("frames: 4", "frames: 40"))
    environment = {**os.environ, **settings(server)}

    def render(out: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "roundel.cli.main", "render", str(tmp_path / "study.yaml"), out]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment)

    first = render(str(tmp_path / "ds"))
    assert (first.communicate()[1].count("roundel:"), first.returncode) == (0, 0)
    chance = random.Random(5)
    for run in range(20):
        out = f"s3://{BUCKET}/killed-{run}"
        for _ in range(2):
            process = render(out)
            time.sleep(chance.uniform(1.0, 5.0))
            process.kill()
            process.communicate()
        process = render(out)
        assert (process.communicate()[1].count("roundel:"), process.returncode) == (0, 0)
        with using(server):
            assert objects(out) == digests(tmp_path / "ds")
