"""The write protocol: files appear completely or not at all."""

import os
from pathlib import Path

import numpy as np
import pytest

from roundel.datasets.layout import journal
from roundel.datasets.store.writing import write_file
from roundel.scenes.errors import DataError


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    target = tmp_path / "folder" / "a.bin"
    write_file(target, b"one")
    write_file(target, b"two")
    assert target.read_bytes() == b"two"
    assert list(target.parent.iterdir()) == [target]


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path, monkeypatch) -> None:
    target = tmp_path / "a.bin"
    write_file(target, b"old")

    def fail(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(DataError, match="the disk is full; free some space and run the same command again"):
        write_file(target, b"new")
    monkeypatch.undo()
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(DataError, match="cannot write"):
        write_file(tmp_path / "file" / "a.bin", b"x")


def entry(frame_id: int) -> journal.Entry:
    return {"frame_id": frame_id, "group": "main", "files": {}, "photometry": {}, "fidelity": {}, "exposure_e": 0.1}


def test_the_journal_is_the_same_whatever_the_order() -> None:
    data = journal.journal_bytes([entry(2), entry(1)])
    assert data == journal.journal_bytes([dict(reversed(entry(1).items())), entry(2)])
    assert journal.entries_of(data, "x") == ({1: entry(1), 2: entry(2)}, 0)


def test_a_damaged_line_of_the_journal_is_left_out() -> None:
    data = journal.journal_bytes([entry(1), entry(2), entry(3)])
    # But for the end of the last line, without which all are whole.
    for at in range(len(data) - 1):
        for changed in (data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :], data[:at] + data[at + 1 :]):
            entries, damaged = journal.entries_of(changed, "x")
            assert damaged in (1, 2)
            assert all(found == entry(i) for i, found in entries.items())
            assert len(entries) + damaged in (3, 2)


def test_a_journal_names_no_file_outside_its_frame() -> None:
    listed = {"sha256": "0" * 64, "bytes": 1}
    for name in ("../secret.png", "/etc/passwd", "images/000002.png", "images/../000001.png"):
        data = journal.journal_bytes([{**entry(1), "files": {name: listed}}])
        with pytest.raises(DataError, match="no file of frame 1"):
            journal.entries_of(data, "journal.jsonl")


def test_planes_are_rounded_to_what_they_are_worth(tmp_path: Path) -> None:
    from roundel.datasets.layout.radiance import encode_planes, read_radiance, rounded

    random = np.random.default_rng(3)
    plane = np.exp(random.uniform(-20, 5, (40, 50))).astype(np.float32)
    plane[0, :3] = [0.0, 1.0, np.nextafter(np.float32(2), np.float32(0))]
    for channel, digits in (("Y", 24), ("Y.variance", 8), ("noise_dn", 12), ("Z", 17)):
        stored = rounded(channel, plane)
        # To the nearest of 2^digits values between two powers of two.
        assert np.abs(stored / np.where(plane == 0, 1, plane) - (plane != 0)).max() <= 2.0**-digits
        assert stored[0, 0] == 0
        assert stored[0, 1] == 1
        np.testing.assert_array_equal(rounded(channel, stored), stored)
    path = tmp_path / "x.exr"
    path.write_bytes(encode_planes({"Y": plane, "noise_dn": plane}))
    np.testing.assert_array_equal(read_radiance(path)["noise_dn"], rounded("noise_dn", plane))
    np.testing.assert_array_equal(read_radiance(path)["Y"], plane)
