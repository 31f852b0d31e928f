"""Expected failures: one-line messages with the exit status of the command."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path


class RoundelError(Exception):
    """An expected failure: the command prints its message on one line and exits with status `exit_code`."""

    exit_code = 4


class UsageError(RoundelError):
    """A wrong argument: an unknown method, a malformed `--intrinsics`, a missing file."""

    exit_code = 2


class NotComparableError(RoundelError):
    """Results that cannot be compared, or too few results (including none)."""

    exit_code = 3


class DataError(RoundelError):
    """Data on disk are corrupt, incomplete, or not what they claim to be."""

    exit_code = 4


class BackendError(RoundelError):
    """The renderer cannot start; the message names the remedy."""

    exit_code = 4


class StudyError(RoundelError):
    """A study that cannot be read; the message starts with `path:line:column:`.

    Attributes
    ----------
    path : Path
    line, column : int
        Counted from 1, as editors do.
    """

    exit_code = 2

    def __init__(self, message: str, path: str | Path, line: int = 1, column: int = 1) -> None:
        self.path = Path(path)
        self.line = line
        self.column = column
        self.reason = message
        super().__init__(f"{path}:{line}:{column}: {message}")

    def __reduce__(self) -> tuple[type[StudyError], tuple[str, Path, int, int]]:
        # Pickle the parts rather than the whole message: the error may come from another process.
        return type(self), (self.reason, self.path, self.line, self.column)


def did_you_mean(word: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """The known word closest to an unknown one, as a question; empty if none is close.

    Examples
    --------
    >>> did_you_mean("focl_px", ["focal_px", "height_px"])
    'did you mean focal_px?'
    """
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=cutoff)
    return f"did you mean {close[0]}?" if close else ""


def first_line(error: BaseException) -> str:
    """First line of an exception's text for one-line messages; the name of its type if it has no text."""
    return next(iter(str(error).splitlines()), type(error).__name__)
