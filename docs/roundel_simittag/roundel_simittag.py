"""simittag's detector (PyPI, 0.2) as a method of Roundel: decoded tags, with the pose that their code decides."""

import numpy as np
from simittag.detect import detect_markers

from roundel.solver.methods.plugin import Found, View


def find(view: View) -> list[Found]:
    """Poses of the tags that simittag decodes."""
    if view.camera.distortion_model != "opencv":
        raise ValueError("simittag knows OpenCV's lens model only")
    dist = np.array(view.camera.distortion) if any(view.camera.distortion) else None
    tags = detect_markers(view.grey, K=view.camera.K, pose_only=False, dist=dist)
    return [_found(tag, view.diameter_m / 2) for tag in tags]


def _found(tag: dict, radius_m: float) -> Found:
    # Its lengths are in outer radii, and its Z may point into the print: ours points out of it, to the camera.
    centre_m = radius_m * np.asarray(tag["t"])
    axis = np.asarray(tag["R"])[:, 2] / np.linalg.norm(np.asarray(tag["R"])[:, 2])
    normal = axis if axis @ centre_m < 0 else -axis
    # cv2.fitEllipse has the full axes, in either order, and the angle of the first.
    (x, y), (first, second), angle = tag["center"], tag["axes"], tag["angle"]
    a, b = max(first, second) / 2, min(first, second) / 2
    return Found(poses=[(normal, centre_m)], ellipse=[x, y, a, b, (angle if first >= second else angle + 90) % 180])
