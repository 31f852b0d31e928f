"""Expected failures: one-line messages with the exit status of the command."""

from __future__ import annotations

from pathlib import Path


class RoundelError(Exception):
    """An expected failure: the command prints its message on one line and ends with `exit_code`."""

    exit_code = 4


class UsageError(RoundelError):
    """A wrong argument: an unknown method, a malformed `--intrinsics`, a missing file."""

    exit_code = 2


class NotComparableError(RoundelError):
    """Unlike things were to be compared, or too few of them (none counts)."""

    exit_code = 3


class DataError(RoundelError):
    """Data on disk are corrupt, incomplete, or not what they claim to be."""

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
        # Pickled by its parts, not by its whole sentence: it may come from another process.
        return type(self), (self.reason, self.path, self.line, self.column)
