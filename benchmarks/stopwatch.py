"""Seconds by stage, taken from outside: functions are wrapped where they are called from; each counts its own time."""

from __future__ import annotations

import functools
import importlib
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any


class Stopwatch:
    """Exclusive wall seconds of labelled functions; a function called within another is taken off the outer one."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._inner = [0.0]

    def reset(self) -> None:
        self.seconds.clear()
        self._inner = [0.0]

    def timed(self, label: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def wrapper(*args: Any, **kwargs: Any) -> Any:
            self._inner.append(0.0)
            began = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.perf_counter() - began
                self.seconds[label] += took - self._inner.pop()
                self._inner[-1] += took

        return wrapper

    def wrap(self, label: str, module: str, name: str) -> bool:
        """Wrap `module.name`; False where there is no such function (any more)."""
        home = importlib.import_module(module)
        function = getattr(home, name, None)
        if function is None:
            return False
        setattr(home, name, self.timed(label, function))
        return True


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
