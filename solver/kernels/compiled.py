"""`compiled`: compile a function with Numba once, and keep the result on disk."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.dispatcher import Dispatcher

from roundel.solver.compilation.kernel_cache import KernelCache

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """A function compiled at its first call; later processes load it from Numba's cache.

    Parameters
    ----------
    function : callable
        Of scalars and arrays only; it holds no lock while it runs (`nogil`), and divides by zero as NumPy does.

    Returns
    -------
    callable
        With the same signature.
    """
    return _kernel(function)


def compiled_sums(function: Function) -> Function:
    """As `compiled`, for long sums alone: their terms are added in the order that suits the processor's vectors."""
    return _kernel(function, fastmath={"reassoc"})


def _kernel(function: Function, **options: Any) -> Function:
    # Nobody takes the address of a kernel: without the wrapper for C it compiles a little faster.
    njit: Any = numba.njit
    kernel = njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    if isinstance(kernel, Dispatcher):  # not if NUMBA_DISABLE_JIT is set
        with suppress(RuntimeError):  # no folder can be written: every process compiles what it needs
            kernel._cache = KernelCache(function, Path(__file__).parent)  # type: ignore[attr-defined]
    found: Function = kernel
    return found
