"""The band of pixels around a contour: signed distances, sectors, and the extent of the edge."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.geometry.edge_spread_function import ellipse_curvature
from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.fit.ellipse_distance import foot_points

Array = NDArray[np.float64]

MIN_SECTORS = 12
PLATEAU_PX = 1.5  # width of the flat parts beside the edge that determine the grey levels


@dataclass(frozen=True, eq=False)
class Band:
    """The pixels around a contour, one entry per pixel."""

    pixel_px: Array  # (N, 2)
    value: Array
    distance: Array
    normal: Array  # (N, 2) and (N, 2): see `foot_points`
    u: Array
    half_sum: Array  # (|nu_x| + |nu_y|) / 2 and (|nu_x| - |nu_y|) / 2: corners of the pixel's trapezoid
    half_difference: Array
    curvature: Array
    curvature_ss: Array
    sector: NDArray[np.int64]
    count: int
    expected: Array  # (count,) pixels that a sector would have if all were inside the image


_OF_A_PIXEL = (
    "pixel_px",
    "value",
    "distance",
    "normal",
    "u",
    "half_sum",
    "half_difference",
    "curvature",
    "curvature_ss",
    "sector",
)


def sector_centres(ellipse: Array, count: int) -> tuple[Array, Array, Array]:
    """Foot points, outer normals and unit vectors u (count, 2), as in `foot_points`, at the middle of each sector."""
    knots, lengths = _arc(ellipse)
    t = np.interp((np.arange(count) + 0.5) / count * lengths[-1], lengths, knots)
    angle, a, b = math.radians(ellipse[4]), ellipse[2], ellipse[3]
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    u = np.stack([np.cos(t), np.sin(t)], axis=1)
    normals = u / np.array([a, b])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return u * np.array([a, b]) @ turn + ellipse[:2], normals @ turn, u @ turn


def shape_jacobian(normal: Array, u: Array) -> Array:
    """Derivative (N, 5) of signed distances by (x, y, S11, S12, S22); normals and u as `foot_points` returns them."""
    jacobian = np.empty((len(normal), 5))
    np.negative(normal, out=jacobian[:, :2])
    np.multiply(jacobian[:, :2], u, out=jacobian[:, 2::2])
    jacobian[:, 3] = jacobian[:, 0] * u[:, 1] + jacobian[:, 1] * u[:, 0]
    return jacobian


def _arc(ellipse: Array) -> tuple[Array, Array]:
    """Eccentric angles from 0 to 2 pi, and the arc length up to each."""
    knots = np.linspace(0.0, 2.0 * np.pi, 361)
    middle = (knots[1:] + knots[:-1]) / 2
    speed = np.hypot(ellipse[2] * np.sin(middle), ellipse[3] * np.cos(middle)) * (knots[1] - knots[0])
    return knots, np.concatenate([[0.0], np.cumsum(speed)])


def band_around(image: NDArray[Any], ellipse: Array, limits: tuple[float, float], count: int) -> Band:
    """Pixels whose distance to the contour is within the limits, and within 0.9 b on the inner side."""
    height, width = image.shape
    x, y, a, b, angle_deg = (float(v) for v in ellipse)
    angle = math.radians(angle_deg)
    c, s = math.cos(angle), math.sin(angle)
    inner, outer = max(limits[0], -0.9 * b), limits[1]
    # Bounding box of the ellipse, extended by the outer limit.
    half_w = math.hypot(a * c, b * s) + outer + 1
    half_h = math.hypot(a * s, b * c) + outer + 1
    x0, x1 = max(0, math.floor(x - half_w)), min(width, math.ceil(x + half_w) + 1)
    y0, y1 = max(0, math.floor(y - half_h)), min(height, math.ceil(y + half_h) + 1)
    dx, dy = np.arange(x0, x1) - x, (np.arange(y0, y1) - y)[:, None]
    radius2 = ((c / a) * dx + (s / a) * dy) ** 2 + ((c / b) * dy - (s / b) * dx) ** 2
    # The distance to the contour is at least b |radius - 1|: a cheap superset of the band.
    rows, columns = np.nonzero((radius2 >= max(1 + inner / b, 0.0) ** 2) & (radius2 <= (1 + outer / b) ** 2))
    pixels = np.stack([columns + float(x0), rows + float(y0)], axis=1)
    value = image[rows + y0, columns + x0]
    distance, normal, u = foot_points(ellipse, pixels)
    inside = (distance >= inner) & (distance <= outer)
    pixels, distance, normal, u, value = pixels[inside], distance[inside], normal[inside], u[inside], value[inside]
    ux, uy = u[:, 0] * c + u[:, 1] * s, u[:, 1] * c - u[:, 0] * s
    curvature, curvature_ss = ellipse_curvature(a, b, ux, uy)
    knots, lengths = _arc(ellipse)
    arc = np.interp(np.mod(np.arctan2(uy, ux), 2 * np.pi), knots, lengths)
    sector = np.minimum((arc / lengths[-1] * count).astype(np.int64), count - 1)
    nx, ny = np.abs(normal).T
    return Band(
        pixel_px=pixels,
        value=value.astype(np.float64),
        distance=distance,
        normal=normal,
        u=u,
        half_sum=(nx + ny) / 2,
        half_difference=(nx - ny) / 2,
        curvature=curvature,
        curvature_ss=curvature_ss,
        sector=sector,
        count=count,
        expected=np.full(count, lengths[-1] / count * (outer - inner)),
    )


def within(band: Band, reach: tuple[float, float]) -> Band:
    """The pixels of a band whose distance is within `reach`."""
    keep = (band.distance >= reach[0]) & (band.distance <= reach[1])
    span = (reach[1] - reach[0]) / max(float(np.ptp(band.distance)), 1e-9)
    return replace(kept(band, keep), expected=band.expected * min(span, 1.0))


def by_sector(band: Band) -> Band:
    """The same pixels, sorted by sector."""
    order = np.argsort(band.sector, kind="stable")
    return replace(band, **{name: getattr(band, name).take(order, axis=0) for name in _OF_A_PIXEL})


def kept(band: Band, keep: NDArray[np.bool_]) -> Band:
    """The selected pixels of a band."""
    index = np.flatnonzero(keep)  # computed once instead of for each array
    return replace(band, **{name: getattr(band, name).take(index, axis=0) for name in _OF_A_PIXEL})


def reach_of(band: Band) -> tuple[float, float] | FailedFit:
    """How far the edge and a little plateau extend inward and outward, from the mean profile along the normal.

    It ends where the profile reverses, because another edge begins there (the inner circle of a ring, a nearby border).
    """
    if len(band.value) < 4 * MIN_SECTORS:
        return FailedFit("the contour is outside the image")
    step = 0.5
    low = float(band.distance.min())
    index = ((band.distance - low) / step).astype(np.int64)
    number = np.bincount(index)
    filled = np.flatnonzero(number)
    at = low + (np.arange(len(number)) + 0.5) * step
    profile = np.interp(at, at[filled], np.bincount(index, band.value)[filled] / number[filled])
    slope = np.diff(np.convolve(np.pad(profile, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid"))
    where = (at[1:] + at[:-1]) / 2
    close = np.abs(where) <= 2.5
    if not np.any(close):
        return FailedFit("the contour is too small to have an interior")
    polarity = 1.0 if np.sum(slope[close]) >= 0 else -1.0
    rise = polarity * slope
    top = int(np.argmax(np.where(close, rise, -np.inf)))
    if not rise[top] > 0:
        return FailedFit("no edge along the contour")
    ends = []
    for direction in (-1, 1):
        i = top
        while 0 <= i + direction < len(rise) and rise[i + direction] > 0.05 * rise[top]:
            i += direction
        edge = i
        while (
            0 <= i + direction < len(rise)
            and abs(i - edge) * step < PLATEAU_PX
            and rise[i + direction] > -0.05 * rise[top]
        ):
            i += direction
        ends.append(float(where[i]))
    return ends[0], ends[1]
