"""The folder of a page: it appears complete or not at all, and replaces nothing but an earlier page."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from roundel.datasets.layout.files import check_no_dataset
from roundel.datasets.store.owner import is_gone, own_name
from roundel.datasets.store.writing import write_failure
from roundel.scenes.errors import UsageError

INDEX, DATA = "index.html", "data.js"
SCORES, THUMBS, IMAGES = "scores", "thumbs", "images"
ASSETS = ("browse.css", "frames.js", "pictures.js", "grid.js", "large.js", "browse.js")

# What a page consists of; a folder with anything else is somebody's own.
_NAMES = {INDEX, DATA, SCORES, THUMBS, IMAGES, *ASSETS}
DATA_START = "const ROUNDEL = "
_SUFFIX = ".page"


def check_page_folder(out: Path) -> None:
    """Refuse a folder that holds anything but an earlier page.

    Raises
    ------
    UsageError
        If it is a file, a dataset, or has files of another origin.
    """
    if not out.exists():
        return
    if not out.is_dir():
        raise UsageError(f"{out}: is a file; give a folder for the page")
    check_no_dataset(out)
    found = {path.name for path in out.iterdir()}
    if found and not (found <= _NAMES and _is_ours(out / DATA)):
        raise UsageError(f"{out}: is not empty and not a page of `roundel browse`; give another folder")


def _is_ours(data: Path) -> bool:
    try:
        with data.open("rb") as file:
            return file.read(len(DATA_START)) == DATA_START.encode()
    except OSError:
        return False


@contextmanager
def page_folder(out: Path) -> Iterator[Path]:
    """A folder to write the page to; it gets the name `out` when the block ends without an error.

    A page can be written again, so its files are not flushed to the disk one by one as those of a dataset are.

    Raises
    ------
    UsageError
        If `out` holds anything but an earlier page.
    DataError
        If it cannot be written; an earlier page stays as it is.
    """
    # A link to a folder stays one.
    out = out.resolve()
    check_page_folder(out)
    new = _beside(out)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        _clear_leftovers(out)
        new.mkdir()
        yield new
        check_page_folder(out)
        _put_in_place(new, out)
    except OSError as error:
        raise write_failure(out, error) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)


def _put_in_place(new: Path, out: Path) -> None:
    """Rename the new folder. Folders cannot be exchanged in one step, so that for a moment there is no page."""
    old = _beside(out)
    if out.exists():
        os.rename(out, old)
    try:
        os.rename(new, out)
    except OSError:
        with suppress(OSError):
            os.rename(old, out)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _beside(out: Path) -> Path:
    """A new name beside the page, owned by this process."""
    return out.with_name(f".{out.name}.{own_name()}.{secrets.token_hex(4)}{_SUFFIX}")


def _clear_leftovers(out: Path) -> None:
    """Remove what killed processes left beside the page."""
    start = f".{out.name}."
    for path in out.parent.iterdir():
        if path.name.startswith(start) and path.name.endswith(_SUFFIX):
            owner = path.name.removeprefix(start).partition(".")[0]
            if is_gone(owner):
                shutil.rmtree(path, ignore_errors=True)
