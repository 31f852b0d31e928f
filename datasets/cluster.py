"""Workers of a Dask cluster in place of processes of this machine: the same calls, on any number of machines.

What a worker does is durable where it does it: frames are recorded in its own log, solved blocks are files. The client
only counts, so that the loss of any process loses no more than it was working on.
"""

from __future__ import annotations

import ctypes
import logging
import secrets
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Any

from roundel.datasets.environment import versions
from roundel.datasets.worker_pool import Lost, WorkerPool
from roundel.scenes.errors import BackendError, DataError, UsageError, first_line

# Waited for a scheduler that does not answer, and for the first worker, seconds.
_CONNECT_S = 10
_WORKERS_S = 30

# Tasks handed out ahead of the result that is waited for, for each worker thread.
_AHEAD = 3

# Parameters of glibc's mallopt, see malloc.h; the values are those to which it would raise them by itself.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3

# In a worker: what it was started for, and a lock, because a worker may have several threads.
_started: list[str] = []
_one = threading.Lock()


class ClusterPool:
    """Has the calls of `WorkerPool`; its workers are those of a scheduler.

    Parameters
    ----------
    address : str
        Of the scheduler, such as tcp://10.0.0.1:8786.
    work, start, arguments
        See `in_order`. Files that they name are on a disk that all workers share.
    stop : callable, optional
        Called in each worker at the end.

    Raises
    ------
    UsageError
        If the package `distributed` is not installed.
    BackendError
        If no scheduler answers, or it has no workers.
    DataError
        If a worker has other versions than this process.
    """

    def __init__(
        self,
        address: str,
        work: Callable[..., Any],
        start: Callable[..., None],
        arguments: tuple[Any, ...],
        stop: Callable[[], None] | None = None,
    ) -> None:
        self.address, self._stop = address, stop
        self._client = _connected(address)
        self._task = secrets.token_hex(8), work, start, arguments

    def __enter__(self) -> ClusterPool:
        try:
            self._client.wait_for_workers(1, timeout=_WORKERS_S)
            theirs = self._client.run(versions)
        except (TimeoutError, OSError) as error:
            self._client.close()
            raise BackendError(
                f"{self.address}: the scheduler has no workers; start some with `dask worker`"
            ) from error
        except Exception as error:  # whatever a worker without Roundel raises when it unpickles
            self._client.close()
            raise DataError(f"{self.address}: a worker cannot run Roundel ({first_line(error)})") from error
        for worker, its in theirs.items():
            other = next((name for name in {**its, **versions()} if its.get(name) != versions().get(name)), None)
            if other is not None:
                self._client.close()
                raise DataError(
                    f"{self.address}: worker {worker} has {other} {its.get(other, 'none')}, this process "
                    f"{versions().get(other, 'none')}; install the same versions"
                )
        return self

    def __exit__(self, *_: object) -> None:
        if self._stop is not None and self._client.status == "running":
            # A worker that is lost meanwhile needs no end.
            with suppress(Exception):
                self._client.run(_end, self._task[0], self._stop, on_error="ignore")
        self._client.close()

    def in_order(self, items: Iterable[Any]) -> Iterator[Any]:
        """Results for the items, in their order; see `worker_pool.in_order`.

        Raises
        ------
        DataError
            If the scheduler is lost.
        """
        from concurrent.futures import CancelledError

        from distributed import KilledWorker
        from distributed.comm.core import CommClosedError

        waiting, given, exhausted = iter(items), deque[tuple[Any, Any]](), False
        try:
            while True:
                while not exhausted and len(given) < _AHEAD * max(1, self._threads()):
                    try:
                        item = next(waiting)
                    except StopIteration:
                        exhausted = True
                        break
                    given.append((item, self._client.submit(_run, *self._task, item, pure=False)))
                if not given:
                    return
                item, future = given[0]
                try:
                    result = future.result()
                except KilledWorker:
                    result = Lost(item, None)
                given.popleft()
                yield result
        except (CancelledError, OSError) as error:
            # Lost connections are errors of the operating system, or cancel what was asked for.
            if not isinstance(error, CancelledError | CommClosedError) and self._client.status == "running":
                raise
            raise DataError(
                f"{self.address}: the scheduler is lost; what is finished is kept: run the command again"
            ) from error
        finally:
            with suppress(Exception):  # of a lost scheduler there is nothing to cancel
                self._client.cancel([future for _, future in given])

    def _threads(self) -> int:
        return sum(self._client.nthreads().values()) if self._client.status == "running" else 1


def pool_of(
    jobs: int,
    scheduler: str | None,
    work: Callable[..., Any],
    start: Callable[..., None],
    arguments: tuple[Any, ...],
    died: str,
    stop: Callable[[], None] | None = None,
) -> WorkerPool | ClusterPool:
    """Workers of a scheduler, if its address is given; else processes of this machine. See `WorkerPool`."""
    if scheduler is not None:
        return ClusterPool(scheduler, work, start, arguments, stop)
    return WorkerPool(jobs, work, start, arguments, died)


def threads_of_worker() -> int | None:
    """As many threads as the worker of a cluster that this process is may use (`--nthreads`); None if it is none."""
    try:
        from distributed import get_worker

        return int(get_worker().state.nthreads)
    except (ImportError, ValueError):
        return None


def _connected(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise UsageError("--scheduler: needs the package distributed: pip install 'roundel[cluster]'") from error
    # What its loops say of lost connections is said here in one line.
    for name in ("distributed", "asyncio", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    make: Any = Client
    try:
        return make(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        raise BackendError(
            f"{address}: no Dask scheduler answers there ({first_line(error)}); start one with `dask scheduler`"
        ) from error


def _keep_memory() -> None:
    """Let the C library keep freed memory, as in any other process.

    Dask starts its workers with MALLOC_TRIM_THRESHOLD_, so that they give it back at once: arrays of images are then
    mapped anew for each operation, which takes a tenth of a frame's time.
    """
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library
            library = ctypes.CDLL(None)
            library.mallopt(_M_MMAP_THRESHOLD, 32 << 20)
            library.mallopt(_M_TRIM_THRESHOLD, 64 << 20)


def _end(token: str, stop: Callable[[], None]) -> None:
    """End what a worker was started for; one that is at work still is left alone."""
    if _one.acquire(blocking=False):
        try:
            if _started == [token]:
                _started.clear()
                stop()
        finally:
            _one.release()


def _run(
    token: str, work: Callable[[Any], Any], start: Callable[..., None], arguments: tuple[Any, ...], item: Any
) -> Any:
    """What a worker does with an item; it starts once for each client."""
    with _one:
        if _started != [token]:
            _keep_memory()
            start(*arguments)
            _started[:] = [token]
        return work(item)
