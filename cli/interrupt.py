"""Deliver KeyboardInterrupt even when the renderer swallows it.

KeyboardInterrupt may be raised inside a plugin that the renderer was calling. It then comes back as an error of the
renderer, or not at all. So the signal is remembered, and looked for between frames.
"""

from __future__ import annotations

import signal
import threading

_seen: list[int] = []


def _remember(number: int, frame: object) -> None:
    _seen.append(number)
    raise KeyboardInterrupt


def watch() -> None:
    """Remember Ctrl-C from now on; it raises KeyboardInterrupt as always."""
    _seen.clear()
    # Not where somebody else (a notebook, a test runner) handles it, nor off the main thread, where it cannot be.
    if (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    ):
        signal.signal(signal.SIGINT, _remember)


def was_interrupted() -> bool:
    """Whether Ctrl-C came since `watch`."""
    return bool(_seen)


def stop_if_interrupted() -> None:
    """Raise the KeyboardInterrupt that went astray, if there was one."""
    if _seen:
        raise KeyboardInterrupt
