"""Completion in a shell: the script, and what an argument may be. argcomplete does the rest, when Tab is pressed."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from importlib.metadata import entry_points

from roundel.cli.parser import SHELLS
from roundel.configs.shipped import study_names

# Repeated here because their modules import NumPy and more: completion must take no more than 0.1 s.
METHODS = (
    "pixels", "ml", "guaranteed", "direct", "edgedrawing", "blobs", "circles_grid", "circle_grid_pose", "wu2004",
    "chen2004", "kim2005", "gurdjos2006", "huang2015", "pollefeys1999", "calvet2016", "bergamasco2011", "pagani2011",
    "szpak2015", "chessboard", "fiala2010",
)  # fmt: skip
KINDS = (
    "disc", "disc_with_tick", "ring", "rings", "coded_rings", "ring_code", "dot_code", "two_discs", "dot_ring",
    "disc_with_chessboard", "disc_with_charuco", "chessboard", "circle_grid", "charuco", "tags", "stag",
)  # fmt: skip
PAPERS = ("a5", "a4", "a3", "letter", "legal", "tabloid")
INTRINSICS = (
    "true", "default", "default:width", "default:crop43", "default:2020s", "default:2020s:width",
    "default:2020s:crop43", "exif", "scaled:", "focal:", "focal35:", "calibrated:",
)  # fmt: skip
KNOWLEDGE = ("none", "same_side", "opposite_side", "normal:", "floor", "wall", "ceiling", "circle:", "tick", "coplanar")

_IMAGES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".heic")
_ANY = ("",)
# No file name ends with a slash, so this selects folders only.
_FOLDERS = ("/",)


def script(shell: str) -> str:
    """The script to load in a shell. It calls `roundel`, so it remains valid when Roundel is upgraded."""
    from argcomplete.shell_integration import shellcode

    return shellcode(["roundel"], shell=shell)


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer the completion request in the environment, and exit."""
    import argcomplete

    _add_completers(parser)
    # Options are offered only after a dash, because the first argument is usually a study's name.
    argcomplete.autocomplete(parser, always_complete_options=False)


def _add_completers(parser: argparse.ArgumentParser) -> None:
    """Tell every argument of every verb, and of a verb's own actions, what it may be."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for verb in action.choices.values():
                _add_completers(verb)
        else:
            vars(action)["completer"] = _completer(action)


def _completer(action: argparse.Action) -> Callable[..., list[str]]:
    def words(prefix: str, **_: object) -> list[str]:
        return [*_values(action.dest), *_paths(prefix, _suffixes(action))]

    return words


def _values(dest: str) -> list[str]:
    """Possible words of an argument, by its name in the parser."""
    if dest in ("study", "name", "source"):
        return study_names()
    if dest == "method":
        return [*METHODS, *sorted(entry.name for entry in entry_points(group="roundel.methods"))]
    known = {"kind": KINDS, "paper": PAPERS, "intrinsics": INTRINSICS, "knowledge": KNOWLEDGE, "shell": SHELLS}
    return list(known.get(dest, ()))


def _suffixes(action: argparse.Action) -> tuple[str, ...]:
    """Suffixes of the files that an argument accepts; empty if it is not a path."""
    if action.dest in ("study", "sensor"):
        return (".yaml", ".yml")
    if action.dest == "inputs":
        return _IMAGES
    if action.metavar in ("DATASET", "REPORT", "FOLDER"):
        return _FOLDERS
    if action.dest == "method":
        return (".py",)
    return _ANY if action.metavar in ("FILE", "OUT", "CAMERA", "ESTIMATES") else ()


def _paths(prefix: str, suffixes: tuple[str, ...]) -> list[str]:
    if not suffixes:
        return []
    folder, _, start = prefix.rpartition("/")
    try:
        found = sorted(os.scandir(f"{folder}/" if "/" in prefix else "."), key=lambda entry: entry.name)
    except OSError:
        return []
    at = prefix[: len(prefix) - len(start)]
    named = [e for e in found if e.name.startswith(start) and (start or not e.name.startswith("."))]
    return [
        f"{at}{e.name}{'/' if e.is_dir() else ''}" for e in named if e.is_dir() or e.name.lower().endswith(suffixes)
    ]
