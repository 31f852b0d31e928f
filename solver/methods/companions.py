"""The other images by the camera of a frame, for methods that need several views."""

from __future__ import annotations

import copy
from typing import Any

from roundel.datasets.layout.images import Images
from roundel.scenes.camera.response_curve import UNKNOWN
from roundel.solver.intrinsics.uncertain_camera import UncertainCamera
from roundel.solver.methods.plugin import View

# Views of one set, the frame's own included: enough for a camera's five numbers, and few enough to solve each frame.
SET_SIZE = 6

_RECORD = ("width_px", "height_px", "mode", "K", "distortion", "distortion_model")


def companions_of(images: Images, index: int, diameter_m: float, given: UncertainCamera) -> list[View]:
    """Views of the other frames of a frame's set: consecutive frames of its group by the same camera.

    The frames of a group are cut into sets of `SET_SIZE` in their order, so that all frames of a set have the same
    companions. That the camera is the same is known to the user; what it is, is not told.

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
    record, group = images.records[index], images.groups
    same = [i for i, other in enumerate(group) if other == group[index]]
    start = same.index(index) // SET_SIZE * SET_SIZE
    others = (i for i in same[start : start + SET_SIZE] if i != index and images.mode(i) == "images")
    alike = (i for i in others if all(images.records[i].get(key) == record.get(key) for key in _RECORD))
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
        for i in alike
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
