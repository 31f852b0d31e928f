"""The shipped studies: their names, files and one-line summaries."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).parent
_STARTING_POINT = _FOLDER / "starting_point.txt"


def study_names() -> list[str]:
    """Names of the shipped studies, sorted."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


def study_path(name: str) -> Path:
    """File of a shipped study.

    Raises
    ------
    KeyError
        If no study has this name.
    """
    if name not in study_names():
        raise KeyError(name)
    return _FOLDER / f"{name}.yaml"


def study_summary(name: str) -> str:
    """Summary of a shipped study: its first comment line."""
    with study_path(name).open(encoding="utf-8") as file:
        return file.readline().lstrip("# ").rstrip(".\n")


def starting_point() -> str:
    """A short commented study, for `roundel init`."""
    return _STARTING_POINT.read_text(encoding="utf-8")
