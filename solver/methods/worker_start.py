"""What solving in several processes takes: compiled kernels, one thread each, and arguments that can be sent."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

from roundel.scenes.errors import UsageError, first_line
from roundel.solver.methods.compilation_shares import drawn_disc
from roundel.solver.methods.locate import locate

Item = TypeVar("Item")


def after_warm_up(items: Iterable[Item]) -> Iterator[Item]:
    """The items, after a small drawn disc was solved, which compiles the kernels: workers load them from the cache.

    Otherwise each of them would compile its own. They start meanwhile.
    """
    locate(drawn_disc(), 1.0)
    yield from items


def one_opencv_thread() -> None:
    """Hold OpenCV to one thread in this process, for workers: they share the cores already."""
    import cv2

    cv2.setNumThreads(1)


def pickled(arguments: tuple[Any, ...]) -> bytes:
    """Arguments as bytes.

    Raises
    ------
    UsageError
        If they hold knowledge of a class that another process cannot find.
    """
    try:
        return pickle.dumps(arguments)
    except (TypeError, AttributeError, pickle.PicklingError) as error:
        reason = first_line(error)
        raise UsageError(f"this knowledge cannot be sent to other processes; use one job ({reason})") from error
