"""Deliver KeyboardInterrupt even when the renderer swallows it, and for each signal that asks a program to end.

KeyboardInterrupt may be raised inside a plug-in called by the renderer. It then arrives as an error of the renderer, or
not at all. Therefore the signal is recorded, and checked between frames.
"""

from __future__ import annotations

import signal
import threading

_seen: list[int] = []


def _remember(number: int, frame: object) -> None:
    _seen.append(number)
    raise KeyboardInterrupt


def watch() -> None:
    """Record Ctrl-C from now on, and TERM and HUP like it; they raise KeyboardInterrupt."""
    _seen.clear()
    if threading.current_thread() is not threading.main_thread():
        return  # Python sets handlers in the main thread alone
    # Not if other code (a notebook, a test runner, nohup) handles or ignores the signal.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _remember)
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _remember)


def was_interrupted() -> bool:
    """Whether Ctrl-C was pressed since `watch`."""
    return bool(_seen)


def stop_if_interrupted() -> None:
    """Raise the KeyboardInterrupt that the renderer swallowed, if any."""
    if _seen:
        raise KeyboardInterrupt
