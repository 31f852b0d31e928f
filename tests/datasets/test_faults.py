"""Faults of the disk at every write, sync, rename and open: one line, nothing half done, and the next run goes on."""

from __future__ import annotations

import errno
import io
import os
import pathlib
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from helpers_studies import digests, small_study

from roundel.datasets.merge import merge_datasets
from roundel.render.redevelop import develop_dataset
from roundel.render.run import render_study
from roundel.scenes.errors import RoundelError
from roundel.solver.methods.solve import solve_dataset
from roundel.validate.validate import validate_dataset


class Faults:
    """Counts the calls that change a file system; lets the `fail_at`-th fail.

    Attributes
    ----------
    count : int
        Calls so far.
    fail_at : int or None
        Which call fails; None for none.
    short : bool
        Whether a write that fails has written half of its bytes.
    number : int
        The error: a full disk, or a broken one.
    """

    def __init__(self, fail_at: int | None, number: int = errno.ENOSPC, short: bool = False) -> None:
        self.count, self.fail_at, self.number, self.short = 0, fail_at, number, short

    def fails(self) -> bool:
        """Count a call; whether it is the one that fails."""
        self.count += 1
        return self.count - 1 == self.fail_at

    def error(self) -> OSError:
        """The error."""
        return OSError(self.number, os.strerror(self.number))


class _File(io.BufferedWriter):
    """A file whose writes may fail."""

    faults: Faults

    def write(self, data: Any) -> int:
        if self.faults.fails():
            if self.faults.short:
                super().write(bytes(data)[: len(data) // 2])
                super().flush()
            raise self.faults.error()
        return super().write(data)


@contextmanager
def injected(faults: Faults) -> Iterator[Faults]:
    """Every open for writing, write, fsync, rename and folder made in this block counts, and one may fail."""
    patch = pytest.MonkeyPatch()
    opens, path_open, writes = os.open, pathlib.Path.open, os.write

    def open_(path: Any, flags: int, *more: Any, **keys: Any) -> int:
        if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT) and faults.fails():
            raise faults.error()
        return opens(path, flags, *more, **keys)

    def open_path(self: pathlib.Path, mode: str = "r", *more: Any, **keys: Any) -> Any:
        if mode != "xb":
            return path_open(self, mode, *more, **keys)
        if faults.fails():
            raise faults.error()
        file = _File(io.FileIO(self, "x"))
        file.faults = faults
        return file

    def write(descriptor: int, data: bytes) -> int:
        if faults.fails():
            if faults.short:
                writes(descriptor, data[: len(data) // 2])
            raise faults.error()
        return writes(descriptor, data)

    def counted(name: str) -> None:
        real = getattr(os, name)

        def call(*arguments: Any, **keys: Any) -> Any:
            if faults.fails():
                raise faults.error()
            return real(*arguments, **keys)

        patch.setattr(os, name, call)

    patch.setattr(os, "open", open_)
    patch.setattr(os, "write", write)
    patch.setattr(pathlib.Path, "open", open_path)
    for name in ("fsync", "replace", "mkdir"):
        counted(name)
    try:
        yield faults
    finally:
        patch.undo()


TINY = (
    ("width_px: 160, height_px: 120, focal_px: 320", "width_px: 64, height_px: 48, focal_px: 128"),
    ("offset_x_px: {uniform: [-20, 20]}", "offset_x_px: {uniform: [-5, 5]}"),
    ("band_samples: 256", "band_samples: 16"),
    ("frames: 4", "frames: 2"),
)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """The results of all commands, made without faults."""
    folder = tmp_path_factory.mktemp("made")
    study = small_study(folder, *TINY)
    (folder / "sensor.yaml").write_text("sensor: {full_well_e: 4000}\n")
    render_study(study, folder / "render")
    render_study(study, folder / "one", frames=range(1))
    render_study(study, folder / "two", frames=range(1, 2))
    for name, command in COMMANDS.items():
        command(folder, folder / name)
    return folder


# What each command reads of `made`, and the folder that it writes.
COMMANDS: dict[str, Callable[[Path, Path], object]] = {
    "render": lambda made, out: render_study(made / "study.yaml", out),
    "develop": lambda made, out: develop_dataset(made / "render", out, made / "sensor.yaml"),
    "merge": lambda made, out: merge_datasets([made / "one", made / "two"], out),
    "solve": lambda made, out: solve_dataset(made / "render", out, intrinsics=("true", "default")),
    "validate": lambda made, out: validate_dataset(made / "render", [made / "solve"], out),
}


def unchanged(folder: Path) -> dict[str, str]:
    """Checksums of all files but those with times in them."""
    return {name: value for name, value in digests(folder).items() if not name.endswith("timings.jsonl")}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["full", "full, half written", "broken"])
@pytest.mark.parametrize("name", list(COMMANDS))
def test_a_fault_at_every_call(made: Path, tmp_path: Path, name: str, kind: str) -> None:
    command, out = COMMANDS[name], tmp_path / "out"
    with injected(Faults(None)) as whole:
        command(made, out)
    right, counted = unchanged(out), whole.count
    assert right == unchanged(made / name)
    assert counted > 10
    for k in range(counted):
        shutil.rmtree(out)
        number = errno.EIO if kind == "broken" else errno.ENOSPC
        with injected(Faults(k, number, short="half" in kind)) as faults:
            try:
                command(made, out)
            except RoundelError as error:
                assert "\n" not in str(error)  # noqa: PT017 - most calls end so, some need not
            except OSError as error:
                pytest.fail(f"call {k}: {error!r} is not one line of Roundel's")
        assert faults.count > k
        command(made, out)
        assert unchanged(out) == right, f"call {k}"
