"""Bands of pixels around the imaged edges of a frame, in closed form.

Edges of the print, the border of the sheet and outlines of occluders, widened by defocus, soft print edges, the core of
the Airy pattern, lateral chromatic aberration, and the motion during the exposure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from roundel.scenes.camera.airy import REACH, spread_px
from roundel.scenes.camera.model import Camera, lateral_shift_px, project
from roundel.scenes.camera.motion import pose_at
from roundel.scenes.markers.outlines import edge_reach_m, outlines
from roundel.scenes.markers.surfaces import lifted
from roundel.scenes.truth.truth import defocus_radius_px
from roundel.scenes.world.frame import Frame
from roundel.scenes.world.occluders import occluder_outlines_m, plates_of

# Spacing of points along an edge, small enough that no pixel it crosses is missed.
_STEP_PX = 0.4

# An edge is drawn at so many poses that it moves less than this from one to the next.
_MOTION_STEP_PX = 0.5
_MOST_POSES = 257

# A side of a polyline on a bent sheet is divided into so many.
_BENT_STEPS = 16

# Five per cent of the Airy pattern's light falls beyond this x; the pilot of the whole frame covers it.
_AIRY_CORE = 12.7

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SampleMap:
    """Masks (H, W): pixels near the edges of print and occluders, and near the border of the sheet."""

    edge: NDArray[np.bool_]
    border: NDArray[np.bool_]


def _dense(lines: list[Array], frame: Frame) -> Array:
    """Polylines (n, 3) of the sheet's frame, densified so that their image has a point every `_STEP_PX`."""
    pose = frame.camera_from_sheet
    a, b = np.concatenate([line[:-1] for line in lines]), np.concatenate([line[1:] for line in lines])
    nearest = np.minimum(a @ pose[2, :3], b @ pose[2, :3]) + pose[2, 3]
    length_px = np.linalg.norm(b - a, axis=1) * frame.camera.K[0, 0] / np.maximum(nearest, 1e-3)
    steps = np.clip(np.ceil(length_px / _STEP_PX), 1, 20_000).astype(np.int64)
    # All segments at once, because a board of tags has thousands: index of the segment, and of the step within it.
    which = np.repeat(np.arange(len(a)), steps)
    step = np.arange(len(which)) - np.repeat(np.cumsum(steps) - steps, steps)
    return np.asarray(a[which] + (step / steps[which])[:, None] * (b - a)[which], dtype=np.float64)


def _exposed(frame: Frame, points_m: Array) -> tuple[Array, float]:
    """Image positions of sheet points during the exposure, and the distance between successive ones, in pixels."""
    camera, motion, pose = frame.camera, frame.motion, frame.camera_from_sheet

    def image(time_s: float) -> Array:
        at = pose_at(motion, pose, np.array(time_s))
        return project(camera, points_m @ at[:3, :3].T + at[:3, 3])

    if not motion.moves:
        return image(0.0), 0.0
    half = motion.exposure_s / 2
    first, last = motion.row_time_s([0.0, camera.height_px - 1.0])
    begin, end = first - half, last + half
    tick = max(end - begin, 1e-9) * 1e-3
    moved = np.linalg.norm(image(tick) - image(-tick), axis=1)
    speed = float(np.nanmax(moved, initial=0.0)) / (2 * tick)
    count = int(np.clip(np.ceil((end - begin) * speed / _MOTION_STEP_PX) + 1, 2, _MOST_POSES))
    seen = []
    for time in np.linspace(begin, end, count):
        px = image(float(time))
        # Only rows whose shutter is open at that time; one extra step covers positions between two poses.
        open_now = np.abs(time - motion.row_time_s(px[:, 1])) <= half + (end - begin) / (count - 1)
        seen.append(px[open_now])
    return np.concatenate(seen), speed * (end - begin) / (count - 1)


