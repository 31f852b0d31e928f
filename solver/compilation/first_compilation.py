"""The first compilation after an installation: a word to the user, and other processes that compile a share of it.

Numba compiles one function at a time. While this process compiles the kernels of detection, which are needed first,
others compile those of the fits, by running them, and leave them in the cache. If they fail, this process compiles all.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

NOTICE = "roundel: compiling the solver's inner loops, once after an installation (about half a minute)"

_OWN = "roundel.solver.detect."  # its kernels are compiled by this process
_SHARES = ("fits", "contours", "levels")  # the longest first
_PROGRAM = (
    "import sys; sys.path[:] = {path!r}; "
    "from roundel.solver.methods.compilation_shares import compile_shares; compile_shares({shares!r})"
)
_POLL_S = 0.05
_LONGEST_S = 120.0  # a share takes 10 s on a quiet machine


@dataclass
class _State:
    """What this process has begun."""

    begun: bool = False
    others: list[subprocess.Popen[bytes]] = field(default_factory=list)
    until_s: float = 0.0


_state = _State()


def start_compilation(much: bool) -> None:
    """Tell the user, and start other processes if there is much to compile; only the first call does anything."""
    if _state.begun:
        return
    _state.begun = True
    if sys.stderr is not None and sys.stderr.isatty():
        sys.stderr.write(NOTICE + "\n")
        sys.stderr.flush()
    else:
        logging.getLogger("roundel").info(NOTICE)
    if much and (os.cpu_count() or 1) > 1 and _is_python():
        _state.until_s = time.monotonic() + _LONGEST_S
        # Two of them use two cores well: this process waits for them in the end.
        number = min(max((os.cpu_count() or 1) - 1, 2), len(_SHARES))
        _state.others = [other for i in range(number) if (other := _started(_SHARES[i::number]))]


def compile_alone() -> None:
    """Let this process compile what it needs, without a word and without others."""
    _state.begun = True


def compiled_elsewhere(module: str) -> bool:
    """Wait a little for a kernel of a module; False if no other process may be compiling it."""
    if module.startswith(_OWN) or time.monotonic() > _state.until_s:
        return False
    if all(other.poll() is not None for other in _state.others):
        return False
    time.sleep(_POLL_S)
    return True


def _is_python() -> bool:
    # In an application with Python inside, `sys.executable` is the application.
    return not getattr(sys, "frozen", False) and Path(sys.executable or "").name.lower().startswith("python")


def _started(shares: tuple[str, ...]) -> subprocess.Popen[bytes] | None:
    program = _PROGRAM.format(path=sys.path, shares=shares)
    silent = subprocess.DEVNULL
    hidden = getattr(subprocess, "CREATE_NO_WINDOW", 0)  # Windows would open a console
    try:
        return subprocess.Popen(
            [sys.executable, "-c", program], stdin=silent, stdout=silent, stderr=silent, creationflags=hidden
        )
    except OSError:
        return None
