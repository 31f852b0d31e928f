"""Locks that the system gives back when a process ends, however it ends; no clock takes part.

They are those of `flock`: they hold between the processes of a host, and between hosts that share a disk whose file
system carries them (NFS from version 4, Lustre, GPFS).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from roundel.datasets.store.writing import make_folder, write_failure


def try_lock(descriptor: int, *, exclusive: bool, wait: bool = False) -> bool | None:
    """Take the lock of an open file: whether it was free; None where the file system has no locks."""
    try:
        import fcntl
    except ImportError:  # Windows
        return None
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH) | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


@contextmanager
def one_at_a_time(path: Path) -> Iterator[None]:
    """A block that one process at a time is in; the others wait. `path` is a file that exists meanwhile.

    Raises
    ------
    DataError
        If the file cannot be written.
    """
    while True:
        try:
            make_folder(path.parent)
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        except OSError as error:
            raise write_failure(path, error) from error
        try:
            try_lock(descriptor, exclusive=True, wait=True)
            # Whoever was in the block before has removed its file: the lock is then on one that nobody else sees.
            try:
                same = os.path.samestat(os.fstat(descriptor), os.stat(path))
            except OSError:
                same = False
            if same:
                try:
                    yield
                finally:
                    path.unlink(missing_ok=True)
                return
        finally:
            os.close(descriptor)
