"""Deliver KeyboardInterrupt even when the renderer swallows it.

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
    """Record Ctrl-C from now on; it still raises KeyboardInterrupt."""
    _seen.clear()
    # Not if other code (a notebook, a test runner) handles the signal, and only in the main thread, as Python requires.
    if (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    ):
        signal.signal(signal.SIGINT, _remember)


def was_interrupted() -> bool:
    """Whether Ctrl-C was pressed since `watch`."""
    return bool(_seen)


def stop_if_interrupted() -> None:
    """Raise the KeyboardInterrupt that the renderer swallowed, if any."""
    if _seen:
        raise KeyboardInterrupt
