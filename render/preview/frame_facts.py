"""What a frame shows: the size of its markers, their distances, the field of view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, ray_direction
from roundel.scenes.camera.motion import image_of
from roundel.scenes.geometry.pose import angle_deg, tilt_azimuth_deg
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.placement import part_outline

_OUTLINE_POINTS = 64


@dataclass(frozen=True, eq=False)
class MarkerFacts:
    """One marker of a frame.

    Attributes
    ----------
    kind : str
    outline_px : (n, 2) array
        Its outline in the full image; without the points that are not imaged.
    size_px : float
        Largest extent of that outline.
    distance_m : float
        From the camera centre to the marker's centre.
    distance_D : float or None
        The same in diameters; None for a board.
    tilt_deg : float
    """

    kind: str
    outline_px: NDArray[np.float64]
    size_px: float
    distance_m: float
    distance_D: float | None
    tilt_deg: float


@dataclass(frozen=True)
class FrameFacts:
    """A frame's field of view across its width and height in degrees, lens distortion included, and its markers."""

    frame: Frame
    view_deg: tuple[float, float]
    markers: tuple[MarkerFacts, ...]

    @property
    def caption(self) -> str:
        """Size, distance and tilt of the first marker, and the number of further ones."""
        first = self.markers[0]
        far = "" if first.distance_D is None else f" ({first.distance_D:.3g} D)"
        more = f" +{len(self.markers) - 1}" if len(self.markers) > 1 else ""
        return f"{first.size_px:.0f} px, {first.distance_m:.3g} m{far}, {first.tilt_deg:.0f} deg{more}"


def facts_of(frame: Frame) -> FrameFacts:
    """The facts of one frame; nothing is rendered."""
    markers = tuple(_marker(view, k) for view in frame.views() for k in range(len(view.sheet.parts)))
    return FrameFacts(frame, field_of_view_deg(frame.camera), markers)


def field_of_view_deg(camera: Camera) -> tuple[float, float]:
    """Angles between the rays through the middles of the left and right, upper and lower borders; NaN if none."""
    right, low = camera.width_px - 0.5, camera.height_px - 0.5
    middle_x, middle_y = (camera.width_px - 1) / 2, (camera.height_px - 1) / 2
    centre = ray_direction(camera, [middle_x, middle_y])

    def across(first: list[float], last: list[float]) -> float:
        # From the middle: the whole angle may be more than 180 degrees.
        return float(sum(angle_deg(ray_direction(camera, end), centre) for end in (first, last)))

    return across([-0.5, middle_y], [right, middle_y]), across([middle_x, -0.5], [middle_x, low])


def _marker(view: Frame, k: int) -> MarkerFacts:
    part = view.sheet.parts[k]
    outline, _ = image_of(
        view.camera, view.motion, view.camera_from_sheet, part_outline(view.sheet, part, _OUTLINE_POINTS)
    )
    seen = outline[np.isfinite(outline).all(axis=1)]
    size = float(np.linalg.norm(seen[:, None] - seen[None], axis=-1).max()) if len(seen) else 0.0
    pose = view.camera_from_part(part)
    distance = float(np.linalg.norm(pose[:3, 3]))
    tilt, _ = tilt_azimuth_deg(pose[:3, 2])
    diameters = None if part.radius_m is None else distance / (2 * part.radius_m)
    return MarkerFacts(part.kind, seen, size, distance, diameters, float(tilt))
