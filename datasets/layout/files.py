"""File names of a dataset, and the write protocol.

A file appears completely or not at all: a temporary name in the same folder, write, flush, fsync, close, `os.replace`,
fsync of the folder. Solver and validator write their records the same way.
"""

from __future__ import annotations

import errno
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from roundel.scenes.errors import DataError, UsageError

MANIFEST = "manifest.json"
STUDY = "study.yaml"
TRUTH = "truth.parquet"
TRUTH_CSV = "truth.csv"
CAMERAS = "cameras.json"
POINTS = "points.parquet"
ROWS = "rows.parquet"
JOURNAL = "journal.jsonl"
TIMINGS = "timings.jsonl"


def image_name(frame_id: int, suffix: str = ".png") -> str:
    """Path of a frame's image within the dataset; `suffix` is .png or .jpg."""
    return f"images/{frame_id:06d}{suffix}"


def radiance_name(frame_id: int) -> str:
    """Path of a frame's radiance within the dataset."""
    return f"radiance/{frame_id:06d}.exr"


def sha256(data: bytes) -> str:
    """Hexadecimal sha256."""
    return hashlib.sha256(data).hexdigest()


def write_failure(path: Path, error: OSError) -> DataError:
    """One-line error for a file that cannot be written."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return DataError(
            f"{path}: the disk is full; free some space and run the same command again; finished work is kept"
        )
    return DataError(f"{path}: cannot write: {error.strerror or error}")


def check_no_dataset(out: Path) -> None:
    """Refuse a results folder that holds a dataset, because some file names would collide.

    Raises
    ------
    UsageError
        If the folder holds a dataset.
    """
    if any((out / name).is_file() for name in (MANIFEST, JOURNAL, CAMERAS)):
        raise UsageError(f"{out}: is a dataset; name another folder for the results")


def _sync_folder(folder: Path) -> None:
    # Windows cannot open a folder; its file system orders the rename itself.
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextmanager
def new_file(path: str | Path) -> Iterator[BinaryIO]:
    """A file to write in steps; it appears under its name, complete, when the block ends without an error.

    Raises
    ------
    DataError
        If it cannot be written (for example, because the disk is full); no partial file is left.
    """
    path = Path(path)
    temporary: str | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
        with os.fdopen(descriptor, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes files that only their owner can read; a dataset is meant for sharing.
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
        temporary = None
        _sync_folder(path.parent)
    except OSError as error:
        raise write_failure(path, error) from error
    finally:
        if temporary is not None and os.path.exists(temporary):
            os.unlink(temporary)


def write_file(path: str | Path, data: bytes) -> None:
    """Write a file completely or not at all.

    Raises
    ------
    DataError
        If it cannot be written (for example, because the disk is full); no partial file is left.
    """
    with new_file(path) as file:
        file.write(data)


def link_file(source: Path, path: str | Path) -> None:
    """Hard-link a file that is already safely on disk; copy it if that fails (for example, on another disk).

    Raises
    ------
    DataError
        If both fail.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.link.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.unlink(missing_ok=True)
        os.link(source, temporary)
        os.replace(temporary, path)
        # Renaming between two links to the same file does nothing.
        temporary.unlink(missing_ok=True)
        _sync_folder(path.parent)
    except OSError:
        try:
            data = source.read_bytes()
        except OSError as error:
            raise DataError(f"{source}: cannot read: {error.strerror or error}") from error
        write_file(path, data)


def append_line(path: str | Path, line: str) -> None:
    """Append one line and sync it to disk before returning."""
    path = Path(path)
    try:
        with path.open("ab") as file:
            file.write(line.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise write_failure(path, error) from error
