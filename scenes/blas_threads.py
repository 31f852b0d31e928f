"""One BLAS thread while small matrices are worked on.

A BLAS wakes all its threads even for 17x17 matrices, and these then wait for each other: a solved frame took three
times its processor time. OMP_NUM_THREADS=1 would prevent it, but users do not set it.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

_OWNERS = ("numpy", "cv2", "scipy.linalg")  # each brings a BLAS of its own, once it is imported
_owned = threading.Lock()


@cache
def _libraries(imported: tuple[bool, ...]) -> Any:
    """The BLAS libraries of the process; finding them takes milliseconds, so it is done once for what is imported."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold every BLAS of the process to one thread; also a decorator.

    The number belongs to the process, not to a Python thread. Whoever sets it restores it; others that enter meanwhile
    leave it alone. It takes some 50 microseconds.
    """
    if not _owned.acquire(blocking=False):
        yield
        return
    try:
        with _libraries(tuple(name in sys.modules for name in _OWNERS)).limit(limits=1):
            yield
    finally:
        _owned.release()
