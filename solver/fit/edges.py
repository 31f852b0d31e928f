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
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roundel.solver.fit.ellipse import FailedFit
from roundel.solver.kernels.contour_pixels import sector_centres
from roundel.solver.kernels.trace_contour import FAILURES, trace_contour

Array = NDArray[np.float64]


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
    image: NDArray[Any],
    ellipse: Array,
    full_scale_dn: float = 255.0,
    polish: bool = True,
    known: EdgePoints | None = None,
) -> EdgePoints | FailedFit:
    """Find the edge points along an approximate ellipse, and fit an ellipse to them.

    Parameters
    ----------
    image : (H, W) array
        Grey levels; float32 ones are used as they are, others are converted at each call.
    ellipse : (5,) array
        x_px, y_px, a_px, b_px, angle_deg: within 2 px or so of the contour.
    full_scale_dn : float
        The level at which pixels saturate.
    polish : bool
        Repeat until the ellipse moves by less than 0.005 px. Otherwise it is off by about 0.05 px: enough to decide
        whether there is a contour, and as a start for `fit_pixels`.
    known : EdgePoints, optional
        Of the same contour, to start from its blur and its reach.

    Returns
    -------
    EdgePoints or FailedFit
    """
    pixels = np.ascontiguousarray(image, dtype=np.float32)
    start, full = np.array(ellipse, dtype=np.float64), float(full_scale_dn)
    before = np.zeros(3) if known is None else np.array([max(known.blur_px, 1e-3) ** 2, *known.reach_px])
    failure, after, points, sigma, good, feet, about = trace_contour(pixels, start, full, polish, before)
    if failure:
        return FailedFit(FAILURES[failure])
    return EdgePoints(
        points[good],
        sigma[good],
        after,
        math.sqrt(about[0]),
        float(about[1]),
        float(about[2]),
        float(np.mean(good)),
        _renumbered(after, good, feet),
        (float(about[3]), float(about[4])),
    )


def _renumbered(ellipse: Array, good: NDArray[np.bool_], feet: Array) -> NDArray[np.bool_]:
    """`good` for the sectors of the final ellipse: of each the nearest measured one.

    Sectors are numbered from the ellipse's own axis, which may rotate for a near circle.
    """
    if good.all():
        return good
    mine, old = (np.arctan2(*(p - ellipse[:2]).T[::-1]) for p in (sector_centres(ellipse, len(good))[0], feet))
    mine, old = np.mod(mine - old[0], 2 * np.pi), np.mod(old - old[0], 2 * np.pi)
    nearest = np.searchsorted((old[1:] + old[:-1]) / 2, mine)
    nearest[mine > (old[-1] + 2 * np.pi) / 2] = 0
    return np.asarray(good[nearest])
