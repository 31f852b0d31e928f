"""The write protocol: a file appears completely or not at all.

A temporary name in the same folder, write, flush, fsync, close, `os.replace`, fsync of the folder. The temporary name
has that of the process, so that what a killed process leaves is told from what another one is writing.
"""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from roundel.datasets.store.owner import is_gone, own_name
from roundel.scenes.errors import DataError

_PART = ".part"


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


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable."""
    # Windows cannot open a folder; its file system orders the rename itself.
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, and make their names durable."""
    missing = [f for f in (folder, *folder.parents) if not f.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for made in missing:
        sync_folder(made.parent)


def temporary_name(path: Path) -> Path:
    """A new temporary name beside a file, owned by this process."""
    return path.with_name(f".{path.name}.{own_name()}.{secrets.token_hex(4)}{_PART}")


def owner_of(temporary: Path) -> str:
    """The process that a temporary file belongs to; empty if its name does not tell."""
    parts = temporary.name.removesuffix(_PART).rsplit(".", 2)
    return parts[1] if len(parts) == 3 else ""


def leftovers(folder: Path) -> list[Path]:
    """Temporary files in a folder, of all processes."""
    try:
        return sorted(p for p in folder.iterdir() if p.name.startswith(".") and p.name.endswith(_PART))
    except OSError:
        return []


def clear_leftovers(folder: Path) -> int:
    """Remove the temporary files of processes that are gone; returns their number."""
    gone = [path for path in leftovers(folder) if is_gone(owner_of(path))]
    for path in gone:
        path.unlink(missing_ok=True)
    return len(gone)


@contextmanager
def new_file(path: str | Path) -> Iterator[BinaryIO]:
    """A file to write in steps; it appears under its name, complete, when the block ends without an error.

    Raises
    ------
    DataError
        If it cannot be written (for example, because the disk is full); no partial file is left.
    """
    path = Path(path)
    temporary: Path | None = None
    try:
        make_folder(path.parent)
        temporary = temporary_name(path)
        with temporary.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
        temporary = None
        sync_folder(path.parent)
    except OSError as error:
        raise write_failure(path, error) from error
    finally:
        if temporary is not None:
            with suppress(OSError):  # the error that led here says more
                temporary.unlink(missing_ok=True)


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
    temporary = temporary_name(path)
    try:
        make_folder(path.parent)
        os.link(source, temporary)
        os.replace(temporary, path)
        # Renaming between two links to the same file does nothing.
        temporary.unlink(missing_ok=True)
        sync_folder(path.parent)
    except OSError:
        temporary.unlink(missing_ok=True)
        try:
            data = source.read_bytes()
        except OSError as error:
            raise DataError(f"{source}: cannot read: {error.strerror or error}") from error
        write_file(path, data)
