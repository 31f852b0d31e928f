"""stag-python (1.1): STag's squares; corners and identity, from which OpenCV has both poses of the square."""

from __future__ import annotations

import cv2
import numpy as np
import stag

from roundel.solver.methods.plugin import Found, View
from roundel.solver.pose.plane_pose import plane_points, plane_poses
from roundel_peers.frames import printed, straight

LIBRARY = 21


def find(view: View) -> list[Found]:
    """Poses and identities of STag's squares."""
    side = float(printed(view, "stag")[0]["layout"]["tag_m"])
    corners, identities, _ = stag.detectMarkers(cv2.cvtColor(straight(view), cv2.COLOR_GRAY2BGR), LIBRARY)
    points = np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]]) * side / 2
    out = []
    for square, identity in zip(corners, np.ravel(identities), strict=True):
        pixels = np.asarray(square, dtype=np.float64).reshape(4, 2)
        poses = plane_poses(plane_points(points, pixels, view.camera), square=True)
        # It returns corners alone; the better of the two poses is what cv2.solvePnP would give.
        found = [(pose.normal, pose.centre_m) for pose in poses]
        out.append(
            Found(poses=found, chosen=0 if found else None, centre_px=pixels.mean(axis=0), identity=int(identity))
        )
    return out
