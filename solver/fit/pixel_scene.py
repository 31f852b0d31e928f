"""The data of a pixel fit: pixels of the edge, the plateaus beside it, and functions of the grey levels.

Inside and outside each have a level that varies across the marker as a sum of smooth functions: 1; x and y (light
fall-off); their squares (a nearby lamp). Each order costs some precision of the ellipse, so it is used only if the
pixels show it. What they do not follow is the matter of `local_light`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, undistort_px
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.fit.band_pixels import place_pixels
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.fit.ellipse import FailedFit, fit_ellipse
from roundel.solver.kernels.contour_band import (
    clipping,
    contour_band,
    edge_functions,
    edge_pixels,
    flat_reach,
    plateau_pixels,
    side_functions,
)
from roundel.solver.kernels.contour_pixels import DISTANCE
from roundel.solver.kernels.contour_scene import plateau_sums

Array = NDArray[np.float64]

SIZES = (3, 6)  # level functions per side: a gradient, and what is of second order
_WIDER_PX = 6  # plateaus extend this much farther than in `edge_points`, as long as they are flat
_WIDER_BLURS = 2.5  # and this many sigmas of the blur
_CLIPPED_PX = 3.0  # of a clipped plateau this much counts, as part of the edge
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
    sector, distance : (N,) arrays
        Sectors of the contour, and distances from it, px.
    """

    basis: Array
    value: Array
    sector: NDArray[np.int64]
    distance: Array


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
    sectors : (N,) array
        Sectors of the edge's pixels.
    light : (N, 5) array
        Local departures of the levels, see `pixel_equations`; empty without any.
    plateaus : (Plateau, Plateau)
        Inside and outside, without local departures of the levels.
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
    sectors: NDArray[np.int64]
    light: Array
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
    reach = _EDGE_SIGMAS * math.sqrt(edges.blur_px**2 + PIXEL_VARIANCE) + 0.8
    band, found = contour_band(image, edges.ellipse, low - wider, high + wider, reach + _CLIPPED_PX, trusted)
    sectors = int(np.count_nonzero(trusted))
    if not sectors or not len(band):
        return FailedFit("the contour is outside the image")
    count, limits = len(trusted), np.array([low, high])
    ends = flat_reach(band, count, limits, edges.contrast_dn, edges.noise_dn, reach, wider)
    clip_dn, clips_inside, clips_outside, share = clipping(band, ends, float(full_scale_dn), count, sectors)
    first, last = -reach - _CLIPPED_PX * clips_inside, reach + _CLIPPED_PX * clips_outside
    edge, starts, jacobian = edge_pixels(band, found, first, last, ends, count)
    # A clipped plateau tells nothing of its level.
    inside = plateau_pixels(band, math.inf if clips_inside else -math.inf, first, ends, count)
    outside = plateau_pixels(band, math.inf if clips_outside else last, math.inf, ends, count)
    pixels = len(edge) + len(inside) + len(outside)
    if pixels < _FEWEST or len(edge) < _FEWEST // 3:
        return FailedFit("too few pixels along the contour")
    ellipse = _start(edges, lens)
    if isinstance(ellipse, FailedFit):
        return ellipse
    if lens is not None:
        placed = place_pixels(edge, ellipse, lens)
        if isinstance(placed, FailedFit):
            return placed
        jacobian = placed
    centre, size_px = edges.ellipse[:2].copy(), max(float(edges.ellipse[2]), 2.0)
    most = _most_functions(pixels, (clips_inside, clips_outside))
    basis, basis_slope, place = edge_functions(edge, centre, size_px, most)
    plateaus = (
        Plateau(*side_functions(inside, centre, size_px, most)),
        Plateau(*side_functions(outside, centre, size_px, most)),
    )
    return PixelScene(
        ellipse,
        edge,
        starts,
        jacobian,
        basis,
        basis_slope,
        place,
        np.repeat(np.arange(count), np.diff(starts)),
        np.empty((0, 5)),
        plateaus,
        lens,
        clip_dn,
        (clips_inside, clips_outside),
        share,
    )


def lit_scene(
    scene: PixelScene, trusted: NDArray[np.bool_], planes: Array | None = None, shares: Array | None = None
) -> PixelScene:
    """The trusted sectors of a scene, with planes (S, 6) added to their levels: see `local_light`."""
    if planes is None and trusted.all():
        return scene
    keep = trusted[scene.sectors]
    sectors = scene.sectors[keep]
    table = scene.table[keep]
    light = scene.light
    if planes is not None and shares is not None:
        p, d = planes[sectors], table[:, DISTANCE]
        columns = (p[:, 0] + d * p[:, 1], p[:, 3] + d * p[:, 4], p[:, 1], p[:, 4], shares[sectors])
        light = np.stack(columns, axis=1)
    plateaus = []
    for side, plateau in enumerate(scene.plateaus):
        kept = trusted[plateau.sector]
        sector, distance, value = plateau.sector[kept], plateau.distance[kept], plateau.value[kept]
        if planes is not None:
            value = value - planes[sector, 3 * side] - distance * planes[sector, 3 * side + 1]
        plateaus.append(Plateau(plateau.basis[kept], value, sector, distance))
    return replace(
        scene,
        table=table,
        starts=np.concatenate([[0], np.cumsum(np.bincount(sectors, minlength=len(trusted)))]),
        jacobian=scene.jacobian[keep],
        basis=scene.basis[keep],
        basis_slope=scene.basis_slope[keep],
        place=scene.place[keep],
        sectors=sectors,
        light=light,
        plateaus=(plateaus[0], plateaus[1]),
    )


def _most_functions(pixels: int, clipped: tuple[bool, bool]) -> int:
    """The largest number of level functions that this number of pixels can determine."""
    if any(clipped):  # what a clipped level does beside the edge is unknown
        return SIZES[0]
    return SIZES[1] if pixels > 40 * SIZES[1] else SIZES[0]


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
