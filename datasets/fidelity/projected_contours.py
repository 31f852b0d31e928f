"""Images of a print's edges, by forward projection only.

Through one point of the lens, at one time and one offset of the Airy pattern, the image of an edge is a sharp curve.
A scene point (X, Y, Z) seen through the lens point l of a thin lens focused at u has the undistorted normalised
coordinates (X, Y) / Z + l (1/u - 1/Z); the distortion and K then apply.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.datasets.fidelity.pixel_coverage import Areas
from roundel.datasets.fidelity.print_outlines import Outline
from roundel.datasets.fidelity.quadrature import Nodes
from roundel.scenes.camera.model import denormalise, distort_px
from roundel.scenes.camera.motion import pose_at
from roundel.scenes.markers.surfaces import Curve, lifted
from roundel.scenes.world.frame import Frame

Array = NDArray[np.float64]
Cells = NDArray[np.int64]

# Segments processed at once: small enough for a processor's cache.
_CHUNK = 60_000

# Degree in time of the polynomials for poses over exposure and readout: exact to 1e-12 for a quarter of a turn.
_DEGREE = 12

# Edges faster than this, in rows per row, outrun the shutter; others are found within so many rows of the first guess.
_FASTEST, _MAX_ROWS = 0.8, 24

# Of a pose: the plane's axes and origin first, its normal last.
_COLUMNS = [0, 1, 3, 2]

# Steps to the row that sees a point; each reduces the error by the speed, in rows per row.
_ROW_STEPS = 8


class OutrunsShutterError(ValueError):
    """An edge moves nearly as fast as the rows are read out, so that its image is not predicted."""


@dataclass(frozen=True)
class Box:
    """A box (x, y) of undistorted normalised coordinates.

    Edges far from the circle of interest are clamped to it: this changes nothing inside, and avoids points that the
    lens cannot image.
    """

    low: Array
    high: Array


def image_points(
    frame: Frame, points: list[Array], lens_m: Array, airy_px: Array, box: Box | None = None
) -> tuple[Array, Array]:
    """Images of points of the camera frame (three arrays), given points of lens and Airy pattern (2, ...)."""
    camera = frame.camera
    x, y, z = points
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(z > 0, 1 / z, np.nan)
    out_of_focus = 1 / camera.focus_distance_m - inverse
    straight = np.stack([x * inverse + lens_m[0] * out_of_focus, y * inverse + lens_m[1] * out_of_focus], axis=-1)
    if box is not None:
        straight = np.clip(straight, box.low, box.high)
    px = distort_px(camera, denormalise(camera, straight))
    return px[..., 0] - airy_px[0], px[..., 1] - airy_px[1]


def _placed(curve: Curve | None, pose: Array, x: Array, y: Array) -> list[Array]:
    """Points of a sheet's paper in the camera frame, given poses (..., 3, 4) with columns x, y, origin and z axis."""
    if curve is None:
        return [pose[..., i, 0] * x + pose[..., i, 1] * y + pose[..., i, 2] for i in range(3)]
    at = lifted(curve, x, y)
    x, y, z = at[..., 0], at[..., 1], at[..., 2]
    return [pose[..., i, 0] * x + pose[..., i, 1] * y + pose[..., i, 3] * z + pose[..., i, 2] for i in range(3)]


def _poses(frame: Frame, time: Array) -> Array:
    """Poses (..., 3, 4) with columns x axis, y axis, origin and z axis, at times (...)."""
    if not frame.motion.moves:
        return np.broadcast_to(frame.camera_from_sheet[:3, _COLUMNS], (*time.shape, 3, 4))
    middle, half = (time.max() + time.min()) / 2, max((time.max() - time.min()) / 2, 1e-12)
    knots = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    known = pose_at(frame.motion, frame.camera_from_sheet, middle + half * knots)[:, :3][:, :, _COLUMNS]
    vander = np.polynomial.chebyshev.chebvander
    coefficients = np.linalg.solve(vander(knots, _DEGREE), known.reshape(-1, 12))
    table = vander(((time - middle) / half).ravel(), _DEGREE) @ coefficients
    return np.asarray(table.reshape(*time.shape, 3, 4), dtype=np.float64)


