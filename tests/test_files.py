"""The write protocol: whole or not at all."""

import os
from pathlib import Path

import pytest

from roundel.datasets import files, journal
from roundel.scenes.errors import DataError


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    target = tmp_path / "folder" / "a.bin"
    files.write_file(target, b"one")
    files.write_file(target, b"two")
    assert target.read_bytes() == b"two"
    assert list(target.parent.iterdir()) == [target]


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path, monkeypatch) -> None:
    target = tmp_path / "a.bin"
    files.write_file(target, b"old")

    def fail(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(DataError, match="the disk is full; free some space and run the same command again"):
        files.write_file(target, b"new")
    monkeypatch.undo()
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(DataError, match="cannot write"):
        files.write_file(tmp_path / "file" / "a.bin", b"x")


def test_journal_lines_are_the_same_for_the_same_entry(tmp_path: Path) -> None:
    entry = {"frame_id": 1, "files": {}, "a": 0.1}
    assert journal.line_of(entry) == journal.line_of(dict(reversed(entry.items())))
    journal.append(tmp_path, {**entry, "frame_id": 2})
    journal.append(tmp_path, entry)
    journal.rewrite(tmp_path, journal.read(tmp_path))
    assert list(journal.read(tmp_path)) == [1, 2]
