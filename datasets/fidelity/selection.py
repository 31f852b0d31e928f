"""Selection of the circles whose fidelity is measured, and reasons for leaving out others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.fidelity.prediction import is_sharp
from roundel.scenes.camera.model import distorts
from roundel.scenes.camera.motion import image_of
from roundel.scenes.geometry.conic import conic_of_circle, ellipse_of_conic
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.marker import Part, Sectors
from roundel.scenes.markers.surfaces import lifted
from roundel.scenes.truth.truth import defocus_radius_px
from roundel.scenes.truth.visibility import visibility
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.occluders import hidden, plates_of
from roundel.scenes.world.placement import part_outline

# Sharp circles take milliseconds and are all measured; blurred ones in so many frames per group, circles per frame.
SAMPLED_FRAMES = 16
_LEAST_A_LEVEL = 2
_SAMPLED_CIRCLES = 4

_SMALLEST_PX = 3.0

# A thin lens blurs everything out of focus; a blur radius below this counts as sharp.
_FOCUSED_PX = 0.25

# Radius, in circle radii, within which nothing may be in front of the print.
_AROUND = np.array([0.0, 0.5, 0.8, 1.0, 1.2, 1.5])


def _part(frame: Frame, marker_id: int) -> Part:
    return next(p for p in frame.sheet.parts if p.marker_id == marker_id)


def is_sampled(frame: Frame, marker_id: int) -> bool:
    """Whether a circle is in the sample: a function of study and frame alone, evenly spaced over each group."""
    if is_sharp(frame):
        return True
    circles = [p.marker_id for p in frame.sheet.parts if p.radius_m is not None]
    if marker_id not in circles[:_SAMPLED_CIRCLES]:
        return False
    settings = frame.settings
    levels = len(settings.sweep.levels) if settings.sweep is not None else 1
    wanted = max(_LEAST_A_LEVEL, SAMPLED_FRAMES // levels)
    # A drawn section holds the frame count of its level.
    count = max(settings.frames or 1, 1)
    return (frame.index + 1) * wanted // count > frame.index * wanted // count


def obstacle(frame: Frame, marker_id: int) -> str | None:
    """Reason why a circle's image is not predicted; None if it is."""
    part, settings, camera = _part(frame, marker_id), frame.settings, frame.camera
    if part.radius_m is None:
        return "not a circle"
    if not part.inked:
        return "its circle is not printed"
    if any(isinstance(shape, Sectors) for shape in frame.sheet.shapes):
        return "its code is not predicted"
    if settings.occluders:
        return "occluders hide or shade it"
    if settings.marker.surface.kind != "matte":
        return "its surface is glossy"
    if settings.marker.grain > 0:
        return "its paper has grain"
    if any(lamp.kind == "spot" for lamp in settings.light.lamps):
        return "the rim of a spotlight is not smooth"
    if _behind_a_lamp(frame, part):
        return "a lamp hides or shades it"
    if np.isfinite(camera.barrel_radius_m):
        return "the lens barrel vignettes it"
    if frame.others and visibility(frame, part, _outline_px(frame, part))[1]:
        return "another sheet or the image border hides some of it"
    # Of a bent sheet, the circle in its tangent plane.
    ellipse = ellipse_of_conic(conic_of_circle(frame.camera_from_part(part), part.radius_m, camera.K))
    if ellipse[3] < _SMALLEST_PX:
        return f"smaller than {_SMALLEST_PX:g} px"
    return None


def _outline_px(frame: Frame, part: Part) -> NDArray[np.float64]:
    return image_of(frame.camera, frame.motion, frame.camera_from_sheet, part_outline(frame.sheet, part, 64))[0]


def _behind_a_lamp(frame: Frame, part: Part) -> bool:
    """Whether an area lamp is between a circle and the camera, a point light, or the sun."""
    assert part.radius_m is not None
    light, pose = frame.settings.light, frame.camera_from_sheet
    plates = plates_of(frame.settings, frame.camera_from_first)
    if not plates:
        return False
    if light.sky is not None and light.sky.sun > 0:
        return True
    turn, radius = np.meshgrid(np.linspace(0, 2 * np.pi, 24, endpoint=False), _AROUND * part.radius_m)
    x, y = (part.x_m + radius * np.cos(turn)).ravel(), (part.y_m + radius * np.sin(turn)).ravel()
    around = lifted(frame.sheet.curve, x, y)
    if frame.first is not None:
        # Plates are placed in the frame of the study's own sheet.
        around = transform_points(np.linalg.inv(frame.camera_from_first) @ pose, around)
        pose = frame.camera_from_first
    eyes = [np.zeros(3), *(np.array(lamp.position_m) for lamp in light.lamps if lamp.kind == "point")]
    for eye in eyes:
        moved = pose.copy()
        moved[:3, 3] -= eye
        if hidden(plates, moved, around).any():
            return True
    return False


def effects_of(frame: Frame) -> list[str]:
    """Effects on the edges of a frame other than light, noise and the pixel."""
    camera, motion = frame.camera, frame.motion
    blur_px = defocus_radius_px(camera, float(frame.camera_from_sheet[2, 3]))
    found = {
        "defocus": blur_px > _FOCUSED_PX,
        "diffraction": bool(camera.wavelengths_m),
        "motion": motion.moves and motion.exposure_s > 0 and motion.row_s == 0,
        "rolling_shutter": motion.moves and motion.row_s > 0,
        "distortion": distorts(camera),
        "soft_edges": frame.sheet.edge_softness_m > 0,
    }
    return [name for name, active in found.items() if active]


def effect_of(frame: Frame) -> str:
    """The one effect on a frame's edges: `sharp` for none, `all` for several."""
    found = effects_of(frame)
    return "all" if len(found) > 1 else found[0] if found else "sharp"
