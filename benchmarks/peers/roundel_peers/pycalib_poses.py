"""pycalib-simple: the closed form of Chen 2004, `solve_circle_3d`, on algebraic fits of Roundel's edge points.

The program has no detector; its users take `cv2.fitEllipse`, and `direct` (Halir and Flusser) is the same kind of fit.
"""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType

import numpy as np

from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel.solver.views.circles_of_view import circles_of_view
from roundel_peers.frames import pinhole


def _stand_in() -> None:
    """The package's own __init__ imports scikit-image, pandas and more, which its closed form does not use."""
    spec = importlib.util.find_spec("pycalib")
    if spec is None:
        raise ModuleNotFoundError("No module named 'pycalib'; run `make peers-env`")
    if "pycalib" not in sys.modules:
        package = ModuleType("pycalib")
        package.__path__, package.__spec__ = list(spec.submodule_search_locations or ()), spec
        sys.modules["pycalib"] = package


_stand_in()
from pycalib.circle import solve_circle_3d  # noqa: E402


def find(view: View) -> list[Found]:
    """Both poses of every circle."""
    fx, fy, _, _ = pinhole(view.camera)
    if fx != fy:
        raise MethodFailure("its closed form knows square pixels only")
    out = []
    for circle in circles_of_view(view, "direct"):
        x, y, a, b, angle = (float(v) for v in circle.ellipse)
        centres, normals = solve_circle_3d(view.camera.K, ((x, y), (2 * a, 2 * b), angle), radius=view.diameter_m / 2)
        poses = [_toward(n, c) for n, c in zip(np.reshape(normals, (-1, 3)), np.reshape(centres, (-1, 3)), strict=True)]
        out.append(Found(poses=poses, ellipse=circle.ellipse, confidence=circle.confidence))
    return out


def _toward(normal: np.ndarray, centre_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    unit = normal / np.linalg.norm(normal)
    return (unit if unit @ centre_m < 0 else -unit), centre_m
