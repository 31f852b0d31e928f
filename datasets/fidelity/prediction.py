"""Predicted image of a print in float64: the pattern integrated over pixel, lens, time and wavelength.

This module shares only the camera's forward projection and the motion with the ray generator: that goes from a pixel to
the scene, this goes from the edges of the print to the image. At each of many nodes (a point of the lens, a time, an
offset of the Airy pattern, a position on the ramp of a soft edge) an edge is a sharp closed curve, whose area in each
pixel is exact; the mean over the nodes is the prediction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.fidelity.pixel_coverage import Areas
from roundel.datasets.fidelity.print_outlines import Outline, outlines_of
from roundel.datasets.fidelity.projected_contours import Box, add_outline, images_of
from roundel.datasets.fidelity.quadrature import Nodes, active_dimensions, nodes_of
from roundel.scenes.markers.marker import Part
from roundel.scenes.world.frame import Frame

Array = NDArray[np.float64]
Window = tuple[int, int, int, int]

# Sagitta of the polygon's chords: a sharp edge has one node, a blurred one averages over many.
_SHARP_PX, _BLURRED_PX = 1e-6, 1e-3

# Distance between vertices of straight edges: distortion bends a chord of this length by less than 1e-3 px.
_SIDE_PX = 2.0

# Numbers of vertices and nodes used to estimate how far the nodes spread an edge.
_COARSE, _FEW = 48, 128


@dataclass(frozen=True)
class Prediction:
    """The pattern of a print around one circle, in a window of pixels that begins at (row0, col0).

    Attributes
    ----------
    row0, col0 : int
    coverage : (h, w) array
        Fraction of each pixel's light that comes from inside the circle.
    pattern : (h, w) array
        Mean reflectance that the pixel sees under uniform illumination.
    drift_x, drift_y : (h, w) arrays
        Mean of reflectance times distance, in pixels, from the pixel to the point that reflects the light: if the light
        changes by g per pixel, the pixel sees g times that more.
    shift_x, shift_y, growth : (h, w) arrays
        Derivatives of `pattern` per pixel: of a shift of the whole print, and of the circle's growth along its normal.
    step : float
        Increase of the reflectance from outside the circle to inside.
    border : bool
        Whether the wall beyond the sheet's border is visible there.
    on_sheet : (h, w) array
        Fraction of each pixel's light that comes from within the sheet's border.
    """

    row0: int
    col0: int
    coverage: Array
    pattern: Array
    drift_x: Array
    drift_y: Array
    shift_x: Array
    shift_y: Array
    growth: Array
    step: float
    border: bool
    on_sheet: Array


@dataclass(frozen=True)
class _View:
    """Image of an edge: mean contour (v, 2), the box of all nodes, and how far they spread it, in pixels."""

    contour: Array
    low: Array
    high: Array
    spread: float

    @property
    def extent(self) -> float:
        return float(np.ptp(self.contour, axis=0).max())

    def window(self) -> Window:
        (x0, y0), (x1, y1) = np.floor(self.low).astype(int) - 3, np.ceil(self.high).astype(int) + 3
        return int(y0), int(x0), int(y1 - y0) + 1, int(x1 - x0) + 1


def is_sharp(frame: Frame) -> bool:
    """Whether only the pixel blurs the frame's edges."""
    return active_dimensions(frame.camera, frame.motion, frame.sheet.edge_softness_m) == 0


def nodes_for(frame: Frame, count: int | None = None) -> Nodes:
    """The nodes that a frame needs, or `count` of them."""
    return nodes_of(frame.camera, frame.motion, frame.sheet.edge_softness_m, count)


def circle_of(frame: Frame, part: Part) -> tuple[Outline, list[Outline]]:
    """The outline of a circular part, and all others of the sheet, its border first."""
    border, edges = outlines_of(frame.sheet)
    for i, edge in enumerate(edges):
        if edge.corners_m is None and (edge.x_m, edge.y_m, edge.radius_m) == (part.x_m, part.y_m, part.radius_m):
            return edge, [border, *edges[:i], *edges[i + 1 :]]
    raise ValueError(f"marker {part.marker_id} is not a circle of the print")


def _view(frame: Frame, outline: Outline, nodes: Nodes, box: Box | None = None) -> _View:
    few = nodes.few(_FEW)
    airy_px = float(np.linalg.norm(nodes.airy_px, axis=1).max())
    few = replace(few, airy_px=np.zeros_like(few.airy_px))
    x, y = outline.points_m(_COARSE, few.ramp)
    px = np.stack(images_of(frame, x, y, few, box), axis=-1)
    if not np.all(np.isfinite(px)):
        raise ValueError("part of the print is behind the camera or outside the lens's field")
    mean = px.mean(axis=0)
    spread = float(np.linalg.norm(px - mean, axis=-1).max())
    # Few nodes and vertices miss the outermost blur and the bulge of a circle between two vertices.
    margin = airy_px + 0.2 * spread + 0.005 * float(np.ptp(mean, axis=0).max())
    return _View(mean, px.min(axis=(0, 1)) - margin, px.max(axis=(0, 1)) + margin, spread + margin)