def _near_image(camera: Camera, points_m: Array) -> NDArray[np.bool_]:
    """Which points of the camera frame are imaged inside the image, or within its own size of it."""
    size = np.array([camera.width_px, camera.height_px])
    front = points_m[:, 2] > 1e-6
    px = np.full((len(points_m), 2), np.inf)
    px[front] = project(camera, points_m[front])
    return np.asarray(np.all(np.abs(px - size / 2) < 1.5 * size, axis=1), dtype=bool)


def _band(frame: Frame, lines: list[Array]) -> NDArray[np.bool_]:
    """Mask (H, W) of the pixels near some edges of the print: dilated by blur, motion and diffraction."""
    camera = frame.camera
    mask = np.zeros((camera.height_px, camera.width_px), dtype=bool)
    pose = frame.camera_from_sheet
    depths, step = [float(pose[2, 3])], 0.0
    dense = _dense(lines, frame)
    depth = dense @ pose[2, :3] + pose[2, 3]
    # A lamp beside the camera is extremely blurred and fast, but its image is far away: ignore it.
    near = _near_image(camera, dense @ pose[:3, :3].T + pose[:3, 3])
    if near.any():
        depths += [float(depth[near].max()), float(depth[near].min())]
        px, step = _exposed(frame, dense[near])
        # Far outside the image a pixel index may overflow an integer, and is not needed.
        px = px[np.isfinite(px).all(axis=1) & (np.abs(px) < 1e6).all(axis=1)]
        columns, rows = np.rint(px).astype(np.int64).T
        seen = (columns >= 0) & (columns < camera.width_px) & (rows >= 0) & (rows < camera.height_px)
        mask[rows[seen], columns[seen]] = True
    blur = max(defocus_radius_px(camera, depth) for depth in depths)
    soft = edge_reach_m(frame.sheet) * camera.K[0, 0] / max(min(depths), 1e-3)
    rings = spread_px(camera)[1] * _AIRY_CORE / REACH
    reach = frame.settings.render.band_px + blur + soft + rings + lateral_shift_px(camera) + step / 2
    return _dilated(mask, int(np.ceil(reach - 1e-9)))


def window_of(mask: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
    """The rows and columns that contain a mask, plus a margin: markers are small compared with frames."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return slice(0, 0), slice(0, 0)
    return (
        slice(max(rows[0] - margin, 0), rows[-1] + margin + 1),
        slice(max(columns[0] - margin, 0), columns[-1] + margin + 1),
    )


def _dilated(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """A mask dilated by a square of `reach` pixels to each side."""
    window = window_of(mask, reach)
    mask[window] = maximum_filter(mask[window], 2 * reach + 1) if mask[window].size else False
    return mask


def sample_map(frame: Frame) -> SampleMap:
    """Masks of the pixels where a frame's edges are imaged."""
    maps = [_map_of(view) for view in frame.views()]
    if len(maps) == 1:
        return maps[0]
    edge = np.logical_or.reduce([m.edge for m in maps])
    return SampleMap(edge, np.logical_or.reduce([m.border for m in maps]) & ~edge)


def _map_of(view: Frame) -> SampleMap:
    """Masks of one sheet of a frame; the occluders belong to the first."""
    border, *edges = [_on_sheet(view, line) for line in outlines(view.sheet)]
    things = []
    if view.first is None:
        things = occluder_outlines_m(plates_of(view.settings, view.camera_from_sheet), np.eye(4))
    edge = _band(view, edges + things)
    return SampleMap(edge, _band(view, [border]) & ~edge)


def _on_sheet(view: Frame, line: Array) -> Array:
    """A polyline (n, 2) of the paper as (m, 3) in the sheet's frame, with more points if the sheet is bent."""
    if view.sheet.curve is None:
        return np.column_stack([line, np.zeros(len(line))])
    along = np.linspace(0, 1, _BENT_STEPS, endpoint=False)[:, None, None]
    dense = (line[:-1] + along * np.diff(line, axis=0)).transpose(1, 0, 2).reshape(-1, 2)
    dense = np.concatenate([dense, line[-1:]])
    return lifted(view.sheet.curve, dense[:, 0], dense[:, 1])
