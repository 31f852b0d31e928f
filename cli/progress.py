"""Progress on stderr: a bar on a terminal, a line every ten seconds elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from roundel.cli.interrupt import stop_if_interrupted

_SECONDS_BETWEEN_LINES = 10.0


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A callable `(done, total)` that shows how far `what` is."""
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=Console(stderr=True)) as bar:

            def update(done: int, total: int) -> None:
                stop_if_interrupted()
                # No bar before there is something to count: some verbs find nothing to do.
                task = bar.task_ids[0] if bar.task_ids else bar.add_task(what, total=total)
                bar.update(task, completed=done, total=total)

            yield update
        return
    started = said = time.monotonic()

    def line(done: int, total: int) -> None:
        nonlocal said
        stop_if_interrupted()
        now = time.monotonic()
        if done == total or now - said >= _SECONDS_BETWEEN_LINES:
            said = now
            print(f"{what}: {done} of {total} frames, {now - started:.0f} s", file=sys.stderr, flush=True)

    yield line