def images_of(frame: Frame, x: Array, y: Array, nodes: Nodes, box: Box | None = None) -> tuple[Array, Array]:
    """Images (n, v) of points of the sheet (n or 1, v) at n nodes, each at the time of the row that sees it."""
    shape = np.broadcast_shapes(x.shape, (len(nodes), x.shape[1]))
    x, y = np.broadcast_to(x, shape), np.broadcast_to(y, shape)
    # Under a global shutter a node has one time for all points.
    rolls = frame.motion.moves and frame.motion.row_s > 0
    row = np.full(shape if rolls else (len(nodes), 1), frame.motion.centre_row_px)
    for _ in range(_ROW_STEPS if rolls else 1):
        pose = _poses(frame, nodes.time_s[:, None] + frame.motion.row_time_s(row))
        px = image_points(
            frame, _placed(frame.sheet.curve, pose, x, y), nodes.lens_m.T[:, :, None], nodes.airy_px.T[:, :, None], box
        )
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
        Number of vertices of the polygon that approximates the outline.
    weights : (kinds, n) array
        Weight of each node, for each kind of sum.
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
    """Add to each row of pixels the segments that it sees at its own time."""
    motion = frame.motion
    count, size = len(nodes), x.shape[1]
    # Rows beside the window let edges be found outside it.
    low, high = into.row0 - _MAX_ROWS, into.row0 + into.height + _MAX_ROWS
    table = _poses(frame, nodes.time_s[:, None] + motion.row_time_s(np.arange(low, high)))
    node = np.repeat(np.arange(count), size)
    x, y = (np.broadcast_to(a, (count, size)) for a in (x, y))
    x1, y1 = (np.roll(a, -1, axis=1).ravel() for a in (x, y))
    x0, y0 = x.ravel(), y.ravel()

    lens, airy = (np.repeat(a.T, size, axis=1) for a in (nodes.lens_m, nodes.airy_px))

    def at(which: Cells | slice, row: Cells, x: Array, y: Array) -> tuple[Array, Array]:
        points = _placed(frame.sheet.curve, table[node[which], row - low], x[which], y[which])
        return image_points(frame, points, lens[:, which], airy[:, which], box)

    # Row that sees a vertex: solved for the first node, and within a row of that for all others.
    _, near = images_of(frame, x[:1], y[:1], nodes.part(0), box)
    row = np.clip(np.rint(near), low, high - 1).astype(np.int64)
    ahead = np.where(row > low, -1, 1)
    one = slice(size)
    beside, here = (at(one, r[0], x0, y0)[1] for r in (row + ahead, row))
    speed = np.tile((beside - here) * ahead[0], count)
    fastest = float(np.abs(speed).max())
    everything = slice(None)
    row = np.broadcast_to(row, (count, size)).ravel()
    guess = at(everything, row, x0, y0)[1]
    row = np.clip(np.rint(row + (guess - row) / (1 - speed)), low, high - 1).astype(np.int64)
    px = at(everything, row, x0, y0)
    if fastest >= _FASTEST:
        raise OutrunsShutterError(f"the marker moves by {fastest:.2g} rows while one row is read out")
    # In row + d a segment from y to y + rise is at y + speed d; its other end is seen some rows away.
    rise = (np.roll(px[1].reshape(count, size), -1, axis=1) - px[1].reshape(count, size)).ravel()
    top, bottom = px[1] + np.minimum(rise, 0.0) - row, px[1] + np.maximum(rise, 0.0) - row
    slack = 0.52 + 2.2 * fastest
    found = (row > low) & (row < high - 1)
    farthest = max(float(-top[found].min(initial=0.0)), float(bottom[found].max(initial=0.0)))
    reach = min(int(np.ceil((slack + farthest) / (1 - fastest))), _MAX_ROWS)
    for d in range(-reach, reach + 1):
        ahead_of = (1 - speed) * d
        seen = row + d
        which = np.flatnonzero(
            (bottom > ahead_of - slack)
            & (top < ahead_of + slack)
            & (seen >= into.row0)
            & (seen < into.row0 + into.height)
        )
        seen = seen[which]
        start, end = at(which, seen, x0, y0), at(which, seen, x1, y1)
        into.add_to_rows(*start, *end, weights[:, node[which]], seen)
