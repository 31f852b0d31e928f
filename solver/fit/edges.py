"""Sub-pixel edge points on the contour of an ellipse, from the raw pixels around it.

Nothing is interpolated: a profile interpolated from area pixels is biased by the interpolation kernel and by aliasing.
Instead every pixel within a few px of the contour is predicted from its signed distance to it,

    I = inside + (outside - inside) T(d - delta),

with T the exact response of a square pixel to a straight edge of its orientation, blurred by a Gaussian. The contour
is divided into sectors of about 2 px; each gets its own offset delta along the normal (Gauss-Newton), its two grey
levels come from neighbouring sectors, and all share one blur. The offsets give a better ellipse, the ellipse better
distances.

Blur shifts a *curved* edge: a point u from the edge has the distance d + u_n + u_t^2 / (2 rho), so the mean over the
blur shifts the half level by b^2 / (2 rho) toward the centre of curvature, where b^2 is the variance of the blur along
the contour, including the pixel's own 1/12. The prediction includes that shift, so the points are free of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from roundel.scenes.geometry.conic import ellipse_perimeter_px, ellipse_points
from roundel.scenes.geometry.edge_spread_function import PIXEL_VARIANCE, curved_distance, step_response
from roundel.solver.fit.edge_band import (
    MIN_SECTORS,
    PLATEAU_PX,
    Band,
    band_around,
    by_sector,
    reach_of,
    sector_centres,
    shape_jacobian,
    within,
)
from roundel.solver.fit.ellipse import FailedFit, ellipse_of_shape, fit_ellipse, shape_of_ellipse
from roundel.solver.fit.ellipse_distance import foot_points

Array = NDArray[np.float64]

_SECTOR_PX = 2.0
_FIRST_REACH_PX = 8.0  # search distance from a candidate for its edge and its plateaus
_LEVEL_WINDOW_PX = 10.0  # grey levels come from this distance along the contour, on either side
_MAX_ROUNDS = 6
_SETTLED_PX = 0.005  # the error after an iteration is about a thirtieth of its step
_CLOSE_PX, _CLOSE = 1.0, 0.07  # limits of a small step: in px, and as a fraction of the semi-minor axis
_FIRST_STEPS, _STEPS, _LAST_STEPS = 4, 3, 3
_SATURATED = 254.5 / 255.0  # fraction of the full scale
_SATURATED_STEPS = 12
_FIT_TOLERANCE = 1e-5  # fraction of the size: the points move more than that in the next iteration
_MIN_VARIANCE = 0.05**2  # a smaller blur is indistinguishable from none


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """Points on one contour.

    Attributes
    ----------
    points_px : (N, 2) array
        Image pixels (with lens distortion), in the order of the contour.
    sigma_px : (N,) array
        Standard deviation along the normal, from the noise of the pixels.
    ellipse : (5,) array
        The ellipse fitted to them in the image.
    blur_px : float
        Gaussian sigma of the blur, excluding the pixel's aperture.
    contrast_dn : float
        Median of outside minus inside (the quartile if half of it is hidden or shaded): positive for dark on light.
    noise_dn : float
        RMS residual of the model.
    coverage : float
        Fraction of the contour that has a point.
    trusted : (S,) array
        Which sectors of the contour, from the eccentric angle 0 on, have a point.
    reach_px : (float, float)
        Extent of the edge with a part of its plateaus, inward (negative) and outward.
    """

    points_px: Array
    sigma_px: Array
    ellipse: Array
    blur_px: float
    contrast_dn: float
    noise_dn: float
    coverage: float
    trusted: NDArray[np.bool_]
    reach_px: tuple[float, float]


def edge_points(
    image: NDArray[Any], ellipse: Array, full_scale_dn: float = 255.0, polish: bool = True
) -> EdgePoints | FailedFit:
    """Find the edge points along an approximate ellipse, and fit an ellipse to them.

    Parameters
    ----------
    image : (H, W) array
        Grey levels.
    ellipse : (5,) array
        x_px, y_px, a_px, b_px, angle_deg: within 2 px or so of the contour.
    full_scale_dn : float
        The level at which pixels saturate.
    polish : bool
        Repeat until the ellipse moves by less than 0.005 px. Otherwise it is off by about 0.05 px: enough to decide
        whether there is a contour, and as a start for `fit_pixels`.

    Returns
    -------
    EdgePoints or FailedFit
    """
    current = np.array(ellipse, dtype=np.float64)
    limits = (-_FIRST_REACH_PX, _FIRST_REACH_PX)
    variance, found = 1.0, None
    for turn in range(_MAX_ROUNDS):
        first = turn == 0
        count = max(MIN_SECTORS, round(float(ellipse_perimeter_px(current)) / _SECTOR_PX))
        band = band_around(image, current, limits, count)
        reach = reach_of(band)
        if isinstance(reach, FailedFit):
            return reach
        band = by_sector(within(band, reach))
        if len(band.value) < 2 * count:
            return FailedFit("no edge with flat sides along the contour")
        limits = (reach[0] - PLATEAU_PX, reach[1] + PLATEAU_PX)
        offsets = _offsets(band, variance, full_scale_dn, first, _FIRST_STEPS if first else _STEPS)
        feet, normals, u = sector_centres(current, count)
        jacobian, moved_by = shape_jacobian(normals, u), np.zeros(5)
        if first or not polish:
            step = _linear_fit(offsets, jacobian, float(current[3]) if first else math.inf)
            if isinstance(step, FailedFit):
                return step
            moved_by = step
            close = min(_CLOSE_PX, _CLOSE * float(current[3]))
            if not polish and float(np.max(np.abs(jacobian @ step))) < close:
                # A small step changes distances linearly, up to its square over twice the radius of curvature.
                band = replace(band, distance=band.distance + shape_jacobian(band.normal, band.u) @ step)
                offsets = _offsets(band, offsets.variance, full_scale_dn, False, _LAST_STEPS)
                step = _linear_fit(offsets, jacobian, math.inf)
                if isinstance(step, FailedFit):
                    return step
                shifted = offsets.delta - jacobian @ moved_by
                moved_by = moved_by + step
                after = _moved(current, moved_by)
                if isinstance(after, FailedFit):
                    return after
                return _found(after, feet + shifted[:, None] * normals, offsets, reach, feet)
            after = _moved(current, moved_by)
        else:
            after = _curved_fit(offsets, feet + offsets.delta[:, None] * normals, current)
        if isinstance(after, FailedFit):
            return after
        found = _found(after, feet + offsets.delta[:, None] * normals, offsets, reach, feet)
        moved, current, variance = _largest_move(current, after), after, offsets.variance
        if moved < _SETTLED_PX and not first:
            break
    assert found is not None
    return found


def _few(offsets: _Offsets) -> FailedFit | None:
    good, count = int(np.count_nonzero(offsets.good)), len(offsets.good)
    if good < max(8, 0.3 * count):
        return FailedFit(f"only {good} of {count} sectors of the contour show an edge")
    return None


def _linear_fit(offsets: _Offsets, jacobian: Array, b_px: float) -> Array | FailedFit:
    """First-order step of the shape that explains the offsets; sectors off the ellipse are no longer trusted.

    `b_px` is the semi-minor axis that scales the allowed residual; a contour that is not an ellipse fails here.
    """
    for again in (True, False):
        few = _few(offsets)
        if few is not None:
            return few
        good = offsets.good
        rows = jacobian[good] / offsets.sigma[good, None]
        step = np.linalg.lstsq(rows, -offsets.delta[good] / offsets.sigma[good], rcond=None)[0]
        residual = np.abs(offsets.delta + jacobian @ step)
        spread = 1.4826 * float(np.median(residual[good]))
        outside = good & (residual > max(4.0 * spread, 0.05))
        if not (again and np.any(outside)) or np.count_nonzero(good & ~outside) < 8:
            break
        # Points of a neighbour, a shadow or a stain are off the ellipse.
        offsets.good[outside] = False
    if np.median(residual[good]) > 0.1 + 0.03 * b_px + 2.0 * float(np.median(offsets.sigma[good])):
        return FailedFit("the edge along the contour is not an ellipse")
    return np.asarray(step, dtype=np.float64)


def _curved_fit(offsets: _Offsets, points: Array, start: Array) -> Array | FailedFit:
    """The ellipse fitted to the trusted points; points off it are no longer trusted."""
    few = _few(offsets)
    if few is not None:
        return few
    good = offsets.good
    fit = fit_ellipse(points[good], offsets.sigma[good], start=start, tolerance=_FIT_TOLERANCE)
    if isinstance(fit, FailedFit):
        return fit
    spread = 1.4826 * float(np.median(np.abs(fit.residual_px)))
    keep = np.abs(fit.residual_px) <= max(4.0 * spread, 0.05)
    if not np.all(keep) and np.count_nonzero(keep) >= 8:
        good[np.flatnonzero(good)[~keep]] = False
        fit = fit_ellipse(points[good], offsets.sigma[good], start=fit.ellipse, tolerance=_FIT_TOLERANCE)
        if isinstance(fit, FailedFit):
            return fit
    return _large_enough(fit.ellipse)


def _moved(ellipse: Array, step: Array) -> Array | FailedFit:
    theta = shape_of_ellipse(ellipse) + step
    if not (np.all(np.isfinite(theta)) and theta[2] > 0 and theta[2] * theta[4] > theta[3] ** 2):
        return FailedFit("the contour shrinks below one pixel")
    return _large_enough(ellipse_of_shape(theta))


def _large_enough(ellipse: Array) -> Array | FailedFit:
    if not (np.all(np.isfinite(ellipse)) and ellipse[3] > 1.0):
        return FailedFit("the contour shrinks below one pixel")
    return ellipse


def _found(ellipse: Array, points: Array, offsets: _Offsets, reach: tuple[float, float], feet: Array) -> EdgePoints:
    good = offsets.good
    # Sectors are numbered from the ellipse's own axis, which may rotate for a near circle, so each sector takes the
    # nearest measured one.
    mine, old = (np.arctan2(*(p - ellipse[:2]).T[::-1]) for p in (sector_centres(ellipse, len(good))[0], feet))
    mine, old = np.mod(mine - old[0], 2 * np.pi), np.mod(old - old[0], 2 * np.pi)
    nearest = np.searchsorted((old[1:] + old[:-1]) / 2, mine)
    nearest[mine > (old[-1] + 2 * np.pi) / 2] = 0
    trusted = good[nearest]
    return EdgePoints(
        points[good],
        offsets.sigma[good],
        ellipse,
        math.sqrt(offsets.variance),
        offsets.contrast_dn,
        offsets.noise_dn,
        float(np.mean(good)),
        trusted,
        (reach[0], reach[1]),
    )


def _largest_move(before: Array, after: Array) -> float:
    return float(np.max(np.abs(foot_points(before, ellipse_points(after, 16))[0])))


@dataclass(frozen=True, eq=False)
class _Offsets:
    """Offset, sigma and trust of each sector; blur, contrast, and residual of the model."""

    delta: Array
    sigma: Array
    good: NDArray[np.bool_]
    variance: float
    contrast_dn: float
    noise_dn: float


def _offsets(band: Band, variance: float, full_scale_dn: float, first: bool, steps: int) -> _Offsets:
    sector, count, value = band.sector, band.count, band.value
    filled, starts = np.unique(sector, return_index=True)  # the pixels are sorted by sector

    def total(*weights: Array) -> Array:
        """Sums of the pixels of each sector, (number of weights, count)."""
        sums = np.zeros((len(weights), count))
        sums[:, filled] = np.add.reduceat(np.stack(weights), starts, axis=1)
        return sums

    delta = np.zeros(count)
    window = min(max(1, round(_LEVEL_WINDOW_PX / _SECTOR_PX)), (count - 1) // 4)
    size = np.bincount(sector, minlength=count)
    # In the first iteration the contour is too rough to identify saturated pixels; in binary pixels (an edge should
    # have about one shade per px) they cannot be identified at all.
    low, high = float(value.min()), float(value.max())
    shades = np.count_nonzero((value > low + 0.05 * (high - low)) & (value < high - 0.05 * (high - low)))
    saturated = (value >= full_scale_dn * _SATURATED) & (not first and shades > 0.2 * count * _SECTOR_PX)
    if np.mean(saturated) > 0.1:
        # Levels, offsets and blur are then correlated: they converge slowly, and need the whole contour.
        steps, window = _SATURATED_STEPS, (count - 1) // 2
    # Weights of the pixels, derivative by -delta, and the inverse of a sector's information on it: zero at first.
    seen, lean, inverse = np.ones_like(value), np.zeros_like(value), np.zeros(count)
    for _ in range(steps):
        z, _ = curved_distance(
            band.distance - delta[sector], band.curvature, band.curvature_ss, variance + PIXEL_VARIANCE
        )
        # For a rough contour a Gaussian of the pixel's variance suffices: one term instead of four.
        t, slope, bend = (
            _gaussian_step(z, variance + PIXEL_VARIANCE)
            if first
            else step_response(z, band.half_sum, band.half_difference, variance)
        )
        # Grey levels: least squares in (inside, outside), the normal equations summed over the neighbouring sectors;
        # the offset of each sector is eliminated before (Schur complement).
        p, q, v = seen * (1 - t), seen * t, seen * value
        lean_p, lean_q, lean_v, pp, qq, pq, pv, qv = total(
            lean * p, lean * q, lean * v, p * p, q * q, p * q, p * v, q * v
        )
        known = inverse * np.stack([lean_p**2, lean_q**2, lean_p * lean_q, lean_p * lean_v, lean_q * lean_v])
        a11, a22, a12, b1, b2 = _around(np.stack([pp, qq, pq, pv, qv]) - known, window)
        determinant = np.maximum(a11 * a22 - a12**2, 1e-9 * (a11 + a22) ** 2 + 1e-12)
        inside, outside = (a22 * b1 - a12 * b2) / determinant, (a11 * b2 - a12 * b1) / determinant
        height = outside - inside
        predicted = inside[sector] + height[sector] * t
        # A saturated pixel is only a lower bound.
        seen = np.where(saturated & (predicted >= full_scale_dn), 0.0, 1.0)
        residual = seen * (value - predicted)
        step_dn = seen * height[sector]
        lean = step_dn * slope
        # The blur's variance: dT / d(b^2) = T'' / 2, the heat equation.
        widen = step_dn * bend / 2
        information, pushed, widened = total(lean**2, lean * residual, lean * widen)
        usable = information > 1e-12 * float(np.max(information, initial=0.0))
        inverse = np.where(usable, 1.0 / np.where(usable, information, 1.0), 0.0)
        delta -= np.clip(pushed * inverse, -1.0, 1.0)
        # The part explained by the offsets is removed.
        widen -= lean * (widened * inverse)[sector]
        power = float(np.sum(widen**2))
        change = float(np.sum(widen * residual)) / power if power > 0 else 0.0
        variance = float(np.clip(variance + change, max(variance / 4, _MIN_VARIANCE), variance * 4))
    lower, contrast, upper = (float(v) for v in np.quantile(height, (0.25, 0.5, 0.75)))
    strong = upper if upper >= -lower else lower
    # Half of a contour or more may be hidden, without a step, or in a shadow, with a small step.
    uneven = abs(contrast) < 0.3 * abs(strong)
    least = 0.1 * abs(strong) if uneven else 0.35 * abs(contrast)
    if uneven:
        contrast = strong
    spread = np.sqrt(total(residual**2)[0] / np.maximum(size, 1))
    good = (
        usable
        & (height * np.sign(contrast) > least)
        & (size > 0.6 * band.expected)
        & (np.abs(delta) < 2.5)
        & (spread <= max(4.0 * float(np.median(spread)), 0.05 * abs(contrast)))
    )
    trusted = residual[good[sector]]
    noise = float(np.sqrt(np.mean(trusted**2))) if len(trusted) else 0.0
    sigma = np.where(usable, max(noise, 1e-6) * np.sqrt(inverse), np.inf)
    return _Offsets(delta, sigma, good, variance, contrast, noise)


def _gaussian_step(z: Array, variance: float) -> tuple[Array, Array, Array]:
    s = z / math.sqrt(variance)
    slope = np.exp(-0.5 * s * s) / math.sqrt(2 * math.pi * variance)
    return ndtr(s), slope, slope * z / -variance


def _around(values: Array, window: int) -> Array:
    """Sums (k, count) over the `window` neighbours on either side, around the closed contour."""
    wrapped = np.concatenate([values[:, -window:], values, values[:, :window]], axis=1)
    ends = np.cumsum(wrapped, axis=1)
    sums = ends[:, 2 * window :].copy()
    sums[:, 1:] -= ends[:, : -2 * window - 1]
    return sums
