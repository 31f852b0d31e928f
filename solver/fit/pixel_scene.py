"""The data of a pixel fit: pixels of the edge, the plateaus beside it, and basis functions of the grey levels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.scenes.camera.model import Camera, undistort_px
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE
from roundel.solver.fit.band_pixels import BandPixels, band_pixels
from roundel.solver.fit.edge_band import Band, band_around, kept, shape_jacobian
from roundel.solver.fit.edges import EdgePoints
from roundel.solver.fit.ellipse import FailedFit, fit_ellipse, shape_of_ellipse
from roundel.solver.fit.grey_levels import Plateau, best_order, level_basis

Array = NDArray[np.float64]

_WIDER_PX = 6  # plateaus extend this much farther than in `edges`, as long as they are flat
_WIDER_BLURS = 2.5  # and this many sigmas of the blur
_LAST_PX = 1.5  # outermost part of a plateau of `edges`, with which pixels beyond it are compared
_FLAT = 0.01  # fraction of the contrast
_GROUPS = 12  # directions in which a plateau's flatness is tested
_SATURATED = 254.5 / 255.0  # fraction of the full scale
_MOST_SATURATED = 0.1
_EDGE_SIGMAS = 5.0  # of the blur with the pixel, plus a pixel's half diagonal: the step has ended there
_FEWEST = 40


@dataclass(frozen=True, eq=False)
class Scene:
    """The data of a fit; the level functions are in the order in which they are added.

    Attributes
    ----------
    theta : (5,) array
        Starting shape x, y, S11, S12, S22, in undistorted pixel coordinates.
    pixels : BandPixels
        The edge's pixels, with their distances to it.
    basis, basis_slope : (N, k) arrays
        The functions at the edge's pixels, and their change along the normal, 1/px.
    place : (N, 2) array
        Positions of the foot points relative to the centre, in semi-major axes.
    plateaus : (Plateau, Plateau)
        Pixels inside and outside that depend only on their grey level.
    lens : Camera or None
        With distortion.
    """

    theta: Array
    pixels: BandPixels
    basis: Array
    basis_slope: Array
    place: Array
    plateaus: tuple[Plateau, Plateau]
    lens: Camera | None


def scene_of(image: NDArray[Any], edges: EdgePoints, lens: Camera | None, full_scale_dn: float) -> Scene | FailedFit:
    """Collect the pixels along a contour: those of trusted sectors, as far out as the plateaus are flat."""
    low, high = edges.reach_px
    wider = round(_WIDER_PX + _WIDER_BLURS * edges.blur_px)
    band = band_around(image, edges.ellipse, (low - wider, high + wider), len(edges.trusted))
    used = edges.trusted[band.sector]
    if not np.any(used):
        return FailedFit("the contour is outside the image")
    low, high = _flat_reach(band, used, edges, wider)
    used &= (band.distance >= low) & (band.distance <= high)
    saturated = band.value >= full_scale_dn * _SATURATED
    if np.count_nonzero(saturated & used) > _MOST_SATURATED * np.count_nonzero(used):
        return FailedFit("too many pixels are saturated to know the grey levels")
    used &= ~saturated
    reach = _EDGE_SIGMAS * math.sqrt(edges.blur_px**2 + PIXEL_VARIANCE) + 0.8
    edge = used & (np.abs(band.distance) <= reach)
    count = int(np.count_nonzero(used))
    if count < _FEWEST or np.count_nonzero(edge) < _FEWEST // 3:
        return FailedFit("too few pixels along the contour")
    started = _start(kept(band, edge), edges, lens)
    if isinstance(started, FailedFit):
        return started
    theta, pixels = started
    centre, size_px, order = edges.ellipse[:2], max(float(edges.ellipse[2]), 2.0), best_order(count)

    def functions(places: Array) -> Array:
        return level_basis(places, centre, size_px, order)

    inside, outside = used & (band.distance < -reach), used & (band.distance > reach)
    at, normal = pixels.band.pixel_px, pixels.band.normal
    basis = functions(at)
    return Scene(
        theta,
        pixels,
        basis,
        functions(at + normal) - basis,
        (at - pixels.band.distance[:, None] * normal - centre) / size_px,
        (
            Plateau(functions(band.pixel_px[inside]), band.value[inside]),
            Plateau(functions(band.pixel_px[outside]), band.value[outside]),
        ),
        lens,
    )


def _start(band: Band, edges: EdgePoints, lens: Camera | None) -> tuple[Array, BandPixels] | FailedFit:
    """Starting shape in undistorted pixel coordinates, and the pixels of the band around it."""
    if lens is None:
        return shape_of_ellipse(edges.ellipse), BandPixels(band, shape_jacobian(band.normal, band.u))
    points = undistort_px(lens, edges.points_px)
    good = np.isfinite(points).all(axis=1)
    fit = fit_ellipse(points[good], edges.sigma_px[good])
    if isinstance(fit, FailedFit):
        return fit
    theta = shape_of_ellipse(fit.ellipse)
    return theta, band_pixels(band, theta, lens)


def _flat_reach(band: Band, used: NDArray[np.bool_], edges: EdgePoints, wider: int) -> tuple[float, float]:
    """Extent of the plateaus beyond the reach of `edges`: until some directions deviate from their level."""
    ends = []
    for sign, end in ((-1.0, edges.reach_px[0]), (1.0, edges.reach_px[1])):
        beyond = sign * (band.distance - end)
        outer = np.flatnonzero(used & (beyond > -_LAST_PX))
        # Bin 0 is the last one of `edges`, the others are 1 px each.
        index = np.maximum(np.ceil(beyond[outer]), 0.0).astype(np.int64) * _GROUPS
        index += band.sector[outer] * _GROUPS // band.count
        inside = index < (wider + 1) * _GROUPS
        index, outer = index[inside], outer[inside]
        number = np.bincount(index, minlength=(wider + 1) * _GROUPS).reshape(-1, _GROUPS)
        total = np.bincount(index, band.value[outer], minlength=(wider + 1) * _GROUPS).reshape(-1, _GROUPS)
        mean = total / np.maximum(number, 1)
        extent = 0
        for i in range(1, wider + 1):
            both = (number[0] > 0) & (number[i] > 0)
            if np.count_nonzero(both) < 3:
                break
            allowed = (_FLAT * edges.contrast_dn) ** 2 + 2 * edges.noise_dn**2 * np.mean(
                1 / number[0][both] + 1 / number[i][both]
            )
            if np.mean((mean[i] - mean[0])[both] ** 2) > allowed:
                break
            extent = i
        ends.append(end + sign * extent)
    return ends[0], ends[1]
