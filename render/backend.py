"""Find LLVM and start Mitsuba once, or raise a clear error.

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
from typing import Any

from roundel.scenes.errors import RoundelError, first_line
from roundel.scenes.world.frame import Frame

DEFAULT_VARIANT = "llvm_ad_mono"
OLDEST_LLVM = 16
_REMEDY = (
    f"install LLVM {OLDEST_LLVM} or newer (on Linux x86-64: pip install karellen-llvm-core) "
    "or set DRJIT_LIBLLVM_PATH to its libLLVM"
)


# Variants with the ink plugin registered: each variant has its own plugins.
_with_ink: set[str] = set()


class BackendError(RoundelError):
    """The renderer cannot start; the message names the remedy."""

    exit_code = 4


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
            raise BackendError(f"DRJIT_LIBLLVM_PATH: no such file: {chosen}; {_REMEDY}")
        version = _version_of(path)
        if 0 < version < OLDEST_LLVM:
            raise BackendError(f"DRJIT_LIBLLVM_PATH: LLVM {version} does not work with Dr.Jit; {_REMEDY}")
        return Llvm(path, version, "DRJIT_LIBLLVM_PATH")
    usable: list[Llvm] = []
    for path, source in _candidates():
        version = _version_of(path)
        # The environment's own is known to work; others must show a suitable version in their name.
        if version >= OLDEST_LLVM or (version == 0 and source == "the environment"):
            usable.append(Llvm(path, version, source))
    if not usable:
        raise BackendError(f"no usable LLVM found; {_REMEDY}")
    ours = [llvm for llvm in usable if llvm.source == "the environment"]
    return ours[0] if ours else max(usable, key=lambda llvm: llvm.version)


def start(variant: str = DEFAULT_VARIANT, threads: int | None = None) -> Any:
    """Import Mitsuba on `variant`, with LLVM found first, and return the module.

    Parameters
    ----------
    variant : str
        A Mitsuba variant; `cuda_ad_mono` is optional.
    threads : int, optional
        Threads of the CPU backend; the images do not depend on it.

    Raises
    ------
    BackendError
        If LLVM or the variant is missing.
    """
    if variant.startswith("llvm"):
        os.environ["DRJIT_LIBLLVM_PATH"] = str(find_llvm().path)
    import mitsuba as mi

    if variant not in mi.variants():
        raise BackendError(f"Mitsuba has no variant {variant!r}; it has {', '.join(mi.variants())}")
    if mi.variant() != variant:
        try:
            mi.set_variant(variant)
        except (ImportError, RuntimeError) as error:
            raise BackendError(f"Mitsuba cannot start {variant}: {first_line(error)}; {_REMEDY}") from error
    if variant not in _with_ink:
        from roundel.render.scene.ink import register_ink

        register_ink(mi)
        _with_ink.add(variant)
    if threads is not None:
        import drjit as dr

        dr.set_thread_count(threads)
    return mi


def variant_of(frame: Frame, variant: str = DEFAULT_VARIANT) -> str:
    """The variant a frame needs: `variant`, with colours if a mosaic or a sky requires them."""
    from roundel.render.scene.lights import needs_colour

    return variant.replace("_mono", "_rgb") if needs_colour(frame) else variant


def environment(variant: str = DEFAULT_VARIANT) -> dict[str, Any]:
    """What the last bits of a rendered pixel depend on besides the packages: variant, LLVM, vector width."""
    start(variant)
    import drjit as dr

    record: dict[str, Any] = {"variant": variant}
    if variant.startswith("llvm"):
        record["llvm"] = ".".join(str(v) for v in dr.detail.llvm_version())
        record["simd_width"] = simd_width()
    return record


def simd_width() -> int:
    """Number of float32 lanes of the widest vector registers that this processor offers to LLVM."""
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("flags", 1)[1].split("\n", 1)[0]
    except (OSError, IndexError):
        flags = ""
    return 16 if "avx512f" in flags else 8 if "avx2" in flags or "avx" in flags else 4
