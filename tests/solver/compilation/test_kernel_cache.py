"""The cache of compiled kernels: loaded in later processes, never stale, and no kernel compiled twice."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from roundel.solver.compilation import first_compilation

# Prints the kernels that Numba compiles on request of Python, not in the middle of another one.
LISTENER = """
import json, sys
from numba.core import event
names, depth = [], 0
class Listener(event.Listener):
    def on_start(self, event):
        global depth
        if depth == 0:
            function = event.data["dispatcher"].py_func
            names.append(f"{function.__module__}.{function.__name__}")
        depth += 1
    def on_end(self, event):
        global depth
        depth -= 1
event.register("numba:compile", Listener())
"""
LOCATE = """
from roundel.solver.methods.compilation_shares import drawn_disc
import roundel
assert len(roundel.locate(drawn_disc(), 1.0)) == 1
print(json.dumps(names))
"""
SCENARIO = """
import sys
import cv2
import numpy as np
import roundel
from numba.core import types
from numba.core.dispatcher import Dispatcher
from roundel.solver.methods.compilation_shares import drawn_disc

disc = drawn_disc()
level = disc.astype(np.float64)
light = (level / 255.0).astype(np.float32)
light.setflags(write=False)
noisy = np.random.default_rng(1).normal(level, 20.0)
shadow = np.where(np.arange(disc.shape[1]) < 60, level * 0.5, level)
saturated = np.minimum(level * 1.6, 255.0)
for image in (disc, np.dstack([disc] * 3), 255 - disc, disc[:, 40:], noisy, shadow, saturated):
    roundel.locate(np.clip(image, 0, 255).astype(np.uint8), 1.0)
for image in (light, np.asfortranarray(level), disc.astype(np.uint16) * 200):
    roundel.locate(image, 1.0, curve="linear")
roundel.locate(cv2.GaussianBlur(level, (0, 0), 4.0).astype(np.uint8), 1.0)
roundel.locate(np.kron(disc, np.ones((8, 8), np.uint8)), 1.0)
for method in ("ml", "guaranteed", "direct", "edgedrawing"):
    roundel.locate(disc, 1.0, method=method)
tracker = roundel.Tracker(1.0)
for k in range(4):
    tracker.update(np.roll(disc, k, axis=1), k / 30.0)

# A variable that starts as a constant has the constant's type first: a small kernel is then compiled for it, too.
def types_of(kernel):
    return {tuple(types.unliteral(t) for t in overload) for overload in kernel.overloads}

modules = [module for name, module in list(sys.modules.items()) if name.startswith("roundel.solver")]
kernels = {id(v): v for m in modules for v in vars(m).values() if isinstance(v, Dispatcher)}.values()
assert len(kernels) > 50
twice = {f"{k.py_func.__module__}.{k.py_func.__name__}": types_of(k) for k in kernels if len(types_of(k)) > 1}
assert not twice, twice
"""
KERNELS = {
    "one.py": "from roundel.solver.kernels.compiled import compiled\n\n\n@compiled\ndef one(x):\n    return x + 1.0\n",
    "two.py": "from one import one\n\nfrom roundel.solver.kernels.compiled import compiled\n\n\n"
    "@compiled\ndef two(x):\n    return 2.0 * one(x)\n",
}
CALL = "from roundel.solver.compilation.first_compilation import compile_alone; compile_alone()\nfrom two import two\n"


def run(script: str, folder: Path | None = None, cache: Path | None = None, seconds: int = 300) -> str:
    environment = dict(os.environ)
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    if folder is not None:
        script = f"import sys; sys.path.insert(0, {str(folder)!r})\n{script}"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=seconds, env=environment
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_later_process_compiles_nothing() -> None:
    run(LISTENER + LOCATE)  # compiles, if this is the first process
    assert json.loads(run(LISTENER + LOCATE)) == []


def test_a_later_process_imports_nothing_heavy_beside_numba_and_opencv() -> None:
    run(LISTENER + LOCATE)
    script = "heavy = {'scipy.linalg', 'scipy.special', 'scipy.fft', 'pyarrow', 'mitsuba', 'matplotlib'}\n"
    run(LISTENER + LOCATE + script + "assert not heavy & set(sys.modules), heavy & set(sys.modules)")


def test_no_kernel_is_compiled_for_a_second_type() -> None:
    run(SCENARIO)  # in a process of its own: tests call kernels with other types


def test_a_change_in_another_file_compiles_again(tmp_path: Path) -> None:
    for name, text in KERNELS.items():
        (tmp_path / name).write_text(text)
    call = CALL + "print(two(3.0))"
    assert run(call, tmp_path, tmp_path / "cache").strip() == "8.0"
    assert json.loads(run(LISTENER + CALL + "two(3.0); print(json.dumps(names))", tmp_path, tmp_path / "cache")) == []
    (tmp_path / "one.py").write_text(KERNELS["one.py"].replace("1.0", "10.0"))
    assert run(call, tmp_path, tmp_path / "cache").strip() == "26.0"


@pytest.mark.parametrize("ending", [".nbi", ".nbc"])
def test_a_damaged_cache_is_replaced(tmp_path: Path, ending: str) -> None:
    for name, text in KERNELS.items():
        (tmp_path / name).write_text(text)
    names = LISTENER + CALL + "assert two(3.0) == 8.0; print(json.dumps(names))"
    run(names, tmp_path, tmp_path / "cache")
    files = list((tmp_path / "cache").rglob(f"two*{ending}"))
    assert files
    for file in files:
        file.write_bytes(file.read_bytes()[:40])
    assert json.loads(run(names, tmp_path, tmp_path / "cache")) == ["two.two"]
    assert json.loads(run(names, tmp_path, tmp_path / "cache")) == []


def test_a_folder_that_cannot_be_written_is_no_failure(tmp_path: Path) -> None:
    for name, text in KERNELS.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "cache").write_text("a file where a folder should be")
    assert run(CALL + "print(two(3.0))", tmp_path, tmp_path / "cache").strip() == "8.0"


@pytest.mark.slow  # compiles everything
def test_the_shares_of_other_processes_leave_only_detection(tmp_path: Path) -> None:
    for name in first_compilation._SHARES:
        run(first_compilation._PROGRAM.format(path=sys.path, shares=(name,)), cache=tmp_path)
    alone = "from roundel.solver.compilation.first_compilation import compile_alone; compile_alone()\n"
    left = json.loads(run(LISTENER + alone + LOCATE, cache=tmp_path))
    assert left
    assert [name for name in left if not name.startswith("roundel.solver.detect.")] == []
