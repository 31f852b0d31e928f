"""Datasets in an object store: a server of S3 on this machine, and a web server that is only read."""

from __future__ import annotations

import functools
import http.server
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers_s3 import BUCKET, free_port, s3_server, settings, use_s3
from helpers_studies import digests, small_study

from roundel.cli.main import main
from roundel.datasets.dataset import open_dataset
from roundel.datasets.layout import shards
from roundel.datasets.store.addresses import store_at
from roundel.datasets.store.bucket import Bucket, client_of
from roundel.datasets.store.log import Logs, OwnLog
from roundel.datasets.store.owner import own_name
from roundel.datasets.store.records import line_of
from roundel.datasets.store.store import Listed, MissingFile
from roundel.datasets.store.writing import sha256
from roundel.render.run import render_study
from roundel.scenes.errors import DataError, UsageError

TINY = (
    ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 64, height_px: 48, focal_px: 128"),
    ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: {uniform: [-5, 5]}"),
    ("band_samples: 256", "band_samples: 16"),
    ("frames: 4", "groups: {seen: {frames: 5}, drawn: {mode: points, frames: 6}}"),
)


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """A server of S3, which this process and those that it starts use."""
    with s3_server() as address, pytest.MonkeyPatch.context() as patch:
        use_s3(patch, address)
        yield address


@pytest.fixture(autouse=True)
def small_shards(monkeypatch) -> None:
    """Shards of four frames."""
    monkeypatch.setattr(shards, "SHARD_FRAMES", 4)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """A dataset of three shards on disk, with its study."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shards, "SHARD_FRAMES", 4)
        render_study(small_study(folder, *TINY), folder / "ds")
    return folder


@pytest.fixture(scope="module")
def remote(server: str, whole: Path) -> str:
    """The same dataset in the store, which no test changes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shards, "SHARD_FRAMES", 4)
        render_study(whole / "study.yaml", f"s3://{BUCKET}/whole")
    return f"s3://{BUCKET}/whole"


def objects(address: str) -> dict[str, str]:
    """sha256 of every object but the timings."""
    client = client_of(address)
    names = [found["path"] for page in client.list() for found in page]
    return {n: sha256(bytes(client.get(n).bytes())) for n in sorted(names) if not n.endswith("timings.jsonl")}


def copied(folder: Path, address: str) -> None:
    """A dataset on disk, put into the store file by file."""
    for path in folder.rglob("*"):
        if path.is_file():
            client_of(address).put(str(path.relative_to(folder)), path.read_bytes())


def run(*words: object, environment: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "roundel.cli.main", *map(str, words)]
    return subprocess.run(command, check=False, capture_output=True, text=True, env=environment)


def test_the_store_has_the_bytes_of_the_disk(whole: Path, remote: str) -> None:
    assert objects(remote) == digests(whole / "ds")
    dataset = open_dataset(remote)
    assert (dataset.address, len(dataset), dataset.verify(full=True)) == (remote, 11, [])
    assert dataset.images.image(4).shape == (48, 64)
    with pytest.raises(DataError, match="is not on a disk; `roundel pull` copies it there"):
        _ = dataset.path


def test_it_is_solved_and_validated_where_it_is(whole: Path, remote: str, tmp_path: Path) -> None:
    for name, address in (("here", whole / "ds"), ("there", remote)):
        assert main(["solve", str(address), str(tmp_path / name)]) == 0
        assert main(["validate", str(address), str(tmp_path / name), "--out", str(tmp_path / f"{name}-report")]) == 0
    assert digests(tmp_path / "here") == digests(tmp_path / "there")
    assert digests(tmp_path / "here-report") == digests(tmp_path / "there-report")


def test_parts_are_continued_developed_and_merged(server: str, whole: Path, tmp_path: Path) -> None:
    study = whole / "study.yaml"
    assert render_study(study, f"s3://{BUCKET}/parts", frames=range(3)) is None
    assert render_study(study, f"s3://{BUCKET}/parts", frames=range(2, 11)) is not None
    assert objects(f"s3://{BUCKET}/parts") == digests(whole / "ds")
    for i in (1, 2):
        render_study(study, f"s3://{BUCKET}/half{i}", frames=range(6 * i - 6, 6 * i))
    assert main(["merge", f"s3://{BUCKET}/half1", f"s3://{BUCKET}/half2", f"s3://{BUCKET}/merged"]) == 0
    assert objects(f"s3://{BUCKET}/merged") == digests(whole / "ds")
    sensor = tmp_path / "sensor.yaml"
    sensor.write_text("sensor: {full_well_e: 4000}\n")
    for source, out in ((str(whole / "ds"), tmp_path / "dev"), (f"s3://{BUCKET}/parts", f"s3://{BUCKET}/dev")):
        assert main(["develop", source, str(out), "--sensor", str(sensor)]) == 0
    assert objects(f"s3://{BUCKET}/dev") == digests(tmp_path / "dev")


