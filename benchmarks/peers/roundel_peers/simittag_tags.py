"""simittag (0.2): coded concentric rings; decoded tags, with the pose that their code decides."""

from __future__ import annotations

from typing import Any

import numpy as np
from simittag.detect import detect_markers

from roundel.solver.methods.plugin import Found, View
from roundel_peers.frames import printed, straight


def find(view: View) -> list[Found]:
    """Poses of the tags that simittag decodes."""
    printed(view, "coded_rings")
    tags = detect_markers(straight(view), K=view.camera.K, pose_only=False)
    return [_found(tag, view.diameter_m / 2) for tag in tags]


def _found(tag: dict[str, Any], radius_m: float) -> Found:
    # Its lengths are in outer radii, and its Z may point into the print: ours points out of it, to the camera.
    centre_m = radius_m * np.asarray(tag["t"])
    axis = np.asarray(tag["R"])[:, 2] / np.linalg.norm(np.asarray(tag["R"])[:, 2])
    normal = axis if axis @ centre_m < 0 else -axis
    # cv2.fitEllipse has the full axes, in either order, and the angle of the first.
    (x, y), (first, second), angle = tag["center"], tag["axes"], tag["angle"]
    a, b = max(first, second) / 2, min(first, second) / 2
    ellipse = [x, y, a, b, (angle if first >= second else angle + 90) % 180]
    # A tag's value may also be a text.
    identity = tag["value"] if isinstance(tag["value"], int) else None
    return Found(poses=[(normal, centre_m)], ellipse=ellipse, identity=identity)
