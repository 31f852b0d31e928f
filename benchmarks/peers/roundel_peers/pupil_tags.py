"""pupil-apriltags (1.0.4): AprilTag 3's detector; tags of the family 36h11, one pose each."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from pupil_apriltags import Detector

from roundel.solver.methods.plugin import Found, MethodFailure, View
from roundel_peers.frames import pinhole, printed, straight

FAMILY = "apriltag_36h11"


@lru_cache(maxsize=1)
def _detector() -> Detector:
    # Full resolution: the default halves the image, which loses small tags.
    return Detector(families="tag36h11", quad_decimate=1.0)


def find(view: View) -> list[Found]:
    """Poses and identities of AprilTags."""
    layout = printed(view, "tags")[0]["layout"]
    if layout["family"] != FAMILY:
        raise MethodFailure(f"it reads tags of {FAMILY}; the printed ones are {layout['family']}")
    if (layout["columns"], layout["rows"]) != (1, 1):
        raise MethodFailure("it reads single tags; the printed marker is a board of tags")
    fx, fy, cx, cy = pinhole(view.camera)
    # It counts pixels from their corners: its (0.5, 0.5) is the centre of the top-left pixel, which is our (0, 0).
    camera = fx, fy, cx + 0.5, cy + 0.5
    tags = _detector().detect(straight(view), estimate_tag_pose=True, camera_params=camera, tag_size=layout["tag_m"])
    out = []
    for tag in tags:
        # Its Z points into the print.
        normal, centre_m = -np.asarray(tag.pose_R)[:, 2], np.ravel(tag.pose_t)
        out.append(Found(poses=[(normal / np.linalg.norm(normal), centre_m)], identity=int(tag.tag_id)))
    return out
