"""Worker processes whose results come in order, for `render` and `solve`.

A worker that dies is replaced, and its item is worked on once more. An item whose worker dies twice is set aside.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
from multiprocessing import connection, get_context, resource_tracker
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

from roundel.scenes.errors import DataError, first_line

Item = TypeVar("Item")
Result = TypeVar("Result")

# Handed out ahead of the result that is waited for, for each worker: results that wait for an earlier one stay few.
_AHEAD = 4

# How often an item may cost a worker before it is set aside.
_TRIES = 2

# A fresh interpreter: neither Dr.Jit's nor BLAS's threads survive a fork.
_CONTEXT = get_context("spawn")


@dataclass(frozen=True)
class Lost(Generic[Item]):
    """In place of a result: each worker that had the item died."""

    item: Item
    exit_code: int | None

    def __str__(self) -> str:
        if self.exit_code is None:
            return "each process that had it died, perhaps for lack of memory"
        if self.exit_code < 0:
            name = signal.Signals(-self.exit_code).name if -self.exit_code in signal.valid_signals() else "a signal"
            return f"its process was killed twice ({name}), perhaps for lack of memory"
        return f"its process died twice (exit status {self.exit_code})"


@dataclass
class _Task(Generic[Item]):
    number: int
    item: Item
    tries: int = 0


@dataclass
class _Worker:
    process: Any
    pipe: Connection
    task: _Task[Any] | None = None
    started: bool = field(default=False)


def in_order(
    jobs: int,
    work: Callable[[Item], Result],
    items: Iterable[Item],
    start: Callable[..., None],
    arguments: tuple[Any, ...],
    died: str,
) -> Iterator[Result | Lost[Item]]:
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
        What to tell the user if workers die before they have started.

    Returns
    -------
    iterator
        A result for each item, or `Lost` if two workers died of it.

    Raises
    ------
    DataError
        If workers die while they start.
    Exception
        Whatever `start` or `work` raised.
    """
    with WorkerPool(jobs, work, start, arguments, died) as pool:
        yield from pool.in_order(items)


class WorkerPool:
    """Workers that stay for several calls of `in_order`; see the function of that name. They end with the block."""

    def __init__(
        self, jobs: int, work: Callable[..., Any], start: Callable[..., None], arguments: tuple[Any, ...], died: str
    ) -> None:
        self._jobs, self._arguments, self._died = jobs, (work, start, arguments), died
        # Its end in the workers becomes readable when ours is closed, by us or by our death.
        self._alive, self._ours = _CONTEXT.Pipe(duplex=False)
        self._workers: list[_Worker] = []
        self._again: list[_Task[Any]] = []
        self._numbers = count()
        self._results: dict[int, Any] = {}
        self._failed_starts = 0

    def __enter__(self) -> WorkerPool:
        if os.name == "posix":
            # Otherwise the first worker starts it, and starting it unblocks the interrupts that workers do not get.
            resource_tracker.ensure_running()
        for _ in range(self._jobs):
            self._add_worker()
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def in_order(self, items: Iterable[Any]) -> Iterator[Any]:
        """Results for the items, in their order; may be called again before it has ended."""
        waiting, given, exhausted = iter(items), deque[int](), False
        while True:
            while not exhausted and len(given) < _AHEAD * self._jobs and self._has_idle():
                try:
                    item = next(waiting)
                except StopIteration:
                    exhausted = True
                    break
                given.append(next(self._numbers))
                self._give(_Task(given[-1], item))
            if given and given[0] in self._results:
                yield self._results.pop(given.popleft())
            elif exhausted and not given:
                return
            else:
                self._wait()

    def _add_worker(self) -> None:
        here, there = _CONTEXT.Pipe()
        # Ctrl-C is for the parent, which ends the workers; they inherit the blocked signal.
        with _interrupts_blocked(), there:
            process = _CONTEXT.Process(target=_serve, args=(self._alive, there, *self._arguments), daemon=True)
            process.start()
        self._workers.append(_Worker(process, here))

    def _has_idle(self) -> bool:
        return not self._again and any(worker.task is None for worker in self._workers)

    def _give(self, task: _Task[Any]) -> None:
        worker = next(worker for worker in self._workers if worker.task is None)
        worker.task = task
        with suppress(BrokenPipeError, ConnectionResetError):  # it died: `_wait` finds that
            worker.pipe.send(task.item)

    def _wait(self) -> None:
        """Take the results that have come; waits for news of a worker."""
        while self._again and any(worker.task is None for worker in self._workers):
            self._give(self._again.pop())
        for pipe in connection.wait([worker.pipe for worker in self._workers]):
            worker = next(worker for worker in self._workers if worker.pipe is pipe)
            try:
                kind, value = worker.pipe.recv()
            except (EOFError, ConnectionResetError, pickle.UnpicklingError):
                self._replace(worker)
                continue
            if kind == "error":
                raise value
            worker.started = True
            if kind == "result":
                assert worker.task is not None, "a result answers a task"
                self._results[worker.task.number] = value
                worker.task = None

    def _replace(self, worker: _Worker) -> None:
        """Put another worker in place of a dead one; its item is done again, or lost."""
        worker.process.join()
        worker.pipe.close()
        self._workers.remove(worker)
        if not worker.started:
            self._failed_starts += 1
            if self._failed_starts > _TRIES:
                raise DataError(self._died)
        task = worker.task
        if task is not None:
            task.tries += worker.started
            if task.tries < _TRIES:
                self._again.append(task)
            else:
                self._results[task.number] = Lost(task.item, worker.process.exitcode)
        self._add_worker()

    def _end(self) -> None:
        self._ours.close()
        for worker in self._workers:
            worker.pipe.close()
        for worker in self._workers:
            worker.process.join(timeout=5)
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
        self._alive.close()


def _serve(
    alive: Connection,
    pipe: Connection,
    work: Callable[[Any], Any],
    start: Callable[..., None],
    arguments: tuple[Any, ...],
) -> None:
    """What a worker does until its parent has no more for it."""
    threading.Thread(target=_end_with_parent, args=(alive,), daemon=True).start()
    try:
        start(*arguments)
        pipe.send(("started", None))
        while True:
            item = pipe.recv()
            pipe.send(("result", work(item)))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return
    except Exception as error:
        try:
            pipe.send(("error", error))
        except (OSError, ValueError):
            return
        except Exception:  # an error that cannot be pickled
            pipe.send(("error", RuntimeError(f"{type(error).__name__}: {first_line(error)}")))


def _end_with_parent(alive: Connection) -> None:
    alive.poll(None)
    os._exit(1)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
