"""Find the libLLVM for Dr.Jit to load, or raise a clear error.

Dr.Jit loads libLLVM at run time. Version 15 kills the process (`Cannot select ... fminimum`), versions before 15 are
refused, 16 and newer work. The package `karellen-llvm-core` installs one in the environment; the user's own
`DRJIT_LIBLLVM_PATH` takes precedence.
"""

from __future__ import annotations

import ctypes.util
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path

from roundel.scenes.errors import BackendError

OLDEST_LLVM = 16
REMEDY = (
    f"install LLVM {OLDEST_LLVM} or newer (on Linux x86-64: pip install karellen-llvm-core) "
    "or set DRJIT_LIBLLVM_PATH to its libLLVM"
)
# The package puts its library in place when Python starts for the first time after the installation.
_UNFINISHED = (
    "karellen-llvm-core is installed, but not finished: whoever owns this environment has to start its Python once, "
    f"for example by {sys.executable} -c pass"
)


@dataclass(frozen=True)
class Llvm:
    """A libLLVM on disk; `source` is where it was found; `version` 0 means that the file name does not show it."""

    path: Path
    version: int
    source: str


def _version_of(path: Path) -> int:
    """Major version from the file's name, following links (libLLVM.so -> libLLVM.so.23.1)."""
    for name in (path.name, Path(os.path.realpath(path)).name):
        match = re.search(r"LLVM(?:-C)?[-.]?(?:so|dylib)?[.-]?(\d+)", name)
        if match:
            return int(match.group(1))
    return 0


def _candidates() -> list[tuple[Path, str]]:
    pattern = {"darwin": "libLLVM*.dylib", "win32": "LLVM*.dll"}.get(sys.platform, "libLLVM*.so*")
    found: list[tuple[Path, str]] = []
    environment = Path(sys.prefix)
    for folder in (environment / "lib", environment / "Lib", environment / "bin"):
        found += [(p, "the environment") for p in sorted(folder.glob(pattern), reverse=True)]
    system = [
        Path("/usr/lib"),
        Path("/usr/local/lib"),
        Path("/opt/homebrew/opt/llvm/lib"),
        Path("/usr/local/opt/llvm/lib"),
    ]
    system += sorted(Path("/usr/lib").glob("*-linux-gnu")) + sorted(Path("/usr/lib").glob("llvm-*/lib"))
    for folder in system:
        found += [(p, "the system") for p in sorted(folder.glob(pattern), reverse=True)]
    return found


def _is_unfinished() -> bool:
    """Whether the package with libLLVM waits for its first start, which others than its owner cannot complete."""
    packages = Path(sys.prefix).glob("lib/python*/site-packages/karellen_llvm_core-*.dist-info")
    return any(not (package / "axle.done").exists() for package in packages)


def find_llvm() -> Llvm:
    """The libLLVM for Dr.Jit to load.

    Raises
    ------
    BackendError
        If none works; the one-line message has the remedy.
    """
    chosen = os.environ.get("DRJIT_LIBLLVM_PATH")
    if chosen:
        path = Path(chosen)
        if not path.exists() and ctypes.util.find_library(chosen) is None:
            raise BackendError(f"DRJIT_LIBLLVM_PATH: no such file: {chosen}; {REMEDY}")
        version = _version_of(path)
        if 0 < version < OLDEST_LLVM:
            raise BackendError(f"DRJIT_LIBLLVM_PATH: LLVM {version} does not work with Dr.Jit; {REMEDY}")
        return Llvm(path, version, "DRJIT_LIBLLVM_PATH")
    usable: list[Llvm] = []
    for path, source in _candidates():
        version = _version_of(path)
        # The environment's own is known to work; others must show a suitable version in their name.
        if version >= OLDEST_LLVM or (version == 0 and source == "the environment"):
            usable.append(Llvm(path, version, source))
    if not usable:
        raise BackendError(f"no usable LLVM found; {_UNFINISHED if _is_unfinished() else REMEDY}")
    ours = [llvm for llvm in usable if llvm.source == "the environment"]
    return ours[0] if ours else max(usable, key=lambda llvm: llvm.version)


def simd_width() -> int:
    """Number of float32 lanes of the widest vector registers that this processor offers to LLVM."""
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("flags", 1)[1].split("\n", 1)[0]
    except (OSError, IndexError):
        flags = ""
    return 16 if "avx512f" in flags else 8 if "avx2" in flags or "avx" in flags else 4
