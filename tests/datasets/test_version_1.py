"""Datasets of layout version 1 are read: one manifest without a checksum of its own, journal lines without any."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from helpers_studies import digests, small_study

from roundel.cli.main import main
from roundel.datasets.dataset import open_dataset
from roundel.render.run import render_study
from roundel.scenes.errors import DataError

NEW = ("sha256", "groups", "complete", "images_sha256")


def as_version_1(folder: Path) -> None:
    """Rewrite a dataset of one shard as an older version would have written it."""
    lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    bare = [{k: v for k, v in line.items() if k not in ("sha256", "environment")} for line in lines]
    data = "".join(json.dumps(line, sort_keys=True, separators=(",", ":")) + "\n" for line in bare).encode()
    (folder / "journal.jsonl").write_bytes(data)
    manifest = {k: v for k, v in json.loads((folder / "manifest.json").read_text()).items() if k not in NEW}
    manifest["schema"] = 1
    manifest["files"]["journal.jsonl"] = {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
    (folder / "manifest.json").write_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n")


@pytest.fixture(scope="module")
def old(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("old")
    render_study(small_study(folder), folder / "ds")
    as_version_1(folder / "ds")
    (folder / "sensor.yaml").write_text("sensor: {full_well_e: 4000}\n")
    return folder


def test_every_command_reads_it(old: Path, tmp_path: Path, capsys) -> None:
    before = digests(old / "ds")
    dataset = open_dataset(old / "ds")
    assert len(dataset) == dataset.truth.num_rows == 4
    assert dataset.verify(full=True) == []
    for words in (
        ["solve", old / "ds", tmp_path / "e"],
        ["validate", old / "ds", tmp_path / "e", "--out", tmp_path / "r"],
        ["develop", old / "ds", tmp_path / "d", "--sensor", old / "sensor.yaml"],
        ["merge", old / "ds", tmp_path / "m"],
        ["render", old / "study.yaml", old / "ds"],
    ):
        assert main(list(map(str, words))) == 0, (words, capsys.readouterr().err)
    assert digests(old / "ds") == before
    assert open_dataset(tmp_path / "m").verify(full=True) == []


def test_damage_is_named(old: Path, tmp_path: Path, capsys) -> None:
    image = old / "ds" / "images" / "000002.png"
    whole = image.read_bytes()
    image.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    assert main(["solve", str(old / "ds"), str(tmp_path / "e")]) == 4
    assert "000002.png: its sha256 is not the recorded one" in capsys.readouterr().err
    image.write_bytes(whole)


def test_what_it_began_it_must_finish(old: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(old / "ds", tmp_path / "ds")
    (tmp_path / "ds" / "manifest.json").unlink()
    with pytest.raises(DataError, match="begun by an older version of Roundel; finish it with that version"):
        render_study(old / "study.yaml", tmp_path / "ds")
