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

_owned = threading.Lock()


@cache
def _libraries(with_opencv: bool) -> Any:
    """The BLAS libraries of the process; finding them takes milliseconds, so it is done once.

    OpenCV brings its own, which is only found once cv2 is imported.
    """
    import scipy.linalg
    from threadpoolctl import ThreadpoolController

    assert scipy.linalg, "imported for its library: NumPy and SciPy have one each"
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
        with _libraries("cv2" in sys.modules).limit(limits=1):
            yield
    finally:
        _owned.release()
