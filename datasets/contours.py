"""Where a camera images the edges of a print: by forward projection only, node by node.

Seen through one point of the lens, at one time, displaced by one offset of the Airy pattern, an edge is a sharp curve.
A scene point (X, Y, Z) seen through the lens point l of a thin lens focused at u has the undistorted normalised
coordinates (X, Y) / Z + l (1/u - 1/Z); the distortion and K then apply.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.areas import Areas
from roundel.datasets.nodes import Nodes
from roundel.datasets.pattern import Outline
from roundel.scenes.camera import denormalise, distort_px
from roundel.scenes.frame import Frame
from roundel.scenes.motion import pose_at

Array = NDArray[np.float64]
Cells = NDArray[np.int64]

# Segments in work at once: small enough for a processor's cache.
_CHUNK = 60_000

# Poses over exposure and read-out, as polynomials of this degree in time: exact to 1e-12 for a quarter of a turn.
_DEGREE = 12

# A row may see an edge displaced by this many rows from where the edge crosses it; more outruns the shutter.
_MAX_ROWS = 12

# Steps to the row that sees a point; each shrinks the error by the speed, in rows a row.
_ROW_STEPS = 8


class OutrunsShutterError(ValueError):
    """An edge moves nearly as fast as the rows are read: what each row sees of it is not predicted."""


@dataclass(frozen=True)
class Box:
    """A box (x, y) of undistorted normalised coordinates.

    Edges far from the circle of interest are pressed into it: that changes nothing within, and spares the lens what it
    cannot image.
    """

    low: Array
    high: Array


def image_points(frame: Frame, points: list[Array], nodes: Nodes, box: Box | None = None) -> tuple[Array, Array]:
    """Where points of the camera frame (three arrays (n, ...)) are imaged, each at its own of n nodes."""
    camera = frame.camera
    x, y, z = points
    per_node = (-1,) + (1,) * (z.ndim - 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(z > 0, 1 / z, np.nan)
    lens = 1 / camera.focus_distance_m - inverse
    straight = np.stack(
        [
            x * inverse + nodes.lens_m[:, 0].reshape(per_node) * lens,
            y * inverse + nodes.lens_m[:, 1].reshape(per_node) * lens,
        ],
        axis=-1,
    )
    if box is not None:
        straight = np.clip(straight, box.low, box.high)
    px = distort_px(camera, denormalise(camera, straight))
    return px[..., 0] - nodes.airy_px[:, 0].reshape(per_node), px[..., 1] - nodes.airy_px[:, 1].reshape(per_node)


def _placed(pose: Array, x: Array, y: Array) -> list[Array]:
    """Points of a sheet's plane in the camera frame, by poses (..., 3, 3) of columns x axis, y axis and origin."""
    return [pose[..., i, 0] * x + pose[..., i, 1] * y + pose[..., i, 2] for i in range(3)]


def _poses(frame: Frame, time: Array) -> Array:
    """Poses (..., 3, 3), columns x axis, y axis and origin, at many times (...)."""
    if not frame.motion.moves:
        return np.broadcast_to(frame.camera_from_sheet[:3, [0, 1, 3]], (*time.shape, 3, 3))
    middle, half = (time.max() + time.min()) / 2, max((time.max() - time.min()) / 2, 1e-12)
    knots = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    known = pose_at(frame.motion, frame.camera_from_sheet, middle + half * knots)[:, :3][:, :, [0, 1, 3]]
    vander = np.polynomial.chebyshev.chebvander
    coefficients = np.linalg.solve(vander(knots, _DEGREE), known.reshape(-1, 9))
    table = vander(((time - middle) / half).ravel(), _DEGREE) @ coefficients
    return np.asarray(table.reshape(*time.shape, 3, 3), dtype=np.float64)


def images_of(frame: Frame, x: Array, y: Array, nodes: Nodes, box: Box | None = None) -> tuple[Array, Array]:
    """Images (n, v) of points of the sheet (n or 1, v) at n nodes, each at the time of the row that sees it."""
    shape = np.broadcast_shapes(x.shape, (len(nodes), x.shape[1]))
    x, y = np.broadcast_to(x, shape), np.broadcast_to(y, shape)
    # Under a global shutter a node has one time for all points.
    rolls = frame.motion.moves and frame.motion.row_s > 0
    row = np.full(shape if rolls else (len(nodes), 1), frame.motion.centre_row_px)
    for _ in range(_ROW_STEPS if rolls else 1):
        pose = _poses(frame, nodes.time_s[:, None] + frame.motion.row_time_s(row))
        px = image_points(frame, _placed(pose, x, y), nodes, box)
        row = px[1]
    return px


