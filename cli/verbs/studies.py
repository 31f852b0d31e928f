"""Shipped studies by name: listed, printed, copied as a starting point."""

from __future__ import annotations

import argparse
from pathlib import Path

from roundel.configs.shipped import starting_point, study_names, study_path, study_summary
from roundel.scenes.errors import UsageError, did_you_mean


def find_study(given: str) -> Path:
    """The file that a STUDY argument means: that file if it exists, else the shipped study of that name.

    Raises
    ------
    UsageError
        If it is neither, and looks like a name rather than a path.
    """
    path = Path(given)
    if path.is_file():
        return path
    if given in study_names():
        return study_path(given)
    if path.suffix or len(path.parts) != 1 or path.exists():
        return path  # a path: reading it reports the error
    raise _unknown(given)


def _unknown(name: str) -> UsageError:
    hint = did_you_mean(name, study_names()) or "`roundel studies` lists the shipped studies"
    return UsageError(f"{name}: no such file, and no shipped study has this name; {hint}")


def list_studies(arguments: argparse.Namespace) -> int:
    """List the shipped studies, or print one."""
    if arguments.name is None:
        names = study_names()
        width = max(map(len, names))
        for name in names:
            print(f"{name:{width}}  {study_summary(name)}")
        return 0
    if arguments.name not in study_names():
        raise _unknown(arguments.name)
    print(study_path(arguments.name).read_text(encoding="utf-8"), end="")
    return 0


def init_study(arguments: argparse.Namespace) -> int:
    """Write a commented study to start from; an existing file is never overwritten."""
    if arguments.source is not None and arguments.source not in study_names():
        raise _unknown(arguments.source)
    source = arguments.source
    text = starting_point() if source is None else study_path(source).read_text(encoding="utf-8")
    path = Path(arguments.file)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise UsageError(f"{path}: already exists; give another file") from None
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}") from error
    print(f"{path}: written; next: roundel check {path}, then roundel run {path} OUT")
    return 0