def _box(frame: Frame, circle: Outline, view: _View, nodes: Nodes) -> Box:
    """A box around a circle's edge, large enough that clamping other edges to it does not change the circle's image."""
    pinhole = replace(frame, camera=replace(frame.camera, distortion=(), distortion_model="opencv"))
    few = nodes.few(_FEW)
    x, y = images_of(pinhole, *circle.points_m(_COARSE, few.ramp), few)
    k = frame.camera.K
    v = (y - k[1, 2]) / k[1, 1]
    u = (x - k[0, 2] - k[0, 1] * v) / k[0, 0]
    room = 3 * (2 * view.spread + 20) / min(k[0, 0], k[1, 1])
    return Box(np.array([u.min(), v.min()]) - room, np.array([u.max(), v.max()]) + room)


def _near(view: _View, other: _View) -> bool:
    """Whether another edge is visible in the pixels covered by the blur of the first."""
    from scipy.spatial import cKDTree

    closed = np.concatenate([other.contour, other.contour[:1]])
    dense = np.concatenate([closed[:-1] + t * np.diff(closed, axis=0) for t in np.linspace(0, 1, 12, endpoint=False)])
    distance, _ = cKDTree(view.contour).query(dense)
    between = float(np.linalg.norm(np.diff(view.contour, axis=0), axis=1).max())
    return bool(distance.min() < view.spread + other.spread + 6 + between)


def _vertices(outline: Outline, extent_px: float, sharp: bool) -> int:
    """Number of vertices for an outline of this extent in the image."""
    if outline.corners_m is None:
        return int(np.ceil(np.pi * np.sqrt(extent_px / (4 * (_SHARP_PX if sharp else _BLURRED_PX))))) + 16
    return int(np.ceil(4 * extent_px / _SIDE_PX)) + 16


def _light_offsets(frame: Frame, circle: Outline, nodes: Nodes) -> Array:
    """Displacement (n, 2) from the mean, in pixels, of a point that is fixed under the lights, for each node."""
    # The light does not move with the marker.
    still = replace(frame, motion=replace(frame.motion, marker_twist=np.zeros(6)))
    px = np.concatenate(images_of(still, np.array([[circle.x_m]]), np.array([[circle.y_m]]), nodes), axis=1)
    return np.asarray(px - px.mean(axis=0), dtype=np.float64)


def window_of(frame: Frame, part: Part) -> Window:
    """The window of pixels that a circle's edge can reach."""
    return _view(frame, circle_of(frame, part)[0], nodes_for(frame)).window()


def common_window(windows: list[Window]) -> Window:
    """The smallest window that holds others."""
    rows, columns, heights, widths = np.array(windows).T
    row0, col0 = int(rows.min()), int(columns.min())
    return row0, col0, int((rows + heights).max()) - row0, int((columns + widths).max()) - col0


def predict(frame: Frame, part: Part, window: Window | None = None, nodes: Nodes | None = None) -> Prediction:
    """Predict the print around one circle.

    Parameters
    ----------
    frame : Frame
    part : Part
        A part with a radius.
    window : (row0, col0, height, width), optional
        By default everything that the circle's edge can reach; it may extend beyond the image.
    nodes : Nodes, optional
        Nodes to average over.

    Returns
    -------
    Prediction

    Raises
    ------
    ValueError
        If an edge is behind the camera, or outruns the rolling shutter.
    """
    nodes = nodes_for(frame) if nodes is None else nodes
    sharp = len(nodes) == 1
    circle, others = circle_of(frame, part)
    view = _view(frame, circle, nodes)
    window = view.window() if window is None else window
    offsets = _light_offsets(frame, circle, nodes)
    weights = np.stack([np.ones(len(nodes)), -offsets[:, 0], -offsets[:, 1]]) / len(nodes)
    own, rest = (Areas(*window, side=frame.camera.pixel_side, kinds=3) for _ in range(2))
    add_outline(frame, circle, nodes, _vertices(circle, view.extent, sharp), weights, own)
    box = _box(frame, circle, view, nodes)
    border, paper = False, np.ones(window[2:])
    for i, outline in enumerate(others):
        other = _view(frame, outline, nodes, box)
        if _near(view, other):
            count = _vertices(outline, other.extent, sharp)
            add_outline(frame, outline, nodes, count, outline.step * weights, rest, box)
            if i == 0:
                border, within = True, Areas(*window, side=frame.camera.pixel_side, kinds=1)
                add_outline(frame, outline, nodes, count, weights[:1], within, box)
                paper = within.inside()[0]
    inside, (shift_x, shift_y, growth) = own.inside(), own.derivatives()
    planes = circle.step * inside + rest.inside()
    others_x, others_y, _ = rest.derivatives()
    return Prediction(
        window[0],
        window[1],
        inside[0],
        (frame.sheet.wall if border else frame.sheet.paper) + planes[0],
        planes[1],
        planes[2],
        circle.step * shift_x + others_x,
        circle.step * shift_y + others_y,
        circle.step * growth,
        circle.step,
        border,
        paper,
    )
