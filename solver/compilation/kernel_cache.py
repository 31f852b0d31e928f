"""Where compiled kernels are kept on disk: Numba's cache, valid for all sources that a kernel may be made of."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys

from roundel.solver.compilation.first_compilation import compiled_elsewhere, start_compilation

_known: list[KernelCache] = []


class KernelCache(FunctionCache):
    """Numba's cache of one function.

    Numba compares only the function's own file with the cached one. Kernels call each other across files, so the stamp
    of all files of the function's folder and of the `shared` one takes its place.

    Raises
    ------
    RuntimeError
        If no folder for a cache can be written.
    """

    def __init__(self, function: Callable[..., Any], shared: Path) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        self._module = function.__module__
        self._cache_file._source_stamp = source_stamp(shared, Path(function.__code__.co_filename).parent)
        _known.append(self)

    @property
    def empty(self) -> bool:
        """Whether nothing that is valid is cached."""
        try:
            return not self._cache_file._load_index()  # type: ignore[no-untyped-call]
        except Exception:  # a damaged file: see `_loaded`
            return True

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function from disk, or None if this process has to compile it."""
        found = self._loaded(sig, target_context)
        if found is not None or _Depth.compilations:
            return found
        start_compilation(sum(other.empty for other in _known) > len(_known) // 2)
        elsewhere = True
        while found is None and elsewhere:
            elsewhere = compiled_elsewhere(self._module)
            found = self._loaded(sig, target_context)
        return found

    def _loaded(self, sig: Any, target_context: Any) -> Any:
        # Numba's own method first imports all that it can compile, SciPy's linear algebra included. A kernel that is
        # only loaded needs none of it: that would take 0.2 s of each process.
        try:
            rtsys.initialize(target_context)
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception:  # damaged or of another installation, it is compiled again
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the compiled function to disk; if that fails, the next process compiles it again."""
        for _ in range(2):
            try:
                super().save_overload(sig, data)  # type: ignore[no-untyped-call]
            except OSError:
                return
            except Exception:  # the index is damaged: a new one
                with suppress(OSError):
                    self.flush()  # type: ignore[no-untyped-call]
            else:
                return


class _Depth(event.Listener):
    """How many compilations are under way: kernels that are called by other kernels are compiled in the middle."""

    compilations = 0

    def on_start(self, event: Any) -> None:
        _Depth.compilations += 1

    def on_end(self, event: Any) -> None:
        _Depth.compilations -= 1


event.register("numba:compile", _Depth())  # type: ignore[no-untyped-call]


@cache
def source_stamp(*folders: Path) -> tuple[tuple[str, float, int], ...]:
    """Name, time and size of all sources in some folders."""
    files = [file for folder in folders for file in sorted(folder.glob("*.py"))]
    return tuple((f.name, f.stat().st_mtime, f.stat().st_size) for f in files)
