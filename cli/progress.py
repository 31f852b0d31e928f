"""Progress on stderr: a bar on a terminal, a line every ten seconds elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from roundel.cli.interrupt import stop_if_interrupted

_SECONDS_BETWEEN_LINES = 10.0


class Show(Protocol):
    """Shows that `done` of `total` frames are done; `step` names a preliminary step that is counted separately."""

    def __call__(self, done: int, total: int, *, step: str | None = None) -> None:
        """Show it."""


@contextmanager
def progress(what: str) -> Iterator[Show]:
    """A callable `(done, total)` that shows the progress of `what`.

    The end of `what` is always printed, the end of a step is not.
    """
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=Console(stderr=True)) as bar:
            tasks: dict[str, TaskID] = {}

            def update(done: int, total: int, *, step: str | None = None) -> None:
                stop_if_interrupted()
                name = step or what
                # The bar appears only when there is something to count; some verbs find nothing to do.
                if name not in tasks:
                    tasks[name] = bar.add_task(name, total=total)
                bar.update(tasks[name], completed=done, total=total, visible=step is None or done < total)

            yield update
        return
    started = printed = time.monotonic()

    def line(done: int, total: int, *, step: str | None = None) -> None:
        nonlocal printed
        stop_if_interrupted()
        now = time.monotonic()
        if (done == total and step is None) or now - printed >= _SECONDS_BETWEEN_LINES:
            printed = now
            print(f"{step or what}: {done} of {total} frames, {now - started:.0f} s", file=sys.stderr, flush=True)

    yield line
