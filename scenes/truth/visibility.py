"""How much of a marker is seen, and what hides the rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, project
from roundel.scenes.camera.motion import pose_at
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.markers.marker import Part
from roundel.scenes.markers.surfaces import lifted
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.occluders import Plate, hidden, plates_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def inside_image(camera: Camera, px: Array) -> Mask:
    """Which positions (n, 2) are inside the image."""
    return np.asarray(
        np.all((px >= -0.5) & (px <= [camera.width_px - 0.5, camera.height_px - 0.5]), axis=1), dtype=bool
    )


def visibility(frame: Frame, part: Part, contour: Array) -> tuple[float, str]:
    """The visible fraction of a part's area, over 4,096 points of equal area, and the names of what hides the rest.

    Parameters
    ----------
    frame : Frame
    part : Part
    contour : (n, 2) array
        Its outline in the image, px.

    Returns
    -------
    visible_fraction : float
        1 if the whole contour is in the image and nothing is in front of the print.
    hidden_by : str
        Comma-separated: `image border`, `occluder`, `lamp`, `sheet`; empty if nothing hides it.
    """
    screens = _screens(frame)
    whole = bool(inside_image(frame.camera, contour).all())
    if whole and not screens:
        return 1.0, ""
    points = _points(frame, part)
    # The sheet at mid-exposure of the part's own centre.
    pose = pose_at(frame.motion, frame.camera_from_sheet, np.array(frame.part_time_s(part)))
    seen, names = np.ones(len(points), dtype=bool), []
    for name, plates in screens.items():
        lost = hidden(plates, pose, points)
        seen &= ~lost
        names += [name] if lost.any() else []
    if not whole:
        there = inside_image(frame.camera, project(frame.camera, transform_points(pose, points)))
        seen &= there
        names += [] if there.all() else ["image border"]
    return float(seen.mean()), ",".join(names)


def contour_visible(frame: Frame, part: Part, contour: Array, outline_m: Array) -> Mask:
    """Which points (n,) of a part's outline are in the image and not hidden.

    Parameters
    ----------
    frame : Frame
    part : Part
    contour : (n, 2) array
        The outline in the image, px.
    outline_m : (n, 3) array
        The same points in the sheet's frame.
    """
    pose = pose_at(frame.motion, frame.camera_from_sheet, np.array(frame.part_time_s(part)))
    seen = inside_image(frame.camera, contour)
    for plates in _screens(frame).values():
        seen &= ~hidden(plates, pose, outline_m)
    return seen


def _points(frame: Frame, part: Part) -> Array:
    steps = (np.arange(64) + 0.5) / 64
    u, v = np.meshgrid(steps, steps)
    if part.radius_m is not None:
        r, t = part.radius_m * np.sqrt(u), 2 * np.pi * v
        x, y = r * np.cos(t), r * np.sin(t)
    else:
        w, h = part.half_size_m()
        x, y = w * (2 * u - 1), h * (2 * v - 1)
    if frame.sheet.curve is not None:
        return lifted(frame.sheet.curve, part.x_m + x, part.y_m + y).reshape(-1, 3)
    flat = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    return np.asarray(flat + np.array([part.x_m, part.y_m, 0.0]))


def _screens(frame: Frame) -> dict[str, list[Plate]]:
    """What may be in front of the sheet, by name, as plates in its frame; a bent sheet as its flat paper."""
    first = frame.camera_from_first
    plates = list(plates_of(frame.settings, first))
    if first is not frame.camera_from_sheet:
        move = np.linalg.inv(frame.camera_from_sheet) @ first
        plates = [Plate(move @ p.sheet_from_plate, p.half_width_m, p.half_height_m, p.is_round) for p in plates]
    count = len(frame.settings.occluders)
    sheets = [_rectangle(frame, i) for i in range(len(frame.others))]
    found = {"occluder": plates[:count], "lamp": plates[count:], "sheet": sheets}
    return {name: some for name, some in found.items() if some}


def _rectangle(frame: Frame, i: int) -> Plate:
    other = frame.others[i]
    (x0, y0), (x1, y1) = other.sheet.low_m, other.sheet.high_m
    middle = np.eye(4)
    middle[:2, 3] = (x0 + x1) / 2, (y0 + y1) / 2
    pose = np.linalg.inv(frame.camera_from_sheet) @ other.camera_from_sheet @ middle
    return Plate(pose, (x1 - x0) / 2, (y1 - y0) / 2, False)
