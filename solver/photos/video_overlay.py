"""A video's frame with its tracked markers: contour, normals, identity, and what is not certain, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera
from roundel.scenes.geometry.conic import Ellipse
from roundel.solver.caveats import count_caveats
from roundel.solver.estimates import Estimate
from roundel.solver.photos.overlay import Drawn, draw_overlay
from roundel.solver.photos.photo_report import distance_label
from roundel.solver.tracking.tracker import TrackedMarker

_DOUBTFUL = 0.5  # confidence


def draw_markers(
    picture: NDArray[np.uint8], markers: Sequence[TrackedMarker], camera: Camera, diameter_m: float, footer: str
) -> NDArray[np.uint8]:
    """Draw tracked markers on an RGB picture (H, W, 3), see `draw_overlay`; one out of sight where it is expected."""
    drawn = [_drawn(marker, camera, diameter_m) for marker in markers]
    return draw_overlay(picture, drawn, footer)


def _drawn(marker: TrackedMarker, camera: Camera, diameter_m: float) -> Drawn:
    name, estimate = f"#{marker.identity}", marker.estimate
    if estimate is None:
        expected = Estimate(
            0, 0, "", "", "failed", "out of sight", ellipse=Ellipse.from_array(marker.ellipse), camera=camera
        )
        return Drawn(expected, diameter_m, f"not seen for {marker.unseen_s:.1f} s", name)
    return Drawn(estimate, diameter_m, distance_label(estimate), name, caveats_of(marker, estimate))


def caveats_of(marker: TrackedMarker, estimate: Estimate) -> tuple[str, ...]:
    """What a reader must know before the numbers are believed."""
    remarks = []
    if not marker.confirmed:
        remarks.append("new")
    if estimate and estimate.chosen is None:
        remarks.append("tilt: either of the two")
    if estimate.confidence is not None and estimate.confidence < _DOUBTFUL:
        remarks.append("may not be a circle")
    return (*remarks, *count_caveats([estimate.caveats]))
