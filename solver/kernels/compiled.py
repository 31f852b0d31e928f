"""`compiled`: compile a function with Numba once, keep the result on disk, and say so while it happens."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import event

Function = TypeVar("Function", bound=Callable[..., Any])

NOTICE = "roundel: compiling the solver's inner loops (once after an installation, about a minute)"


def compiled(function: Function) -> Function:
    """A function compiled at its first call; later processes load it from Numba's cache.

    Numba compares only the function's own file with the cached one. Kernels call each other across files, so the stamp
    of all files of this package and of the function's own takes its place.

    Parameters
    ----------
    function : callable
        Of scalars and arrays only; it holds no lock while it runs (`nogil`), and divides by zero as NumPy does.

    Returns
    -------
    callable
        With the same signature.
    """
    kernel: Function = _cached(numba.njit(cache=True, nogil=True, error_model="numpy")(function))
    return kernel


def compiled_sums(function: Function) -> Function:
    """As `compiled`, for long sums alone: their terms are added in the order that suits the processor's vectors."""
    kernel: Function = _cached(numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc"})(function))
    return kernel


def _cached(kernel: Any) -> Any:
    file: Any = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
    if hasattr(file, "_source_stamp"):
        file._source_stamp = _stamp(Path(kernel.py_func.__code__.co_filename).parent)
    return kernel


def _stamp(own: Path) -> tuple[tuple[str, float, int], ...]:
    files = [file for folder in (Path(__file__).parent, own) for file in sorted(folder.glob("*.py"))]
    return tuple((f.name, f.stat().st_mtime, f.stat().st_size) for f in files)


class _Notice(event.Listener):
    """Prints one line at the first compilation of a process, if a person may read it."""

    said = False

    def on_start(self, event: Any) -> None:
        if not _Notice.said and sys.stderr is not None and sys.stderr.isatty():
            sys.stderr.write(NOTICE + "\n")
            sys.stderr.flush()
        _Notice.said = True

    def on_end(self, event: Any) -> None:
        pass


event.register("numba:compile", _Notice())  # type: ignore[no-untyped-call]
