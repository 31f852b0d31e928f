"""Worker processes whose results come in order, for `render` and `solve`."""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from roundel.scenes.errors import DataError

Item = TypeVar("Item")
Result = TypeVar("Result")

# Submitted ahead for each worker: none waits for the parent, and results that wait for an earlier one stay few.
_AHEAD = 4

# Why a worker could not start: told by its first task, because the pool would only report that it died.
_failure: list[BaseException] = []


def in_order(
    jobs: int,
    work: Callable[[Item], Result],
    items: Iterable[Item],
    start: Callable[..., None],
    arguments: tuple[Any, ...],
    died: str,
) -> Iterator[Result]:
    """Results of `work` for each item, computed by `jobs` fresh interpreters, in the order of the items.

    Leaving the iteration early (an error, Ctrl-C) ends the workers at once. They end as well if this process is killed.
    The workers start before the first item is asked for.

    Parameters
    ----------
    jobs : int
    work : callable
        A function of a module; it, its items and results are pickled.
    items : iterable
    start : callable
        Called with `arguments` once in each worker before its first item.
    arguments : tuple
    died : str
        What to tell the user if a worker dies, for example from lack of memory.

    Raises
    ------
    DataError
        If a worker died.
    Exception
        Whatever `start` or `work` raised.
    """
    # A fresh interpreter: neither Dr.Jit's nor BLAS's threads survive a fork.
    context = get_context("spawn")
    # Its end in the workers becomes readable when ours is closed, by us or by our death.
    alive, ours = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(jobs, context, _start, (alive, start, arguments))
    waiting: deque[Future[Result]] = deque()
    try:
        with alive:
            with _interrupts_blocked():
                # A worker is started for each task that finds none idle.
                for _ in range(jobs):
                    pool.submit(int)
            for item in items:
                # Ctrl-C is for the parent, which ends the workers; they inherit the blocked signal.
                with _interrupts_blocked():
                    waiting.append(pool.submit(_run, work, item))
                if len(waiting) >= _AHEAD * jobs:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        pool.shutdown()
    except BrokenProcessPool as error:
        raise DataError(died) from error
    finally:
        ours.close()
        pool.shutdown(cancel_futures=True)


def _start(alive: Connection, start: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    threading.Thread(target=_end_with_parent, args=(alive,), daemon=True).start()
    try:
        start(*arguments)
    except Exception as error:
        _failure.append(error)


def _end_with_parent(alive: Connection) -> None:
    alive.poll(None)
    os._exit(1)


def _run(work: Callable[[Item], Result], item: Item) -> Result:
    if _failure:
        raise _failure[0]
    return work(item)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
