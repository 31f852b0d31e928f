"""What may be read of a folder: regular files of bounded size below it; and how files are written."""

import os
from pathlib import Path

import pytest

from roundel.datasets.store.folder import Folder
from roundel.datasets.store.owner import is_gone, own_name
from roundel.datasets.store.store import Listed, MissingFile, is_confined
from roundel.datasets.store.writing import clear_leftovers, leftovers, new_file, owner_of, sha256, temporary_name
from roundel.scenes.errors import DataError

OUTSIDE = ("../a", "/etc/passwd", "a/../b", "a//b", "", ".", "..", "a/.b", "a\\b", "a\0b", "c:/x", "a/" + "x" * 300)


@pytest.mark.parametrize("name", OUTSIDE)
def test_names_stay_in_the_folder(tmp_path: Path, name: str) -> None:
    assert not is_confined(name)
    folder = Folder(tmp_path)
    for act in (folder.read, folder.size, lambda n: folder.write(n, b""), folder.remove):
        if act == folder.size:
            with pytest.raises(DataError, match="is not the name of a file"):
                folder.size(name)
            continue
        with pytest.raises(DataError, match="is not the name of a file"):
            act(name)


def test_links_pipes_folders_and_giants_are_refused(tmp_path: Path) -> None:
    folder = Folder(tmp_path / "ds")
    folder.write("whole", b"data")
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "secret").write_bytes(b"secret")
    (tmp_path / "ds" / "link").symlink_to(tmp_path / "outside" / "secret")
    (tmp_path / "ds" / "images").symlink_to(tmp_path / "outside")
    (tmp_path / "ds" / "folder").mkdir()
    os.mkfifo(tmp_path / "ds" / "pipe")
    with pytest.raises(DataError, match="is a link"):
        folder.read("link")
    with pytest.raises(DataError, match="is a link"):
        folder.read("images/secret")
    with pytest.raises(DataError, match="is a link"):
        folder.write("images/new", b"x")
    for name in ("folder", "pipe"):
        with pytest.raises(DataError, match=r"not a regular file|cannot be read"):
            folder.read(name)
    with pytest.raises(DataError, match="more than this file may have"):
        folder.read("whole", most=3)
    with pytest.raises(MissingFile):
        folder.read("nothing")
    assert [folder.size(n) for n in ("whole", "link", "pipe", "folder", "nothing")] == [4, None, None, None, None]
    assert (tmp_path / "outside" / "secret").read_bytes() == b"secret"


def test_what_is_read_is_held_against_its_record(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    folder.write("a", b"data")
    right = Listed(4, sha256(b"data"))
    assert folder.read_checked("a", right, "mend it") == b"data"
    with pytest.raises(DataError, match="4 bytes, but 5 were recorded; mend it"):
        folder.read_checked("a", Listed(5, right.sha256), "mend it")
    with pytest.raises(DataError, match="it was altered; mend it"):
        folder.read_checked("a", Listed(4, sha256(b"Data")), "mend it")


def test_leftovers_of_the_living_stay(tmp_path: Path) -> None:
    mine = temporary_name(tmp_path / "a.png")
    machine, _, started = own_name().split("-")
    gone = tmp_path / f".a.png.{machine}-{os.getpid()}-{int(started) + 1}.abcd.part"
    elsewhere = tmp_path / ".a.png.00000000-1-1.abcd.part"
    old = tmp_path / ".a.png.x.part"
    for path in (mine, gone, elsewhere, old):
        path.write_bytes(b"half")
    assert owner_of(mine) == own_name()
    assert not is_gone(own_name())
    assert clear_leftovers(tmp_path) == 2
    assert leftovers(tmp_path) == sorted([mine, elsewhere])


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    def write_half() -> None:
        with new_file(tmp_path / "deep" / "a") as file:
            file.write(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_half()
    assert list((tmp_path / "deep").iterdir()) == []
