"""Find an NVIDIA GPU that can trace rays, or raise an error that says what is missing.

Dr.Jit loads two libraries of the NVIDIA driver at run time: `libcuda`, and `libnvoptix` to intersect rays with a scene.
Both are tried here first, with the same names, because Dr.Jit reports their absence only after the fact.
"""

from __future__ import annotations

import ctypes
import os
import sys
from dataclasses import dataclass

from roundel.scenes.errors import BackendError, first_line

# What always helps; the last words of every message.
INSTEAD = "or render with --backend llvm, which needs no GPU"

# Dr.Jit 1.5 disables its CUDA backend below this version of the driver's interface; OptiX 8 needs the same driver.
OLDEST_CUDA = (12, 2)
OLDEST_DRIVER = 535

# Names by platform of the driver's library and of its ray tracer. Windows finds the latter by the registry.
_LIBRARIES = {"linux": ("libcuda.so.1", "libnvoptix.so.1"), "win32": ("nvcuda.dll", None)}


@dataclass(frozen=True)
class Gpu:
    """The GPU that Dr.Jit uses: the driver's first; `cuda` is the version of its interface."""

    name: str
    cuda: tuple[int, int]


def _load(variable: str, name: str, remedy: str) -> ctypes.CDLL:
    """A library of the driver, by the user's own path if `variable` is set; Dr.Jit then loads the same."""
    chosen = os.environ.get(variable) or name
    try:
        library = ctypes.CDLL(chosen)
    except OSError as error:
        raise BackendError(f"--backend cuda: {first_line(error)}; {remedy}") from error
    # By itself Dr.Jit looks for `libcuda.so`, a name that many installations without a toolkit do not have.
    os.environ[variable] = chosen
    return library


def find_gpu() -> Gpu:
    """The GPU for Dr.Jit to use; call it before Dr.Jit is imported, which then loads the libraries found here.

    Raises
    ------
    BackendError
        If there is no driver, no GPU, or no ray tracer, or if the driver is too old; one line with the remedy.
    """
    names = _LIBRARIES.get(sys.platform)
    if names is None:
        raise BackendError(f"--backend cuda: there is no NVIDIA driver for {sys.platform}, {INSTEAD}")
    libcuda, liboptix = names
    driver = _load(
        "DRJIT_LIBCUDA_PATH",
        libcuda,
        f"install the NVIDIA driver, release {OLDEST_DRIVER} or newer, or set DRJIT_LIBCUDA_PATH to its libcuda, "
        f"{INSTEAD}",
    )
    status = driver.cuInit(0)
    count = ctypes.c_int(0)
    if status == 0:
        status = driver.cuDeviceGetCount(ctypes.byref(count))
    if status != 0 or count.value == 0:
        raise BackendError(
            f"--backend cuda: the NVIDIA driver finds no usable GPU (status {status}); check `nvidia-smi` and "
            f"CUDA_VISIBLE_DEVICES, in a container pass the GPU to it, {INSTEAD}"
        )
    version = ctypes.c_int(0)
    driver.cuDriverGetVersion(ctypes.byref(version))
    cuda = (version.value // 1000, version.value % 1000 // 10)
    if cuda < OLDEST_CUDA:
        raise BackendError(
            f"--backend cuda: the NVIDIA driver offers CUDA {cuda[0]}.{cuda[1]}, {OLDEST_CUDA[0]}.{OLDEST_CUDA[1]} is "
            f"needed; install release {OLDEST_DRIVER} or newer, {INSTEAD}"
        )
    if liboptix is not None:
        _load(
            "DRJIT_LIBOPTIX_PATH",
            liboptix,
            "OptiX comes with the NVIDIA driver; in a container set "
            f"NVIDIA_DRIVER_CAPABILITIES=compute,utility,graphics, or set DRJIT_LIBOPTIX_PATH to it, {INSTEAD}",
        )
    return Gpu(_name_of(driver), cuda)


def _name_of(driver: ctypes.CDLL) -> str:
    device = ctypes.c_int(0)
    driver.cuDeviceGet(ctypes.byref(device), 0)
    buffer = ctypes.create_string_buffer(256)
    driver.cuDeviceGetName(buffer, len(buffer), device)
    return buffer.value.decode(errors="replace")
