"""`roundel doctor`: installed versions, the backend, and missing packages."""

from __future__ import annotations

import os
import platform
from importlib import metadata

from roundel.scenes.errors import first_line

_PACKAGES = (
    "mitsuba",
    "trimesh",
    "drjit",
    "karellen-llvm-core",
    "numpy",
    "scipy",
    "opencv-contrib-python-headless",
    "OpenEXR",
    "PyYAML",
    "pydantic",
    "pyarrow",
    "matplotlib",
    "jinja2",
    "rich",
    "pillow",
)


def _ximgproc() -> str | None:
    """The problem with OpenCV's extra modules, or None."""
    try:
        import cv2
    except ImportError as error:
        return f"OpenCV does not load: {error}; pip install opencv-contrib-python-headless"
    if not hasattr(cv2, "ximgproc") or not hasattr(cv2.ximgproc, "createEdgeDrawing"):
        return (
            "this OpenCV has no ximgproc: pip uninstall opencv-python*, then pip install opencv-contrib-python-headless"
        )
    return None


def _works(variant: str) -> str | None:
    """Start a variant, add numbers and meet a surface with a ray: the problem, or None."""
    from roundel.render.backend import start

    mi = start(variant)
    import drjit as dr

    total = dr.sum(dr.square(dr.arange(mi.Float, 1000)))
    # The error of a float32 sum of a thousand terms is at most a thousand ulps.
    if abs(float(total[0]) / 332_833_500.0 - 1) > 1e-4:
        return "the renderer computes wrong sums; reinstall drjit and mitsuba"
    scene = mi.load_dict({"type": "scene", "square": {"type": "rectangle"}})
    hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(0.5, 0.5, 2.0), mi.Vector3f(0.0, 0.0, -1.0)))
    if abs(float(hit.t[0]) - 2.0) > 1e-4:
        return "the renderer finds no surface; reinstall drjit and mitsuba"
    return None


def _llvm() -> tuple[str, str | None]:
    """`--backend llvm`: (what was found, the problem or None)."""
    from roundel.render.backend import environment
    from roundel.render.llvm import find_llvm
    from roundel.scenes.errors import RoundelError

    try:
        llvm = find_llvm()
        found = f"LLVM {llvm.version or '(version unknown)'} from {llvm.source}: {llvm.path}"
        wrong = _works("llvm_ad_mono")
        if wrong:
            return found, wrong
        made = environment()
        import drjit as dr
    except RoundelError as error:
        return "", str(error)
    except (ImportError, RuntimeError, OSError) as error:
        return "", f"the renderer does not start: {first_line(error)}"
    return f"{found}; variant {made['variant']}, SIMD width {made['simd_width']}, {dr.thread_count()} threads", None


def _cuda() -> str:
    """`--backend cuda` on one line. Its absence is no problem: nothing needs a GPU."""
    from roundel.render.cuda import INSTEAD, find_gpu
    from roundel.scenes.errors import RoundelError

    try:
        gpu = find_gpu()
        wrong = _works("cuda_ad_mono")
    except RoundelError as error:
        wrong = str(error).removeprefix("--backend cuda: ").removesuffix(f", {INSTEAD}")
    except (ImportError, RuntimeError, OSError) as error:
        wrong = first_line(error)
    if wrong:
        return f"backend cuda: not usable: {wrong}"
    return f"backend cuda: usable: {gpu.name}, CUDA {gpu.cuda[0]}.{gpu.cuda[1]}"


def _methods_of_others() -> list[str]:
    """One line per method of an installed plug-in, without importing it."""
    from roundel.solver.methods.registry import installed_methods

    return [f"method {m.name} of {m.source}: {m.about}" for m in installed_methods() if m.source != "roundel"]


def examine() -> tuple[list[str], bool]:
    """Lines to print, and whether there are no problems."""
    lines = [
        f"roundel {metadata.version('roundel')}",
        f"Python {platform.python_version()} on {platform.platform()}, {os.cpu_count()} cores",
    ]
    problems = []
    for package in _PACKAGES:
        try:
            lines.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            if package == "karellen-llvm-core":
                # A dependency only on Linux x86-64; elsewhere the system's LLVM is used.
                lines.append(f"{package}: not installed")
            else:
                problems.append(f"{package} is missing: pip install {package}")
    # The GPU first: once Dr.Jit is imported, it looks for no driver.
    cuda = _cuda()
    found, trouble = _llvm()
    if found:
        lines.append(f"backend llvm: {'not usable' if trouble else 'usable'}: {found}")
    lines.append(cuda)
    lines += _methods_of_others()
    problems += [wrong for wrong in (_ximgproc(), trouble) if wrong]
    lines += [f"problem: {p}" for p in problems] or ["no problems found"]
    return lines, not problems
