"""Seconds by stage, measured by wrapping functions where they are called; each counts its own time."""

from __future__ import annotations

import functools
import importlib
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np


class Stopwatch:
    """Wall seconds of labelled functions.

    `seconds` are exclusive: the time of a nested call is subtracted from the outer one. Time in other threads is in
    `beside`. `cpu` is the processor time of the calling threads. `spans` records when each call began and ended.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.beside: dict[str, float] = defaultdict(float)
        self.cpu: dict[str, float] = defaultdict(float)
        self.spans: dict[str, list[tuple[float, float]]] = defaultdict(list)
        self._main = threading.get_ident()
        self._local = threading.local()

    def reset(self) -> None:
        for kept in (self.seconds, self.beside, self.cpu, self.spans):
            kept.clear()

    def timed(self, label: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def wrapper(*args: Any, **kwargs: Any) -> Any:
            if not hasattr(self._local, "inner"):
                self._local.inner = [np.zeros(2)]
            inner = self._local.inner
            inner.append(np.zeros(2))
            began = np.array([time.perf_counter(), time.thread_time()])
            try:
                return function(*args, **kwargs)
            finally:
                took = np.array([time.perf_counter(), time.thread_time()]) - began
                wall, cpu = took - inner.pop()
                inner[-1] += took
                kept = self.seconds if threading.get_ident() == self._main else self.beside
                kept[label] += wall
                self.cpu[label] += cpu
                self.spans[label].append((began[0], began[0] + took[0]))

        return wrapper

    def wrap(self, label: str, module: str, name: str) -> bool:
        """Wrap `module.name`; False if there is no such function (any more)."""
        home = importlib.import_module(module)
        function = getattr(home, name, None)
        if function is None:
            return False
        setattr(home, name, self.timed(label, function))
        return True

    def covered(self, begin: float, end: float, *labels: str) -> float:
        """Seconds between two times during which at least one of these was running, in any thread."""
        total, reached = 0.0, begin
        for began, ended in sorted(span for label in labels for span in self.spans[label]):
            ended = min(ended, end)
            total += max(0.0, ended - max(began, reached))
            reached = max(reached, ended)
        return total


class RayCounter:
    """Counts the rays that Roundel shoots."""

    def __init__(self) -> None:
        from roundel.render import radiance
        from roundel.render.backend import start

        start()  # before Dr.Jit is imported, to find a working libLLVM
        import drjit as dr

        self.rays = 0
        shoot = radiance.shoot

        def counted(*args: Any, **kwargs: Any) -> Any:
            out = shoot(*args, **kwargs)
            self.rays += dr.width(out[0].d.x)
            return out

        radiance.shoot = counted
