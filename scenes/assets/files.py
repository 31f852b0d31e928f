"""Files that a study brings along: they lie inside its folder, are of bounded size, and are known by their sha256."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath

MOST_BYTES = 256_000_000
MOST_TEXTURE_PX = 8192
IMAGES = (".png", ".jpg", ".jpeg")


def inside(folder: Path, name: str) -> Path:
    """The path of a file or folder that a study in `folder` names.

    Raises
    ------
    ValueError
        If the name is absolute, an address, or leads out of the folder (by `..` or a symbolic link).
    """
    parts = PurePosixPath(name).parts
    if not parts or name.startswith(("/", "~")) or "\\" in name or ":" in name:
        raise ValueError(f"{name}: is not a relative path; give it relative to the study, with forward slashes")
    if ".." in parts:
        raise ValueError(f"{name}: leaves the study's folder; put the file inside it")
    path = folder.joinpath(*parts)
    if not path.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"{name}: is a link that leaves the study's folder; put the file itself inside it")
    return path


def read_inside(folder: Path, name: str, most_bytes: int = MOST_BYTES) -> bytes:
    """The content of a file that a study in `folder` names.

    Raises
    ------
    ValueError
        If it is missing, outside, too large, or cannot be read.
    """
    path = inside(folder, name)
    if not path.is_file():
        raise ValueError(f"no such file: {name}; the path is relative to the study")
    size = path.stat().st_size
    if size > most_bytes:
        raise ValueError(f"{name}: {size / 1e6:.0f} MB is too large (at most {most_bytes / 1e6:.0f} MB)")
    try:
        return path.read_bytes()
    except OSError as error:
        raise ValueError(f"{name}: cannot be read ({error.strerror})") from error


def sha256_of(data: bytes) -> str:
    """Checksum of a file's content."""
    return hashlib.sha256(data).hexdigest()


def digest_of(checksums: Mapping[str, str]) -> str:
    """One checksum of several files: of their names and checksums, in order of the names."""
    return sha256_of(json.dumps(sorted(checksums.items())).encode())


def check_recorded(found: Mapping[str, str], recorded: Mapping[str, str] | None, key: str) -> None:
    """Compare checksums by file name with those that a study recorded, if it did.

    Raises
    ------
    ValueError
        If a file was changed, added or removed; the message names the first.
    """
    if recorded is None:
        return
    changed = sorted(name for name in {*found, *recorded} if found.get(name) != recorded.get(name))
    if changed:
        raise ValueError(f"{changed[0]}: is not the recorded file (another sha256); restore it, or remove {key}")


def sibling(name: str, reference: str) -> str:
    """Name, relative to the study, of a file that the file `name` refers to."""
    above = PurePosixPath(name).parent
    return reference if above == PurePosixPath() else f"{above}/{reference}"


def any_of(endings: Iterable[str]) -> str:
    """File endings as words, as in `.png, .jpg`."""
    return ", ".join(endings)
