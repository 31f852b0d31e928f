"""The other images by the camera of a frame, for methods that need several views."""

from __future__ import annotations

import copy
import math
from typing import Any

from roundel.datasets.layout.images import Images
from roundel.scenes.camera.response_curve import UNKNOWN
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.plugin import View

# Views of one set, the frame's own included: enough for a camera's five numbers, and few enough to solve each frame.
SET_SIZE = 6

_SHARED = ("group", "width_px", "height_px", "mode", "K", "distortion", "distortion_model")


def companions_of(images: Images, index: int, diameter_m: float, given: UncertainCamera) -> list[View]:
    """Views of the other frames of a frame's set: frames of its group by the same camera.

    The frames of a group by one camera are cut into sets of `SET_SIZE` in their order, so that all frames of a set have
    the same companions. That the camera is the same is known to the user; what it is, is not told.

    Parameters
    ----------
    images : Images
    index : int
        Position of the frame.
    diameter_m : float
        As in the frame's own view.
    given : UncertainCamera
        The camera for the views.
    """
    own = images.records[index]
    same = [i for i, other in enumerate(images.records) if all(other.get(key) == own.get(key) for key in _SHARED)]
    start = same.index(index) // SET_SIZE * SET_SIZE
    return [
        View(
            images.image(i),
            given.camera,
            diameter_m,
            printed_markers(images, i),
            images.saturation_dn(i) or 255.0,
            images.curve(i) or UNKNOWN,
            given.focal_sigma,
        )
        for i in same[start : start + SET_SIZE]
        if i != index
    ]


def printed_markers(images: Images, index: int) -> list[dict[str, Any]]:
    """A copy of what is printed in a frame, without the identity of a single coded marker: a method has to read it."""
    markers = copy.deepcopy(images.markers(index))
    for marker in markers:
        layout = marker["layout"]
        layout.pop("id", None)
        if marker["kind"] == "tags" and layout.get("columns") == layout.get("rows") == 1:
            layout.pop("first_id", None)
    return markers


def equivalent_diameter_m(marker: dict[str, Any]) -> float:
    """Diameter of the disc with the area of a print that is no circle; 1 m if an older dataset does not tell."""
    width, height = marker.get("size_m") or (1.0, 1.0)
    return math.sqrt(4 * width * height / math.pi)
