"""Corners of a dark quadrilateral as intersections of the lines through its four edges, with their covariance.

A corner of a square tag is convex, not a saddle: `cv2.cornerSubPix` pulls it inward by a tenth of a pixel and more,
because the gradients near it belong to two blurred edges. The edges themselves are straight over their whole length in
undistorted coordinates, whatever the blur: a profile across an edge is located by its area, which no symmetric blur
changes, and two lines through the located points meet in the corner.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from roundel.scenes.camera.model import Camera, distort_px, undistort_px

Array = NDArray[np.float64]

# Profiles reach this far from the edge, px, and never over this part of a border's width: behind it is the code.
REACH_PX, REACH_OF_BORDER = 3.0, 0.45
LEAST_REACH_PX = 1.0
# The rounded ends of an edge, where the next one's blur begins, px.
ENDS_PX = 2.0
LEAST_POINTS = 5
ROUNDS = 3
# Error of a located edge that all its points share, px: interpolation between the pixels of a sharp edge.
FLOOR_PX = 0.0015
# Share of the spread of the dark ends' levels, times the reach, that moves an edge: measured on renders.
LEAK = 0.25
# A border narrower than this is nowhere as dark as the ink; each missing pixel moves an edge by this part of one.
WIDE_BORDER_PX, NARROW = 3.0, 0.06
# Grey levels between ink and paper.
LEAST_CONTRAST = 1.0
# Outlying points of an edge are left out beyond this many robust standard deviations.
OUTLIER = 3.5


@dataclass(frozen=True, eq=False)
class QuadCorners:
    """Four corners in undistorted pixels (4, 2), and their covariance (8, 8) in the order x0, y0, x1, ..."""

    corners_px: Array
    cov_px2: Array


@dataclass(frozen=True, eq=False)
class _Line:
    """A line through points: their middle (2,), its angle (rad), their squared distances, count, and squared spread.

    `leak` is an error of the line that its points share, px.
    """

    middle: Array
    angle: float
    left: float
    count: int
    reach: float
    leak: float = 0.0


def refine_quad(grey: ArrayLike, corners_px: ArrayLike, border_share: float, camera: Camera) -> QuadCorners | None:
    """Corners of a dark quadrilateral on light paper from its edges.

    Parameters
    ----------
    grey : (H, W) array_like
        Grey levels, as delivered by the camera.
    corners_px : (4, 2) array_like
        Corners in the image, to within about a pixel; in either order around the quadrilateral.
    border_share : float
        Width of the dark border as a fraction of the side.
    camera : Camera
        Its lens model makes the edges straight.

    Returns
    -------
    QuadCorners or None
        None if an edge is too short, or no edge is there.
    """
    levels = np.asarray(grey, dtype=np.float64)
    corners = undistort_px(camera, corners_px)
    if not np.all(np.isfinite(corners)):
        return None
    cov = np.zeros((8, 8))
    for _ in range(ROUNDS):
        lines = [_edge_line(levels, corners, i, border_share, camera) for i in range(4)]
        found = [line for line in lines if line is not None]
        if len(found) < 4:
            return None
        moved, cov = _intersections(found)
        if not np.all(np.isfinite(moved)) or np.abs(moved - corners).max() > 0.25 * _shortest(corners):
            return None
        corners = moved
    return QuadCorners(corners, cov)


def _shortest(corners: Array) -> float:
    return float(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).min())


def _edge_line(levels: Array, corners: Array, i: int, border_share: float, camera: Camera) -> _Line | None:
    """The line through edge i."""
    start, end = corners[i], corners[(i + 1) % 4]
    length = float(np.linalg.norm(end - start))
    # The border is as wide as its share of the shorter side that meets this edge, seen across.
    across = abs(_cross(end - start, corners[(i + 2) % 4] - end)), abs(_cross(end - start, corners[i - 1] - start))
    count = int(length - 2 * ENDS_PX)
    if count < LEAST_POINTS:
        return None
    share = (ENDS_PX + np.linspace(0, length - 2 * ENDS_PX, count)) / length
    on_line = start + share[:, None] * (end - start)
    image, ahead = distort_px(camera, on_line), distort_px(camera, on_line + 0.5 * (end - start) / length)
    tangent = (ahead - image) / np.linalg.norm(ahead - image, axis=1, keepdims=True)
    outward = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    outward *= np.sign(_cross(end - start, corners.mean(axis=0) - start)) or 1.0
    border = border_share * min(across) / max(length, 1e-9)
    reach = max(min(REACH_PX, REACH_OF_BORDER * border), LEAST_REACH_PX)
    located = _edge_offsets(levels, image, outward, reach)
    if located is None:
        return None
    offsets, leak = located
    points = undistort_px(camera, image + offsets[:, None] * outward)
    keep = np.isfinite(points).all(axis=1)
    line = _fitted_line(points[keep], (end - start) / length)
    return (
        None if line is None else replace(line, leak=float(np.hypot(leak, NARROW * max(0.0, WIDE_BORDER_PX - border))))
    )


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _edge_offsets(levels: Array, image: Array, outward: Array, reach: float) -> tuple[Array, float] | None:
    """Offset of the edge from each point along `outward`, and the error that the code behind the border may add.

    The offset is the area of the profile between the levels at its ends. White cells behind a narrow border brighten
    some dark ends by their blur: the spread of those levels is light that belongs to no edge.
    """
    steps = 2 * int(np.ceil(4 * reach)) + 1
    t = np.linspace(-reach, reach, steps)
    at = image[:, None, :] + t[None, :, None] * outward[:, None, :]
    height, width = levels.shape
    inside = (at >= 0).all(axis=(1, 2)) & (at[..., 0] <= width - 1).all(axis=1) & (at[..., 1] <= height - 1).all(axis=1)
    if inside.sum() < LEAST_POINTS:
        return None
    profile = map_coordinates(levels, [at[..., 1], at[..., 0]], order=1, mode="nearest")
    inner, light = profile[:, :2].mean(axis=1), _light_along(profile[:, -2:].mean(axis=1), inside)
    # Uneven light falls on ink and paper alike.
    dark = float(np.median(inner[inside] / light[inside])) * light
    if np.min(np.abs(light - dark)[inside]) < LEAST_CONTRAST:
        return None
    area = np.trapezoid((profile - dark[:, None]) / (light - dark)[:, None], t, axis=1)
    leak = LEAK * reach * float(np.std((inner - dark)[inside])) / float(np.median(np.abs(light - dark)))
    return np.where(inside & (np.abs(reach - area) < reach), reach - area, np.nan), float(leak)


def _light_along(outer: Array, inside: NDArray[np.bool_]) -> Array:
    """Level of the paper beside each point: a line along the edge through the outer ends, without outliers."""
    place = np.arange(len(outer), dtype=np.float64)
    keep = inside.copy()
    level = np.full(len(outer), float(np.median(outer[inside])))
    for _ in range(3):
        slope, start = np.polyfit(place[keep], outer[keep], 1)
        level = start + slope * place
        left = np.abs(outer - level)
        narrow = left <= max(OUTLIER * 1.4826 * float(np.median(left[keep])), 1e-9)
        if np.count_nonzero(keep & narrow) < LEAST_POINTS:
            break
        keep &= narrow
    return level


def _fitted_line(points: Array, along: Array) -> _Line | None:
    """Least squares of the offset across `along`."""
    across = np.array([-along[1], along[0]])
    keep = np.ones(len(points), dtype=bool)
    for _ in range(3):
        if keep.sum() < LEAST_POINTS:
            return None
        middle = points[keep].mean(axis=0)
        s, d = (points - middle) @ along, (points - middle) @ across
        slope = float(s[keep] @ d[keep] / (s[keep] @ s[keep]))
        left = d - slope * s
        spread = 1.4826 * float(np.median(np.abs(left[keep])))
        keep = np.abs(left) <= max(OUTLIER * spread, 3 * FLOOR_PX)
    angle = float(np.arctan2(along[1], along[0]) + np.arctan(slope))
    return _Line(middle, angle, float(left[keep] @ left[keep]), int(keep.sum()), float(s[keep] @ s[keep]))


def _intersections(lines: list[_Line]) -> tuple[Array, Array]:
    """Corner i, where edges i - 1 and i meet, (4, 2), and the covariance (8, 8) of all four.

    With n . x = n . m for each line, x = N^-1 b; an offset o across line k moves b_k by o, a turn by the distance of
    the corner from the line's middle. The four edges share one blur and one noise: their residuals are pooled.
    """
    corners, jacobian = np.empty((4, 2)), np.zeros((8, 8))
    normal = np.array([[-np.sin(line.angle), np.cos(line.angle)] for line in lines])
    for i in range(4):
        pair = [(i - 1) % 4, i]
        n = normal[pair]
        if abs(np.linalg.det(n)) < 1e-3:
            return np.full((4, 2), np.nan), jacobian
        inverse = np.linalg.inv(n)
        corners[i] = inverse @ np.array([normal[k] @ lines[k].middle for k in pair])
        for column, k in enumerate(pair):
            along = np.array([normal[k, 1], -normal[k, 0]])
            jacobian[2 * i : 2 * i + 2, 2 * k] = inverse[:, column]
            jacobian[2 * i : 2 * i + 2, 2 * k + 1] = inverse[:, column] * float((corners[i] - lines[k].middle) @ along)
    variance = sum(line.left for line in lines) / sum(line.count - 2 for line in lines)
    # The floor is common to an edge's points: it does not average out.
    common = FLOOR_PX**2 + np.array([line.leak for line in lines]) ** 2
    noise = variance + np.array([line.count for line in lines]) * common
    spread = np.stack([noise / [line.count for line in lines], noise / [line.reach for line in lines]], axis=1).ravel()
    return corners, jacobian @ np.diag(spread) @ jacobian.T
