"""Decode pictures on two threads at least."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def two_threads() -> Iterator[None]:
    """Two threads of Dr.Jit or more: a pool of one has no workers, and decoding an EXR waits for one forever."""
    import drjit as dr

    threads = dr.thread_count()
    dr.set_thread_count(max(threads, 2))
    try:
        yield
    finally:
        dr.set_thread_count(threads)