def test_several_processes_render_into_it(server: str, whole: Path) -> None:
    address = f"s3://{BUCKET}/many"
    program = "import sys; from roundel.datasets.layout import shards; shards.SHARD_FRAMES = 4; "
    program += "from roundel.render.run import render_study; render_study(sys.argv[1], sys.argv[2])"
    command = [sys.executable, "-c", program, str(whole / "study.yaml"), address]
    many = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    assert [(process.communicate()[1], process.returncode) for process in many] == [("", 0)] * 3
    assert objects(address) == digests(whole / "ds")


def test_damage_is_found_and_repaired(server: str, whole: Path, capsys: pytest.CaptureFixture[str]) -> None:
    address = f"s3://{BUCKET}/damaged"
    copied(whole / "ds", address)
    client = client_of(address)
    image = bytes(client.get("shards/00000/images/000002.png").bytes())
    client.put("shards/00000/images/000002.png", image[:-1] + b"?")
    client.delete("shards/00002/truth.parquet")
    client.put("shards/00001/images/stray.png", b"stray")
    assert main(["verify", address, "--full"]) == 4
    said = capsys.readouterr().out
    for name in ("00000/images/000002.png", "00002/truth.parquet", "00001/images/stray.png"):
        assert name in said
    with pytest.raises(DataError, match="sha256 is not the recorded one"):
        open_dataset(address).images.image(2)
    client.put("shards/00000/images/000002.png", image[:-1])  # by its size
    assert main(["repair", address]) == 0
    assert objects(address) == digests(whole / "ds")


def test_another_study_is_not_mixed_in(server: str, remote: str, tmp_path: Path) -> None:
    other = small_study(tmp_path, *TINY, ("seed: 3", "seed: 4"))
    with pytest.raises(UsageError, match="holds frames of another study"):
        render_study(other, remote)
    client_of(f"s3://{BUCKET}/else").put("readme.txt", b"mine")
    with pytest.raises(UsageError, match="is not empty and not a dataset"):
        render_study(other, f"s3://{BUCKET}/else")


def test_objects_are_read_written_and_removed(server: str) -> None:
    store = store_at(f"s3://{BUCKET}/calls")
    assert store.absence() == "there is nothing at this address"
    assert not store.is_occupied()
    assert store.write_new("a/b.txt", b"data")
    assert store.write_new("a/b.txt", b"data")
    assert not store.write_new("a/b.txt", b"other")
    assert store.read("a/b.txt") == b"data"
    assert (store.size("a/b.txt"), store.size("nothing")) == (4, None)
    assert (store.names(), store.names("a"), store.sizes("a"), store.sizes()) == (["a"], ["b.txt"], {"b.txt": 4}, {})
    assert store.sub("a").read_checked("b.txt", Listed(4, sha256(b"data")), "") == b"data"
    with pytest.raises(DataError, match="more than this file may have"):
        store.read("a/b.txt", most=3)
    for name in ("../a", "a//b", "", "/a"):
        with pytest.raises(DataError, match="is not the name of a file"):
            store.read(name)
    store.remove("a/b.txt", "nothing")
    with pytest.raises(MissingFile, match=f"s3://{BUCKET}/calls/a/b.txt: is missing"):
        store.read("a/b.txt")


def test_logs_are_objects(server: str) -> None:
    folder = store_at(f"s3://{BUCKET}/logs")
    own, logs = OwnLog(folder, {"who": "me"}), Logs(folder)
    for n in range(3):
        own.append({"n": n})
        assert [record["n"] for _, _, record in logs.new_records()] == [n]
    assert logs.is_live(own.name)
    own.close()
    assert not logs.is_live(own.name)
    logs.remove_gone()
    assert folder.names("log") == []


