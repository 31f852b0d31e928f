"""What made a frame: the renderer and the versions of the packages that its bytes depend on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import metadata
from typing import Any

from roundel.scenes.errors import DataError

_PACKAGES = (
    "roundel",
    "mitsuba",
    "drjit",
    "numpy",
    "scipy",
    "opencv-contrib-python-headless",
    "pillow",
    "OpenEXR",
    "trimesh",
    "pyarrow",
)

# `environment` of the renderer, and `versions` of the packages.
Environment = dict[str, Any]

# That of frames of which no record tells.
UNKNOWN: Environment = {"environment": {}, "versions": {}}


@cache
def _versions() -> tuple[tuple[str, str], ...]:
    found = []
    for package in _PACKAGES:
        try:
            found.append((package, metadata.version(package)))
        except metadata.PackageNotFoundError:
            continue
    return tuple(found)


def versions() -> dict[str, str]:
    """Installed versions of the packages that the bytes of a dataset depend on."""
    return dict(_versions())


def environment_of(renderer: dict[str, Any]) -> Environment:
    """The environment of this process; `renderer` is that of `render.backend.environment`."""
    return {"environment": renderer, "versions": versions()}


def key_of(environment: Environment) -> str:
    """Sixteen digits that stand for an environment in the journal."""
    text = json.dumps(environment, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def cache_key(dataset_id: str) -> str:
    """A name for a rendered dataset that changes with its study, with Roundel's version and with the packages.

    It tells no processors apart: a finished dataset is valid on all of them.
    """
    return f"roundel-{versions()['roundel']}-{dataset_id[:12]}-{key_of(environment_of({}))[:8]}"


def _difference(one: Environment, other: Environment) -> str:
    """The first thing in which two environments differ, as text: `mitsuba 3.9.1, not 3.9.2`."""
    for part in ("versions", "environment"):
        a, b = one.get(part, {}), other.get(part, {})
        for name in sorted({*a, *b}):
            if a.get(name) != b.get(name):
                return f"{name.replace('_', ' ')} {a.get(name, 'none')}, not {b.get(name, 'none')}"
    return "a version that is not recorded"


def check_one_environment(
    place: str,
    frames: Iterable[tuple[int, str | None]],
    own: Environment,
    known: Mapping[str, Environment],
) -> None:
    """Refuse to put frames of several environments into one dataset: their bytes may differ in the last bits.

    Parameters
    ----------
    place : str
        The dataset, for the message.
    frames : iterable of (frame_id, key)
        Frames that exist, and what made them.
    own : dict
        The environment that goes on.
    known : mapping
        Environments by key.

    Raises
    ------
    DataError
        If a frame is of another one; it names the frames, the difference, and what to do.
    """
    key = key_of(own)
    others = [(frame_id, its) for frame_id, its in sorted(frames) if its is not None and its != key]
    if not others:
        return
    first, its = others[0]
    number = f"frame {first}" if len(others) == 1 else f"frames {_runs([i for i, _ in others])}"
    raise DataError(
        f"{place}: {number} were made by another environment ({_difference(known.get(its, {}), own)}); go on with "
        "that one, render into another folder, or mix them with --mix-environments"
    )


def _runs(ids: list[int]) -> str:
    """Frame ids as text, runs joined: `3-7, 12`; at most five runs."""
    runs: list[list[int]] = []
    for i in ids:
        if runs and runs[-1][1] == i - 1:
            runs[-1][1] = i
        else:
            runs.append([i, i])
    shown = ", ".join(f"{a}-{b}" if a < b else str(a) for a, b in runs[:5])
    return shown + (f" and {sum(b - a + 1 for a, b in runs[5:])} more" if len(runs) > 5 else "")
