"""Choose between processor (LLVM) and GPU (CUDA) and start Mitsuba once, or raise a clear error."""

from __future__ import annotations

import os
from typing import Any

from roundel.datasets.layout.masks import RENDERING_VERSION
from roundel.render.cuda import find_gpu
from roundel.render.llvm import REMEDY, find_llvm, simd_width
from roundel.scenes.errors import BackendError, UsageError, first_line
from roundel.scenes.world.frame import Frame

# LLVM is the default because its frames are bit-identical on every run; see docs/decisions/014-backends.md.
DEFAULT_BACKEND = "llvm"
BACKENDS = ("llvm", "cuda", "auto")
DEFAULT_VARIANT = "llvm_ad_mono"

# Raised when the same packages make other bytes of a frame: 2, depth is that of one surface in each pixel.
_RENDERING = 2

# Variants with the ink plugin registered: each variant has its own plugins.
_with_ink: set[str] = set()


def choose_backend(asked: str) -> str:
    """The backend to render with, `llvm` or `cuda`: `auto` is `cuda` where a GPU is usable, else `llvm`.

    Raises
    ------
    UsageError
        If there is no such backend.
    BackendError
        If `cuda` is asked for and no GPU is usable; the message has the remedy.
    """
    if asked not in BACKENDS:
        raise UsageError(f"backend {asked!r}: use {', '.join(BACKENDS[:-1])} or {BACKENDS[-1]}")
    if asked == "llvm":
        return asked
    try:
        find_gpu()
    except BackendError:
        if asked == "cuda":
            raise
        return "llvm"
    return "cuda"


def start(variant: str = DEFAULT_VARIANT, threads: int | None = None) -> Any:
    """Import Mitsuba on `variant`, with the libraries that Dr.Jit loads found first, and return the module.

    Parameters
    ----------
    variant : str
        A Mitsuba variant: `llvm_ad_mono`, `llvm_ad_rgb`, `cuda_ad_mono` or `cuda_ad_rgb`.
    threads : int, optional
        Threads of the processor; the images do not depend on it.

    Raises
    ------
    BackendError
        If LLVM, the GPU, the variant, or a library of the system is missing.
    """
    on_gpu = variant.startswith("cuda")
    if on_gpu:
        find_gpu()
    try:
        # Dr.Jit looks for LLVM when it is imported, on a GPU too: a process may change from one to the other.
        os.environ["DRJIT_LIBLLVM_PATH"] = str(find_llvm().path)
    except BackendError:
        if not on_gpu:
            raise
    try:
        import mitsuba as mi
    except (ImportError, NameError) as error:
        raise BackendError(_why_not_loaded(error)) from error
    if variant not in mi.variants():
        raise BackendError(f"Mitsuba has no variant {variant!r}; it has {', '.join(mi.variants())}")
    if mi.variant() != variant:
        remedy = "render with --backend llvm" if on_gpu else REMEDY
        try:
            mi.set_variant(variant)
        except (ImportError, RuntimeError) as error:
            raise BackendError(f"Mitsuba cannot start {variant}: {first_line(error)}; {remedy}") from error
    if variant not in _with_ink:
        from roundel.render.scene.ink import register_ink

        register_ink(mi)
        _with_ink.add(variant)
    if threads is not None:
        import drjit as dr
        import OpenEXR

        dr.set_thread_count(threads)
        OpenEXR.set_global_thread_count(threads)
    return mi


def _why_not_loaded(error: ImportError | NameError) -> str:
    """What is missing, and the remedy. Dr.Jit 1.5 stumbles over its own message: the reason is that error's context."""
    reason = first_line(error.__context__ or error)
    remedy = "pip install --force-reinstall mitsuba drjit"
    if "libatomic" in reason:  # missing in slim images of containers
        remedy = "install it (Debian, Ubuntu: apt-get install libatomic1; Fedora: dnf install libatomic)"
    return f"the renderer does not load: {reason}; {remedy}"


def variant_of(frame: Frame, backend: str = DEFAULT_BACKEND) -> str:
    """The variant a frame needs: of `backend`, with colours if a mosaic or a sky requires them."""
    from roundel.render.scene.lights import needs_colour

    return f"{backend}_ad_{'rgb' if needs_colour(frame) else 'mono'}"


def environment(backend: str = DEFAULT_BACKEND) -> dict[str, Any]:
    """What the last bits of a rendered pixel depend on besides the packages.

    Returns
    -------
    dict
        `variant`, that of frames without colours, and `rendering_version`; with them `llvm` and `simd_width`, or `gpu`,
        its `compute_capability` and the version of the driver's interface, `cuda`.
    """
    variant = f"{backend}_ad_mono"
    start(variant)
    import drjit as dr

    if backend == "cuda":
        gpu = find_gpu()
        return {
            "variant": variant,
            RENDERING_VERSION: _RENDERING,
            "gpu": gpu.name,
            "compute_capability": int(dr.detail.cuda_compute_capability()),
            "cuda": f"{gpu.cuda[0]}.{gpu.cuda[1]}",
        }
    return {
        "variant": variant,
        RENDERING_VERSION: _RENDERING,
        "llvm": ".".join(str(v) for v in dr.detail.llvm_version()),
        "simd_width": simd_width(),
    }
