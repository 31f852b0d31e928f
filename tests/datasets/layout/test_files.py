"""The write protocol: files appear completely or not at all."""

import os
from pathlib import Path

import numpy as np
import pytest

from roundel.datasets.layout import files, journal
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


def test_planes_are_rounded_to_what_they_are_worth(tmp_path: Path) -> None:
    from roundel.datasets.layout.radiance import encode_radiance, read_radiance, rounded

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
    path.write_bytes(encode_radiance({"Y": plane, "noise_dn": plane}))
    np.testing.assert_array_equal(read_radiance(path)["noise_dn"], rounded("noise_dn", plane))
    np.testing.assert_array_equal(read_radiance(path)["Y"], plane)