def test_a_process_of_another_host_is_waited_for_some_time(server: str) -> None:
    folder = store_at(f"s3://{BUCKET}/elsewhere")
    machine, pid, started = own_name().split("-")
    name = f"{'0' * 8 if machine != '0' * 8 else '1' * 8}-{pid}-{started}-0"
    folder.write(f"log/{name}.000000.jsonl", f"{line_of({'log': 1})}\n{line_of({'n': 1})}\n".encode())
    logs = Logs(folder)
    assert [record["n"] for _, _, record in logs.new_records()] == [1]
    assert logs.is_live(name)
    assert not logs.is_live(name, lease_s=0.0)
    # Its log is needed no more, and whether it still works cannot be known.
    logs.remove_gone()
    assert folder.names("log") == []


@pytest.fixture(scope="module")
def web(whole: Path) -> Iterator[str]:
    """A web server with the dataset."""
    quiet = type("Quiet", (http.server.SimpleHTTPRequestHandler,), {"log_message": lambda *_: None})
    handler = functools.partial(quiet, directory=str(whole))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as one:
        threading.Thread(target=one.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{one.server_port}/ds"
        one.shutdown()


def test_a_web_server_is_read(whole: Path, web: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", web, "--full"]) == 0
    assert "all checksums match" in capsys.readouterr().out
    for name, address in (("here", str(whole / "ds")), ("there", web)):
        assert main(["solve", address, str(tmp_path / name)]) == 0
    assert digests(tmp_path / "here") == digests(tmp_path / "there")
    assert main(["render", str(whole / "study.yaml"), f"{web}2"]) == 2
    assert "a web server can only be read" in capsys.readouterr().err
    assert main(["verify", f"{web}2"]) == 4
    assert "is missing" in capsys.readouterr().err


def lines(said: str) -> list[str]:
    return [line for line in said.splitlines() if line]


def test_what_the_store_refuses_is_one_line(server: str, remote: str, whole: Path) -> None:
    import os

    mine = dict(os.environ)
    study = whole / "study.yaml"
    closed = settings(f"http://127.0.0.1:{free_port()}")
    without = {name: value for name, value in mine.items() if "KEY" not in name}
    for words, environment, code, part in (
        (("verify", "s3://nothere/x"), mine, 4, "there is no such bucket"),
        (("verify", f"s3://{BUCKET}/nothing"), mine, 4, "there is nothing at this address"),
        (("render", study, "nfs4://x/y"), mine, 2, "no store is known for nfs4://"),
        (("render", study, f"s3://me:secret@{BUCKET}/x"), mine, 2, "leave credentials"),
        (("render", study, f"s3://{BUCKET}/x"), mine | closed, 4, "connection refused"),
        (("verify", remote), without, 4, "no credentials were found"),
    ):
        done = run(*words, environment=environment)
        assert (done.returncode, len(lines(done.stderr))) == (code, 1), done.stderr
        assert part in done.stderr
        assert "secret" not in done.stderr


def test_what_fsspec_knows_is_a_store(whole: Path, tmp_path: Path) -> None:
    address = "memory://datasets/whole"
    assert render_study(whole / "study.yaml", address) is not None
    store = store_at(address)
    assert store.names() == ["manifest.json", "shards", "study.yaml"]
    assert not store.write_new("study.yaml", b"other")
    assert open_dataset(address).verify(full=True) == []
    assert main(["pull", address, str(tmp_path / "ds")]) == 0
    assert digests(tmp_path / "ds") == digests(whole / "ds")
    store.remove("shards/00000/images/000001.png")
    with pytest.raises(DataError, match=r"memory://datasets/whole/shards/00000/images/000001.png: is missing"):
        open_dataset(address).images.image(1)


def test_a_container_of_azure_is_no_credential(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_KEY", "c2VjcmV0")
    assert str(Bucket.at("abfss://container@account.dfs.core.windows.net/name")).endswith("/name")
    with pytest.raises(UsageError, match="leave credentials"):
        Bucket.at("abfss://container:secret@account.dfs.core.windows.net/name")


def test_the_package_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "obstore.store", None)
    monkeypatch.setitem(sys.modules, "obstore", None)
    client_of.cache_clear()
    with pytest.raises(UsageError, match=r"pip install 'roundel\[cloud\]'"):
        Bucket.at("s3://bucket/x")


def test_a_link_takes_a_file_of_a_folder_and_a_copy_one_of_a_store(server: str, tmp_path: Path) -> None:
    here, there = store_at(tmp_path / "a"), store_at(f"s3://{BUCKET}/take")
    there.write("file", b"data")
    here.take("copied", there, "file")
    here.take("linked", here, "copied")
    there.take("back", here, "linked")
    assert there.read("back") == here.read("linked") == b"data"
    assert (tmp_path / "a" / "linked").stat().st_nlink == 2
    shutil.rmtree(tmp_path / "a")


def test_pull_fetches_all_or_some(whole: Path, remote: str, web: str, tmp_path: Path, capsys) -> None:
    for name, address in (("s3", remote), ("web", web), ("folder", str(whole / "ds"))):
        out = tmp_path / name
        assert main(["pull", address, str(out), "--frames", "1:3"]) == 0
        part = open_dataset(out)
        assert (part.images.frame_ids, part.images.complete, part.verify(full=True)) == ([1, 2], False, [])
        assert sorted(p.name for p in (out / "shards" / "00000" / "images").iterdir()) == ["000001.png", "000002.png"]
        assert part.truth.equals(open_dataset(whole / "ds").truth.slice(1, 2))
        # Those of another shard, and of points, come beside them.
        assert main(["pull", address, str(out), "--frames", "9:10"]) == 0
        part = open_dataset(out)
        assert (part.images.frame_ids, part.manifest["counts"]["frames"]) == ([1, 2, 9], 3)
        assert set(part.images.points(2)) == {0}
        assert main(["verify", str(out), "--full"]) == 0
        assert main(["solve", str(out), str(tmp_path / f"{name}-estimates")]) == 0
        assert "not finished: some frames are missing" in capsys.readouterr().err
        assert main(["pull", address, str(out)]) == 0
        assert digests(out) == digests(whole / "ds")
        assert "the whole dataset" in capsys.readouterr().out
        assert main(["pull", address, str(out)]) == 0
        assert " 0 files of frames fetched" in capsys.readouterr().out


def test_a_pulled_part_is_completed_by_rendering(whole: Path, web: str, tmp_path: Path) -> None:
    assert main(["pull", web, str(tmp_path / "ds"), "--frames", "2:6"]) == 0
    assert render_study(whole / "study.yaml", tmp_path / "ds") is not None
    assert digests(tmp_path / "ds") == digests(whole / "ds")


def test_a_pull_that_was_interrupted_goes_on(whole: Path, remote: str, tmp_path: Path) -> None:
    out = tmp_path / "ds"
    assert main(["pull", remote, str(out)]) == 0
    for name in ("manifest.json", "shards/00001/shard.json", "shards/00000/images/000001.png"):
        (out / name).unlink()
    (out / "shards/00000/images/000002.png").write_bytes(b"half")
    (out / "shards/00000/images/stray.png").write_bytes(b"stray")
    assert main(["pull", remote, str(out)]) == 0
    assert digests(out) == digests(whole / "ds")


def test_what_cannot_be_pulled_is_said(server: str, whole: Path, web: str, tmp_path: Path, capsys) -> None:
    def said(*words: object) -> tuple[int, str]:
        code = main([str(word) for word in words])
        return code, capsys.readouterr().err

    small_study(tmp_path, *TINY, ("seed: 3", "seed: 4"))
    render_study(tmp_path / "study.yaml", tmp_path / "other")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    ds = whole / "ds"
    for words, code, part in (
        ((web, tmp_path / "x", "--frames", "50:60"), 2, "the dataset has no such frame"),
        ((ds, ds), 2, "is the dataset itself"),
        ((ds, tmp_path / "other"), 3, "holds another dataset"),
        ((ds, tmp_path / "mine"), 2, "is not empty and not a dataset"),
        ((tmp_path / "nothing", tmp_path / "y"), 4, "there is no such folder"),
        ((f"{web}2", tmp_path / "z"), 4, "is missing"),
    ):
        found, line = said("pull", *words)
        assert (found, part in line) == (code, True), line
        assert line.count("\n") == 1
    assert not (tmp_path / "x").exists()
    copied(ds, f"s3://{BUCKET}/cut")
    client_of(f"s3://{BUCKET}/cut").put("shards/00000/images/000000.png", b"other")
    code, line = said("pull", f"s3://{BUCKET}/cut", tmp_path / "cut")
    assert (code, "000000.png: 5 bytes, but" in line) == (4, True)