def add_outline(
    frame: Frame, outline: Outline, nodes: Nodes, count: int, weights: Array, into: Areas, box: Box | None = None
) -> None:
    """Add the images of an outline at all nodes to sums of areas.

    Parameters
    ----------
    frame : Frame
    outline : Outline
    nodes : Nodes
    count : int
        Vertices of the polygon that stands for the outline.
    weights : (kinds, n) array
        Of each node, for each kind of sum.
    into : Areas
    box : Box, optional

    Raises
    ------
    OutrunsShutterError
    """
    size = max(1, _CHUNK // count)
    for start in range(0, len(nodes), size):
        some, weight = nodes.part(start, size), weights[:, start : start + size]
        ramp = some.ramp if outline.softness_m > 0 else np.zeros((1, 2))
        x, y = outline.points_m(count, ramp)
        if frame.motion.moves and frame.motion.row_s > 0:
            _add_rolling(frame, x, y, some, weight, into, box)
            continue
        x0, y0 = images_of(frame, x, y, some, box)
        x1, y1 = (np.roll(a, -1, axis=1) for a in (x0, y0))
        each = np.repeat(weight, x0.shape[1], axis=1)
        into.add(x0.ravel(), y0.ravel(), x1.ravel(), y1.ravel(), each)


def _add_rolling(frame: Frame, x: Array, y: Array, nodes: Nodes, weights: Array, into: Areas, box: Box | None) -> None:
    """Each row of pixels sees the outline at its own time: add to each row the segments that it can see."""
    motion = frame.motion
    count, size = len(nodes), x.shape[1]
    # Rows beside the window are there for edges to be found outside it.
    low, high = into.row0 - _MAX_ROWS, into.row0 + into.height + _MAX_ROWS
    table = _poses(frame, nodes.time_s[:, None] + motion.row_time_s(np.arange(low, high)))
    node = np.repeat(np.arange(count), size)
    x, y = (np.broadcast_to(a, (count, size)) for a in (x, y))
    x1, y1 = (np.roll(a, -1, axis=1).ravel() for a in (x, y))
    x0, y0 = x.ravel(), y.ravel()

    def at(which: Cells | slice, row: Cells, x: Array, y: Array) -> tuple[Array, Array]:
        i = node[which]
        return image_points(frame, _placed(table[i, row - low], x[which], y[which]), nodes.part(i), box)

    # Which row sees a vertex: known well for the first node, and from there within a row for all.
    first = nodes.part(0, 1)
    _, near = images_of(frame, x[:1], y[:1], first, box)
    row = np.clip(np.rint(near), low, high - 1).astype(np.int64)
    ahead = np.where(row > low, -1, 1)
    beside, here = (
        image_points(frame, _placed(table[:1][0, r - low], x[:1], y[:1]), first, box)[1] for r in (row + ahead, row)
    )
    speed = np.broadcast_to((beside - here) * ahead, (count, size)).ravel()
    fastest = float(np.abs(speed).max())
    everything = slice(None)
    row = np.broadcast_to(row, (count, size)).ravel()
    guess = at(everything, row, x0, y0)[1]
    row = np.clip(np.rint(row + (guess - row) / (1 - speed)), low, high - 1).astype(np.int64)
    px = at(everything, row, x0, y0)
    # In row + d a segment stands at y + speed d: the row sees it if that is within half a row and a segment's length.
    step = np.abs(np.diff(px[1].reshape(count, size), axis=1, append=px[1].reshape(count, size)[:, :1]))
    slack = 0.55 + float(step.max()) + 1.1 * fastest
    reach = int(np.ceil((slack + 0.6 + fastest) / max(1 - fastest, 1e-9)))
    if reach > _MAX_ROWS:
        raise OutrunsShutterError(f"the marker moves by {fastest:.2g} rows while one row is read")
    for d in range(-reach, reach + 1):
        which = np.flatnonzero(np.abs(px[1] + speed * d - row - d) < slack)
        seen = row[which] + d
        keep = (seen >= into.row0) & (seen < into.row0 + into.height)
        which, seen = which[keep], seen[keep]
        start, end = at(which, seen, x0, y0), at(which, seen, x1, y1)
        into.add_to_rows(*start, *end, weights[:, node[which]], seen)
