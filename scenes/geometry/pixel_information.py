"""Fisher information of an ellipse's shape in the pixels about its contour.

Unknown beside the shape, and eliminated by a Schur complement: one pair of grey levels and one blur; where
`EdgeConditions` say so, the width of the ink's own soft edge, the smear of the blur by motion during the exposure, and
the motion during the readout, under its prior.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roundel.scenes.geometry.edge_spread_function import (
    PIXEL_VARIANCE,
    curved_distance,
    ellipse_curvature,
    step_response,
)

Array = NDArray[np.float64]

# Quadrature over a band of pixels: angles (for a blunt ellipse, for others), and Gauss-Legendre nodes across it before,
# within and beyond six sigma of the edge. The error against many more nodes is within 0.3 % for sharp edges, where the
# response has corners, and 3 % if the blur is half of the minor semi-axis.
_ANGLES, _NODES = (32, 96), (4, 48, 4)
# Information ends within a few per cent of an edge whose light side clips: four times the nodes resolve that.
_CLIPPED_NODES = (16, 192, 16)
_SHARPEST_PX = 0.05  # a blur below it counts as none; it keeps the response differentiable
_SUBDIVISIONS = 16  # of the interval of one angle, to find its visible share


@dataclass(frozen=True, eq=False)
class EdgeConditions:
    """What limits the information of an edge's pixels beside their noise; by default, nothing.

    Attributes
    ----------
    saturation_dn : float
        Level at which pixels clip: a clipped pixel only says that it is at least as bright.
    variance_dn2 : callable or None
        Variance of pixels of given mean levels, instead of the two values of `noise_dn`.
    ink_sigma : float
        Standard deviation of the ramp between ink and paper, as a fraction of the circle's radius: a ramp of full width
        w counts as a Gaussian of variance w^2 / 12. Across the image of the edge it is this times the ellipse's support
        function h(n), the distance of the tangent from the centre. If positive, its width is unknown.
    visible : tuple of (m, 2) array and (m,) array of bool, or None
        Points of the contour, and which of them are seen; pixels count as the nearest of them in angle.
    smeared : bool
        Whether the blur differs between directions by an unknown symmetric matrix without trace.
    drift : (5, k) array or None
        Change of the shape (x, y, S11, S12, S22) per pixel of readout for each of k unknown, independent motions of
        unit variance.
    readout : (2,) array or None
        Direction in which rows are read, a unit vector of the image.
    reference_px : (2,) array or None
        Point whose row is exposed at the time of the shape.
    """

    saturation_dn: float = math.inf
    variance_dn2: Callable[[Array], Array] | None = None
    ink_sigma: float = 0.0
    visible: tuple[Array, NDArray[np.bool_]] | None = None
    smeared: bool = False
    drift: Array | None = None
    readout: Array | None = None
    reference_px: Array | None = None


def censored_information(mean: ArrayLike, sigma: ArrayLike, limit: float) -> Array:
    """Information of min(y, limit) about the mean of a Gaussian y, over that of y itself (Amemiya 1973).

    With z = (limit - mean) / sigma: Phi(z) - z phi(z) + phi(z)^2 / (1 - Phi(z)).
    """
    from scipy.special import log_ndtr, ndtr

    if not math.isfinite(limit):
        return np.ones(np.broadcast_shapes(np.shape(mean), np.shape(sigma)))
    # Beyond 35 sigma the result is 1 or 0 to all digits.
    z = np.clip((limit - np.asarray(mean, dtype=np.float64)) / np.asarray(sigma, dtype=np.float64), -35.0, 35.0)
    log_density = -0.5 * z * z - 0.5 * math.log(2 * math.pi)
    # The tail's logarithm: phi^2 / (1 - Phi) is finite far above the mean, where both vanish.
    tail = np.exp(2 * log_density - log_ndtr(-z))
    return np.asarray(np.clip(ndtr(z) - z * np.exp(log_density) + tail, 0.0, 1.0), dtype=np.float64)


def shape_information_of_pixels(
    ellipse: ArrayLike,
    inside_dn: float,
    outside_dn: float,
    blur_px: float,
    noise_dn: float | tuple[float, float],
    reach_px: float = 8.0,
    conditions: EdgeConditions | None = None,
) -> Array:
    """Fisher information of pixels about the shape of an ellipse, with unknown grey levels and blur.

    A pixel is inside + (outside - inside) T(z) with Gaussian noise, T and z as in `scenes.edge_spread_function`. Pixels
    are dense and at all phases: their sum is the integral over the band. One pair of grey levels and one blur (the
    variance b^2 in T, to which the pixel adds its square) are unknown and eliminated by a Schur complement. If they
    were known, the bound would be 1.2 to 1.5 times smaller.

    Parameters
    ----------
    ellipse : (5,) array_like
        x_px, y_px, a_px, b_px, angle_deg.
    inside_dn, outside_dn : float
        Levels without clipping.
    blur_px : float
        Gaussian sigma, without the pixel and without the ink's own ramp.
    noise_dn : float or (float, float)
        Standard deviation of a pixel, or of a pixel inside and one outside.
    reach_px : float
        Distance from the contour up to which pixels count, beyond five sigma of the blur: they determine the grey
        levels. Above 6 px it changes the result by less than a tenth.
    conditions : EdgeConditions, optional

    Returns
    -------
    (5, 5) array
        Parameters x, y, S11, S12, S22 (px), where the contour is {(x, y) + S u, |u| = 1} with S symmetric.

    Raises
    ------
    ValueError
        If there is no contrast, or if noise, blur or axes are not positive numbers.
    """
    given = conditions if conditions is not None else EdgeConditions()
    x, y, a, b, angle = (float(v) for v in np.asarray(ellipse, dtype=np.float64))
    noise = np.broadcast_to(np.asarray(noise_dn, dtype=np.float64), (2,))
    height = outside_dn - inside_dn
    if not (math.isfinite(height) and height != 0):
        raise ValueError("inside_dn and outside_dn must differ: without contrast there is no edge")
    if not (np.all(noise > 0) and b > 0 and blur_px >= 0 and reach_px > 0):
        raise ValueError("noise_dn, reach_px and the semi-axes must be positive, blur_px not negative")
    lens = max(blur_px, _SHARPEST_PX) ** 2
    # If no normals cross within the edge's reach, the integrand is smooth everywhere.
    widest = math.sqrt(lens + (given.ink_sigma * a) ** 2 + PIXEL_VARIANCE)
    angles = _ANGLES[b * b / a < 6.0 * widest or given.visible is not None]
    t = np.asarray((np.arange(angles) + 0.5) * (2 * np.pi / angles), dtype=np.float64)
    speed = np.hypot(a * np.sin(t), b * np.cos(t))
    support = a * b / speed
    variance = lens + (given.ink_sigma * support) ** 2
    clipped = max(inside_dn, outside_dn) + 6.0 * noise.max() > given.saturation_dn
    curvature, curvature_ss = ellipse_curvature(a, b, np.cos(t), np.sin(t))
    distance, step = _across(curvature, reach_px, widest, _CLIPPED_NODES if clipped else _NODES)
    count = distance.shape[1]
    area = (speed * (2 * np.pi / angles))[:, None] * step * (1.0 + curvature[:, None] * distance)
    local_normal = np.stack([b * np.cos(t), a * np.sin(t)], axis=-1) / speed[:, None]
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    turn = np.array([[c, s], [-s, c]])
    normal, u = local_normal @ turn, np.stack([np.cos(t), np.sin(t)], axis=-1) @ turn
    contour = np.array([x, y]) + np.stack([a * np.cos(t), b * np.sin(t)], axis=-1) @ turn
    if given.visible is not None:
        area *= _visible_share(given.visible, np.array([x, y, a, b]), turn, np.asarray(t, dtype=np.float64))[:, None]
    rows = np.column_stack(
        [normal, normal[:, 0] * u[:, 0], normal[:, 0] * u[:, 1] + normal[:, 1] * u[:, 0], normal[:, 1] * u[:, 1]]
    )

    def each(values: Array) -> Array:
        return np.repeat(values, count, axis=0)

    nx, ny = each(np.abs(normal)).T
    v = each(variance)
    z, moved = curved_distance(distance.ravel(), each(curvature), each(curvature_ss), v + PIXEL_VARIANCE)
    response, slope, bend = step_response(z, (nx + ny) / 2, (nx - ny) / 2, v)
    shape = each(rows) * (-height * slope)[:, None]
    wider = height * (bend / 2 + slope * moved)
    columns = [shape, wider[:, None], (1.0 - response)[:, None], response[:, None]]
    if given.smeared:
        # What a smear adds to the variance across the edge it takes from that along it, which shifts a curved edge.
        smear = (height * (bend - slope * each(curvature)) / 2)[:, None]
        columns.append(
            smear * each(np.stack([normal[:, 0] ** 2 - normal[:, 1] ** 2, 2 * normal[:, 0] * normal[:, 1]], -1))
        )
    if given.ink_sigma > 0:
        columns.append((wider * each((support / a) ** 2))[:, None])
    known = sum(column.shape[1] for column in columns)  # what is before the motions, which have a prior
    if given.drift is not None and given.readout is not None and given.reference_px is not None:
        px = each(contour) + distance.ravel()[:, None] * each(normal)
        columns.append((shape @ given.drift) * ((px - given.reference_px) @ given.readout)[:, None])
    design = np.concatenate(columns, axis=1)
    level = inside_dn + height * response
    spread = noise[0] ** 2 * (1.0 - response) + noise[1] ** 2 * response
    if given.variance_dn2 is not None:
        spread = given.variance_dn2(level)
    weight = area.ravel() / spread
    if clipped:
        weight = weight * censored_information(level, np.sqrt(spread), given.saturation_dn)
    full = design.T @ (design * weight[:, None])
    full[np.arange(known, len(full)), np.arange(known, len(full))] += 1.0
    return _eliminated(full, singular=given.ink_sigma > 0)


def _eliminated(full: Array, singular: bool) -> Array:
    """Information of the first five parameters, the others unknown; `singular` if they may be collinear.

    On a circle the ink's ramp and the blur have the same effect, and only their sum is a nuisance: the pseudo-inverse
    leaves out what has no effect.
    """
    others = full[5:, 5:]
    if not singular:
        return np.asarray(full[:5, :5] - full[:5, 5:] @ np.linalg.solve(others, full[5:, :5]), dtype=np.float64)
    scale = 1 / np.sqrt(np.diag(others))
    inverse = np.linalg.pinv(others * scale[:, None] * scale, rcond=1e-10, hermitian=True) * scale[:, None] * scale
    return np.asarray(full[:5, :5] - full[:5, 5:] @ inverse @ full[5:, :5], dtype=np.float64)


def _across(curvature: Array, reach_px: float, widest: float, nodes: tuple[int, int, int]) -> tuple[Array, Array]:
    """Distances from the contour, and weights (angles, nodes), of a quadrature across the band at each angle."""
    # Normals cross beyond the centre of curvature: pixels there are counted from another part of the contour.
    far = reach_px + 5.0 * widest
    near = np.maximum(-far, -1.0 / curvature)
    ends = [near, np.maximum(near, -6.0 * widest), np.full_like(near, 6.0 * widest), np.full_like(near, far)]
    parts = zip(*map(_intervals, ends, ends[1:], nodes), strict=True)
    distance, step = (np.concatenate(part, axis=1) for part in parts)
    return distance, step


@lru_cache
def _legendre(count: int) -> tuple[Array, Array]:
    x, w = np.polynomial.legendre.leggauss(count)
    return x, w


def _intervals(low: Array, high: Array, count: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights (n, count) of each of n intervals."""
    x, w = _legendre(count)
    half = (high - low)[:, None] / 2
    return low[:, None] + half * (1.0 + x), half * w


def _visible_share(visible: tuple[Array, NDArray[np.bool_]], axes: Array, turn: Array, t: Array) -> Array:
    """Share of the interval about each angle t whose nearest points of the contour are seen."""
    points, seen = visible
    u = (points - axes[:2]) @ turn.T / axes[2:]
    at = np.arctan2(u[:, 1], u[:, 0]) % (2 * np.pi)
    order = np.argsort(at)
    at, seen = at[order], np.asarray(seen, dtype=bool)[order]
    step = 2 * np.pi / len(t)
    fine = (t[:, None] + step * ((np.arange(_SUBDIVISIONS) + 0.5) / _SUBDIVISIONS - 0.5)) % (2 * np.pi)
    middles = np.concatenate([at[:-1] + np.diff(at) / 2, [(at[-1] + at[0] + 2 * np.pi) / 2]])
    nearest = np.searchsorted(middles, np.where(fine < middles[-1] - 2 * np.pi, fine + 2 * np.pi, fine)) % len(at)
    return np.asarray(seen[nearest].mean(axis=1), dtype=np.float64)
