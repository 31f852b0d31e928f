"""Which pixels get how many rays: few for the frame, many for the band round the edges."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from roundel.scenes.camera import project
from roundel.scenes.frame import Frame
from roundel.scenes.marker import outlines
from roundel.scenes.pose import transform_points
from roundel.scenes.truth import PIXEL_VARIANCE_PX2, edge_blur_px

# Points along an edge stand this close, so that no pixel it crosses is left out.
_STEP_PX = 0.4


def _dense(line: NDArray[np.float64], frame: Frame) -> NDArray[np.float64]:
    """A polyline of the sheet, densified so that its image has a point every `_STEP_PX`, as camera points."""
    points = []
    for a, b in pairwise(line):
        ends = transform_points(frame.camera_from_sheet, [[*a, 0.0], [*b, 0.0]])
        nearest = max(min(ends[0, 2], ends[1, 2]), 1e-3)
        length_px = np.linalg.norm(ends[1] - ends[0]) * frame.camera.K[0, 0] / nearest
        steps = int(np.clip(np.ceil(length_px / _STEP_PX), 1, 20_000))
        points.append(ends[0] + np.linspace(0, 1, steps, endpoint=False)[:, None] * (ends[1] - ends[0]))
    return np.concatenate(points)


def _band(frame: Frame, lines: list[NDArray[np.float64]]) -> NDArray[np.bool_]:
    """Mask (H, W) of the pixels within `render.band_px`, widened by the defocus, of some edges of the print."""
    camera = frame.camera
    mask = np.zeros((camera.height_px, camera.width_px), dtype=bool)
    deepest = nearest = float(frame.camera_from_sheet[2, 3])
    for line in lines:
        dense = _dense(line, frame)
        front = dense[dense[:, 2] > 0]
        if len(front) == 0:
            continue
        deepest, nearest = max(deepest, front[:, 2].max()), min(nearest, front[:, 2].min())
        px = project(camera, front)
        px = px[np.isfinite(px).all(axis=1)]
        # Far outside the image a pixel's number may not fit an integer; it is not needed.
        px = px[(np.abs(px) < 1e6).all(axis=1)]
        columns, rows = np.rint(px).astype(np.int64).T
        seen = (columns >= 0) & (columns < camera.width_px) & (rows >= 0) & (rows < camera.height_px)
        mask[rows[seen], columns[seen]] = True
    # The radius of the blur disc is twice its standard deviation along one axis.
    blur2 = max(edge_blur_px(camera, deepest) ** 2, edge_blur_px(camera, nearest) ** 2) - PIXEL_VARIANCE_PX2
    reach = int(np.ceil(frame.settings.render.band_px + 2 * np.sqrt(max(blur2, 0.0)) - 1e-9))
    return np.asarray(binary_dilation(mask, structure=np.ones((3, 3), dtype=bool), iterations=reach), dtype=bool)


def sample_map(frame: Frame) -> NDArray[np.int64]:
    """Samples a pixel, (H, W): `samples` everywhere, `band_samples` round the marker's edges.

    The border of the sheet is no marker and gets a sixteenth of the band's.
    """
    render = frame.settings.render
    border, *edges = outlines(frame.sheet)
    samples = np.full((frame.camera.height_px, frame.camera.width_px), render.samples, dtype=np.int64)
    samples[_band(frame, [border])] = max(render.samples, render.band_samples // 16)
    samples[_band(frame, edges)] = max(render.samples, render.band_samples)
    return samples
