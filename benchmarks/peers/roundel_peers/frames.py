"""What the programs share: the image without lens distortion, and which marker is printed."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from roundel.scenes.camera.model import Camera, distort_px, distorts
from roundel.solver.methods.plugin import MethodFailure, View


def printed(view: View, kind: str) -> list[dict[str, Any]]:
    """The markers of this kind.

    Raises
    ------
    MethodFailure
        If others are printed, or nothing tells what is.
    """
    markers = [marker for marker in view.markers if marker["kind"] == kind]
    if not markers:
        found = ", ".join(sorted({str(marker["kind"]) for marker in view.markers})) or "not told"
        raise MethodFailure(f"it reads {kind}; the printed marker is {found}")
    return markers


def straight(view: View) -> np.ndarray:
    """The grey image without lens distortion, for programs that know no lens: resampled bilinearly under the same K."""
    if not distorts(view.camera):
        return view.grey
    height, width = view.grey.shape
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    source = np.nan_to_num(distort_px(view.camera, grid), nan=-1e6).astype(np.float32)
    return cv2.remap(view.grey, source[..., 0], source[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def pinhole(camera: Camera) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy.

    Raises
    ------
    MethodFailure
        If the camera has skew, which the programs do not know.
    """
    k = camera.K
    if k[0, 1] != 0:
        raise MethodFailure("it knows no skew, and the camera has some")
    return float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])
