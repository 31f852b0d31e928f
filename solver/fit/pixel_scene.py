"""The data of a pixel fit: pixels of the edge, the plateaus beside it, and functions of the grey levels.

Inside and outside each have a level that varies across the marker as a sum of smooth functions: 1; x and y (light
fall-off); their squares (a nearby lamp); harmonics of the direction from the centre (a soft shadow, a highlight). Each
order costs some precision of the ellipse, so it is used only if the pixels show it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, undistort_px
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.fit.band_pixels import place_pixels
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.fit.ellipse import FailedFit, fit_ellipse
from roundel.solver.kernels.contour_pixels import DISTANCE, NORMAL_X, VALUE, X, contour_pixels
from roundel.solver.kernels.contour_scene import flat_reach, level_functions, plateau_sums, split_pixels

Array = NDArray[np.float64]

SIZES = (1, 3, 6, 14)  # level functions per side of each order
_WIDER_PX = 6  # plateaus extend this much farther than in `edge_points`, as long as they are flat
_WIDER_BLURS = 2.5  # and this many sigmas of the blur
_SATURATED = 254.5 / 255.0  # fraction of the full scale
_CLIPPED = 0.002  # fraction of a plateau: more than a few hot pixels
_CLIPPED_PX = 3.0  # of a clipped plateau this much counts, as part of the edge
_SHADES = 0.4  # pixels with a shade between the levels, per sector: an edge has about two, a binary mask none
_EDGE_SIGMAS = 3.5  # of the blur with the pixel, plus a pixel's half diagonal: the step has ended there
_FEWEST = 40


@dataclass(frozen=True, eq=False)
class Plateau:
    """Pixels on one side of the edge that depend only on their grey level.

    Attributes
    ----------
    basis : (N, K) array
        The level functions at each pixel.
    value : (N,) array
        Grey levels.
    """

    basis: Array
    value: Array


@dataclass(frozen=True, eq=False)
class PixelScene:
    """The data of a fit; the level functions are in the order in which they are added.

    Attributes
    ----------
    ellipse : (5,) array
        Starting ellipse, in undistorted pixel coordinates.
    table, starts : (N, 12) and (count + 1,) arrays
        The edge's pixels, see `contour_pixels`.
    jacobian : (N, 5) array
        Derivative of their distances by (x, y, S11, S12, S22).
    basis, basis_slope : (N, K) arrays
        The functions at the edge's pixels, and their change along the normal, 1/px.
    place : (N, 2) array
        Positions of the foot points relative to the centre, in semi-major axes.
    plateaus : (Plateau, Plateau)
        Inside and outside.
    lens : Camera or None
        With distortion.
    clip_dn : float
        The level at which pixels clip; infinite if no pixel of this contour does.
    clipped : (bool, bool)
        Whether the plateau inside and outside is clipped.
    clipped_fraction : float
        Of the pixels of the edge and its plateaus.
    """

    ellipse: Array
    table: Array
    starts: NDArray[np.int64]
    jacobian: Array
    basis: Array
    basis_slope: Array
    place: Array
    plateaus: tuple[Plateau, Plateau]
    lens: Camera | None
    clip_dn: float
    clipped: tuple[bool, bool]
    clipped_fraction: float


def scene_of(
    image: NDArray[np.float32],
    edges: EdgePoints,
    lens: Camera | None,
    full_scale_dn: float,
    trusted: NDArray[np.bool_] | None = None,
) -> PixelScene | FailedFit:
    """Collect the pixels along a contour: those of trusted sectors, as far out as the plateaus are flat.

    `trusted` (S,) takes the place of the contour's own.
    """
    trusted = edges.trusted if trusted is None else trusted
    wider = round(_WIDER_PX + _WIDER_BLURS * edges.blur_px)
    low, high = edges.reach_px
    table, starts = contour_pixels(image, edges.ellipse, low - wider, high + wider, len(trusted))
    if not np.any(trusted) or not len(table):
        return FailedFit("the contour is outside the image")
    ends = flat_reach(table, starts, trusted, np.array([low, high]), edges.contrast_dn, edges.noise_dn, wider)
    clip_dn, clipped, share = _clipping(table, starts, trusted, ends, full_scale_dn)
    reach = _EDGE_SIGMAS * math.sqrt(edges.blur_px**2 + PIXEL_VARIANCE) + 0.8
    between = np.array([-reach - _CLIPPED_PX * clipped[0], reach + _CLIPPED_PX * clipped[1]])
    edge, starts, inside, outside = split_pixels(table, starts, trusted, ends, between)
    if len(edge) + len(inside) + len(outside) < _FEWEST or len(edge) < _FEWEST // 3:
        return FailedFit("too few pixels along the contour")
    ellipse = _start(edges, lens)
    if isinstance(ellipse, FailedFit):
        return ellipse
    jacobian = place_pixels(edge, ellipse, lens)
    if isinstance(jacobian, FailedFit):
        return jacobian
    centre, size_px = edges.ellipse[:2], max(float(edges.ellipse[2]), 2.0)
    most = _most_functions(len(edge) + len(inside) + len(outside), clipped)

    def functions(x: Array, y: Array) -> Array:
        return level_functions(x, y, centre, size_px, most)

    x, y = edge[:, X], edge[:, X + 1]
    nx, ny = edge[:, NORMAL_X], edge[:, NORMAL_X + 1]
    basis = functions(x, y)
    feet = edge[:, X : X + 2] - edge[:, DISTANCE, None] * edge[:, NORMAL_X : NORMAL_X + 2]
    plateaus = [
        Plateau(functions(p[:, X], p[:, X + 1]), p[:, VALUE].copy()) if not c else Plateau(basis[:0], edge[:0, VALUE])
        for p, c in zip((inside, outside), clipped, strict=True)
    ]
    return PixelScene(
        ellipse,
        edge,
        starts,
        jacobian,
        basis,
        functions(x + nx, y + ny) - basis,
        (feet - centre) / size_px,
        (plateaus[0], plateaus[1]),
        lens,
        clip_dn,
        clipped,
        share,
    )


def _clipping(
    table: Array, starts: NDArray[np.int64], trusted: NDArray[np.bool_], ends: Array, full_scale_dn: float
) -> tuple[float, tuple[bool, bool], float]:
    """The clipping level of a contour (infinite without clipped pixels), which plateaus clip, and the clipped share."""
    sector = np.repeat(np.arange(len(trusted)), np.diff(starts))
    used = trusted[sector] & (table[:, DISTANCE] >= ends[0]) & (table[:, DISTANCE] <= ends[1])
    value, distance = table[used, VALUE], table[used, DISTANCE]
    clip_dn = full_scale_dn * _SATURATED
    over = value >= clip_dn
    if not np.any(over):
        return math.inf, (False, False), 0.0
    margin = 0.05 * float(np.ptp(value))
    shades = np.count_nonzero((value > value.min() + margin) & (value < value.max() - margin))
    if shades <= _SHADES * np.count_nonzero(trusted):  # a binary mask: nothing tells whether it is clipped
        return math.inf, (False, False), 0.0
    inside, outside = (float(np.mean(over[side])) if side.any() else 0.0 for side in (distance < 0, distance > 0))
    return clip_dn, (inside > _CLIPPED, outside > _CLIPPED), float(np.mean(over))


def _most_functions(pixels: int, clipped: tuple[bool, bool]) -> int:
    """The largest number of level functions that this number of pixels can determine."""
    if any(clipped):  # what a clipped level does beside the edge is unknown
        return SIZES[1]
    return SIZES[3] if pixels > 40 * SIZES[3] else SIZES[2] if pixels > 40 * SIZES[2] else SIZES[1]


def _start(edges: EdgePoints, lens: Camera | None) -> Array | FailedFit:
    """Starting ellipse in undistorted pixel coordinates."""
    if lens is None:
        return edges.ellipse.copy()
    points = undistort_px(lens, edges.points_px)
    good = np.isfinite(points).all(axis=1)
    fit = fit_ellipse(points[good], edges.sigma_px[good])
    return fit if isinstance(fit, FailedFit) else fit.ellipse


def sums_of(scene: PixelScene, levels: Array) -> tuple[Array, Array, Array, Array]:
    """Sums over both plateaus without their stains, see `plateau_sums`: (2, k, k), (2, k), (2,), (2,)."""
    k = levels.shape[1]
    grams, moments, squares, counts = np.empty((2, k, k)), np.empty((2, k)), np.empty(2), np.empty(2)
    for i, plateau in enumerate(scene.plateaus):
        squares[i], counts[i] = plateau_sums(
            plateau.basis, plateau.value, levels[i], scene.clip_dn, grams[i], moments[i]
        )
    return grams, moments, squares, counts
