"""Seconds by stage, taken from outside: functions are wrapped where they are called from; each counts its own time."""

from __future__ import annotations

import functools
import importlib
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any


class Stopwatch:
    """Wall seconds of labelled functions.

    `seconds` are exclusive: a function called within another is taken off the outer one. What other threads did in the
    meantime is in `beside`. `spans` holds when each call of a label began and ended.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.beside: dict[str, float] = defaultdict(float)
        self.spans: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self._main = threading.get_ident()
        self._local = threading.local()

    def reset(self) -> None:
        for kept in (self.seconds, self.beside, self.spans):
            kept.clear()

    def timed(self, label: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def wrapper(*args: Any, **kwargs: Any) -> Any:
            if not hasattr(self._local, "inner"):
                self._local.inner = [0.0]
            inner = self._local.inner
            inner.append(0.0)
            began = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                ended = time.perf_counter()
                kept = self.seconds if threading.get_ident() == self._main else self.beside
                kept[label] += ended - began - inner.pop()
                inner[-1] += ended - began
                self.spans[label].append((began, ended))

        return wrapper

    def wrap(self, label: str, module: str, name: str) -> bool:
        """Wrap `module.name`; False where there is no such function (any more)."""
        home = importlib.import_module(module)
        function = getattr(home, name, None)
        if function is None:
            return False
        setattr(home, name, self.timed(label, function))
        return True

    def covered(self, *labels: str) -> float:
        """Seconds during which at least one of these was running, in whatever thread."""
        total = reached = 0.0
        for began, ended in sorted(span for label in labels for span in self.spans[label]):
            total += max(0.0, ended - max(began, reached))
            reached = max(reached, ended)
        return total


class RayCounter:
    """Counts the rays that Roundel shoots."""

    def __init__(self) -> None:
        from roundel.render import radiance
        from roundel.render.backend import start

        start()  # before Dr.Jit is imported: it finds the libLLVM that works
        import drjit as dr

        self.rays = 0
        shoot = radiance.shoot

        def counted(*args: Any, **kwargs: Any) -> Any:
            out = shoot(*args, **kwargs)
            self.rays += dr.width(out[0].d.x)
            return out

        radiance.shoot = counted
